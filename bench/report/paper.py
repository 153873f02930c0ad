"""The page of a run on paper: A4 as PDF, set by Typst from the elements of the page (`paper.typ`)."""

from __future__ import annotations

import json
import re
from base64 import b64decode
from pathlib import Path
from types import ModuleType

import matplotlib

from bench.errors import InputError
from bench.optional import imported
from bench.xml_text import xml_text

STYLE = Path(__file__).with_name("paper.typ")
_FIGURE = re.compile(r'<svg role="img" aria-label="(?P<what>[^"]*)".*?</svg>', re.DOTALL)  # as `figures.svg` writes it
_PNG = re.compile(r'src="data:image/png;base64,(?P<content>[^"]*)"')


def pdf(page: str) -> bytes:
    """PDF of a page, tagged for screen readers; equal pages give equal bytes.

    The page is HTML that is well-formed XML from `<html` on. Raises InputError without Typst, and if the page cannot be
    set, as with an image that is damaged.
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
    """The page as XML, and its images as files: figures with their descriptions as alternative texts, and marks."""
    files: dict[str, bytes] = {}

    def added(name: str, content: bytes) -> str:
        files[name] = content
        return name

    def figure(found: re.Match[str]) -> str:
        svg = found[0].replace("<svg", '<svg xmlns="http://www.w3.org/2000/svg"', 1)
        return f'<img alt="{found["what"]}" src="{added(f"figure-{len(files)}.svg", svg.encode())}"/>'

    def mark(found: re.Match[str]) -> str:
        numbers = list(b64decode(found["content"]))  # files in memory can only be text
        return f'src="{added(f"mark-{len(files)}.json", json.dumps(numbers).encode())}"'

    page = _PNG.sub(mark, _FIGURE.sub(figure, page[page.index("<html") :]))
    return {"page.xml": xml_text(page).encode(), **files}
