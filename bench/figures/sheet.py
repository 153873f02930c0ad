"""A table of a page: heads with their units, and rows of text."""

from __future__ import annotations

from dataclasses import dataclass

NUMERIC = "0123456789+-–<>"  # first characters of numbers


@dataclass(frozen=True)
class Sheet:
    """A table of the page: headings with their units, empty for none, and rows of cells."""

    title: str
    caption: str
    heads: tuple[tuple[str, str], ...]
    rows: tuple[tuple[str, ...], ...]

    @property
    def aligned(self) -> tuple[str, ...]:
        """CSS class of the cells of each column: "n" for numbers, aligned right, "" for words."""
        columns = list(zip(*self.rows, strict=True)) or [()] * len(self.heads)
        return ("", *("n" if any(cell[:1] in NUMERIC for cell in cells if cell) else "" for cells in columns[1:]))
