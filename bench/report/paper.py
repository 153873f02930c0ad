"""The page of a run as PDF, A4: Typst typesets the elements of the page (`paper.typ`)."""

from __future__ import annotations

import json
import re
from base64 import b64decode
from pathlib import Path
from types import ModuleType

import matplotlib

from bench.errors import InputError
from bench.figures.svg import as_files
from bench.optional import imported
from bench.xml_text import xml_text

STYLE = Path(__file__).with_name("paper.typ")
_PNG = re.compile(r'src="data:image/png;base64,(?P<content>[^"]*)"')


def pdf(page: str) -> bytes:
    """PDF of a page, tagged for screen readers; equal pages give equal bytes.

    The page is HTML that is well-formed XML from `<html` on. Raises InputError without Typst, and for a page that Typst
    cannot typeset, such as one with a damaged image.
    """
    typst = library()
    fonts = Path(matplotlib.get_data_path(), "fonts", "ttf")  # DejaVu, the same on every computer
    try:
        content: bytes = typst.compile({"main.typ": STYLE.read_bytes(), **_files(page)}, font_paths=[fonts])
    except typst.TypstError as problem:
        raise InputError(f"the report cannot be written as PDF: {problem.message}; as HTML it can") from None
    return content


def library() -> ModuleType:
    """Import Typst; InputError with advice on installation if it is missing."""
    return imported("typst", "pdf")


def _files(page: str) -> dict[str, bytes]:
    """The page as XML, and its images as the files that it names: figures and marks."""
    page, figures = as_files(page[page.index("<html") :])
    marks: dict[str, str] = {}

    def mark(found: re.Match[str]) -> str:
        name = f"mark-{len(marks)}.json"
        marks[name] = json.dumps(list(b64decode(found["content"])))  # files in memory can only be text
        return f'src="{name}"'

    page = _PNG.sub(mark, page)
    return {name: text.encode() for name, text in {"page.xml": xml_text(page), **figures, **marks}.items()}
