"""Tables of text in columns of the width of their widest cell, for terminals and pipes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.cells import cell_len

GAP = "  "


def in_columns(rows: Sequence[Sequence[str]], align: str, indent: str = "  ") -> Iterator[str]:
    """Return one line for each row; `align` has "<" or ">" for each column, and all rows have as many cells.

    Widths count terminal cells, of which a Chinese character takes two.
    """
    widths = [max(map(cell_len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = [_padded(cell, width, side) for cell, width, side in zip(row, widths, align, strict=True)]
        yield (indent + GAP.join(cells)).rstrip()


def _padded(cell: str, width: int, side: str) -> str:
    blank = " " * (width - cell_len(cell))
    return cell + blank if side == "<" else blank + cell
