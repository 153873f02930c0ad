"""Text in CSV files that a spreadsheet does not take for a formula."""

from __future__ import annotations

import re

_BEGINS_A_FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")
_BEGINS_IT_ELSEWHERE = ("\uff1d", "\uff0b", "\uff0d", "\uff20")  # the same, as wide as a Chinese character
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?([eE][+-]?\d+)?|inf|nan)", re.ASCII)


def harmless(cell: object) -> object:
    """A cell as it may stand in a CSV file: text that begins like a formula has an apostrophe before it.

    Numbers stay as they are, also where they are spelled as text. Whoever needs the text itself takes the apostrophe
    away.
    """
    if not isinstance(cell, str) or not cell.startswith((*_BEGINS_A_FORMULA, *_BEGINS_IT_ELSEWHERE)):
        return cell
    return cell if _NUMBER.fullmatch(cell) else f"'{cell}"
