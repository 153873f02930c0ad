"""XML of certificates, read without entities, without other files and without a network."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TypeAlias

from bench.errors import InputError
from bench.optional import imported
from drivers.schema.bounded import UnfitFileError, read_bounded

imported("lxml", "dcc", what="certificate")
from lxml import etree  # noqa: E402  with advice where it is missing

DCC, SI, DS = "https://ptb.de/dcc", "https://ptb.de/si", "http://www.w3.org/2000/09/xmldsig#"
XSI = "http://www.w3.org/2001/XMLSchema-instance"
NAMES = {"dcc": DCC, "si": SI, "ds": DS, "xsi": XSI}
LIMIT_BYTES = 16 * 2**20
ROOT = f"{{{DCC}}}digitalCalibrationCertificate"
MAJOR = "3"  # of the versions that can be read
_MOST_SHOWN = 120

Element: TypeAlias = etree._Element  # noqa: SLF001  it has no public name


class Markup:
    """Certificate as XML. `path` is only used in messages, `content` are its bytes."""

    def __init__(self, path: Path, content: bytes) -> None:
        self.path, self.content = path, content
        self.root = _parsed(path, content)
        self._expect_certificate()

    def problem(self, text: str, at: Element | None = None) -> InputError:
        """Return an error with the file and the line of an element."""
        return InputError(f"{self.path}:{_line(self.root if at is None else at)}: {text}")

    def all(self, where: str, inside: Element | None = None) -> list[Element]:
        """Return the elements of an XPath, with the prefixes dcc, si and ds."""
        found = (self.root if inside is None else inside).xpath(where, namespaces=NAMES)
        return [each for each in found if isinstance(each, Element)] if isinstance(found, list) else []

    def text(self, where: str, inside: Element | None = None) -> str:
        """Return the text of the first element of an XPath, "" without one."""
        return next((plain(each) for each in self.all(where, inside)), "")

    def _expect_certificate(self) -> None:
        root = self.root
        if root.tag != ROOT:
            raise self.problem(f"is no digital calibration certificate; its first element is {_shown(str(root.tag))}")
        version = root.get("schemaVersion", "")
        if version.partition(".")[0] != MAJOR:
            raise self.problem(
                f"is a certificate by version {_shown(version) or '(none)'} of the schema, and versions {MAJOR}.x are "
                "read; ask the laboratory for one"
            )


def read_markup(path: Path) -> Markup:
    """Read a certificate. Raises InputError for what is none, is not XML, or has entities."""
    try:
        return Markup(path, read_bounded(path, LIMIT_BYTES))
    except UnfitFileError as problem:
        raise InputError(f"{path}: {problem}") from None


def _parsed(path: Path, content: bytes) -> Element:
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, dtd_validation=False, huge_tree=False,
        remove_comments=True, remove_pis=True,
    )  # fmt: skip
    if b"<!DOCTYPE" in content:  # before the parser sees what it declares
        line = content[: content.index(b"<!DOCTYPE")].count(b"\n") + 1
        raise InputError(f"{path}:{line}: {_DECLARED}")
    try:
        content.decode()
        root = etree.fromstring(content, parser)
    except etree.XMLSyntaxError as problem:
        line = problem.lineno or 1
        raise InputError(f"{path}:{line}: is not XML ({problem.msg}); is it the right file?") from None
    except UnicodeDecodeError as problem:
        line = content.count(b"\n", 0, problem.start) + 1
        raise InputError(f"{path}:{line}: is not UTF-8 text; ask the laboratory for a certificate in UTF-8") from None
    except ValueError as problem:
        raise InputError(f"{path}:1: is not XML ({problem})") from None
    if getattr(root.getroottree().docinfo, "doctype", ""):
        raise InputError(f"{path}:1: {_DECLARED}")
    return root


_DECLARED = "declares a document type (DOCTYPE), which could stand for other files; no certificate needs one"


def plain(element: Element) -> str:
    """Return the text of an element, with single spaces."""
    return " ".join("".join(str(part) for part in element.itertext()).split())


def texts(element: Element) -> Iterator[tuple[str, str]]:
    """Yield language and text of each `content` of an element."""
    for each in element.iterfind("dcc:content", NAMES):
        yield each.get("lang", ""), plain(each)


def named(element: Element | None, language: str = "en") -> str:
    """Return the text of an element in a language, else the first one."""
    found = list(texts(element)) if element is not None else []
    return next((text for known, text in found if known == language), found[0][1] if found else "")


def _line(element: Element) -> int:
    line: object = getattr(element, "sourceline", None)
    return line if isinstance(line, int) else 1


def _shown(text: str) -> str:
    return text if len(text) <= _MOST_SHOWN else text[:_MOST_SHOWN] + "…"
