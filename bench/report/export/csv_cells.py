"""CSV files with text that a spreadsheet does not interpret as a formula."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable
from pathlib import Path

from bench.files import atomic_file

_BEGINS_A_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")
_BEGINS_IT_ELSEWHERE = ("\uff1d", "\uff0b", "\uff0d", "\uff20")  # the full-width forms of these
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?([eE][+-]?\d+)?|inf|nan)", re.ASCII)


def harmless(cell: object) -> object:
    """A cell for a CSV file: text that begins like a formula gets an apostrophe in front.

    Numbers are unchanged, also as text. A reader of the original text must remove the apostrophe.
    """
    if not isinstance(cell, str) or not cell.startswith((*_BEGINS_A_FORMULA, *_BEGINS_IT_ELSEWHERE)):
        return cell
    return cell if _NUMBER.fullmatch(cell) else f"'{cell}"


def write_csv(path: Path, rows: Iterable[Iterable[object]]) -> Path:
    """Write rows, whose texts are harmless already, as a CSV file; return its path. Raises InputError."""
    with atomic_file(path) as draft, draft.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(rows)
    return path
