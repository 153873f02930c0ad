"""Text in CSV files that a spreadsheet does not interpret as a formula."""

from __future__ import annotations

import re

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
