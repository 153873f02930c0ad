"""Source of a file with colours, and differences, line by line."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from markupsafe import Markup
from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers.data import YamlLexer

KINDS = {"+": "added", "-": "removed", "@": "place"}


class DifferenceLine(NamedTuple):
    """Line of a difference; `kind` is added, removed, place, file, or empty for an unchanged line."""

    kind: str
    text: str


def source_lines(text: str) -> list[Markup]:
    """Return the lines of a YAML text as HTML, where classes name what a word is."""
    html = highlight(text, YamlLexer(stripnl=False), HtmlFormatter(nowrap=True))
    return [Markup(line) for line in html.removesuffix("\n").split("\n")]  # noqa: S704  pygments has escaped the text


def difference_lines(lines: Iterable[str]) -> list[DifferenceLine]:
    """Return the lines of `diff -u` with their kinds."""
    found: list[DifferenceLine] = []
    for line in lines:
        is_file = line.startswith(("--- ", "+++ ")) and (not found or found[-1].kind in ("", "file"))
        found.append(DifferenceLine("file" if is_file else KINDS.get(line[:1], ""), line))
    return found
