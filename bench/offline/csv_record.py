"""A record of a case: a CSV file with a header line, comma separated, blank for missing values."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from bench.errors import InputError
from drivers.schema.bounded import UnfitFileError, read_bounded
from drivers.schema.suggest import nearest

MINUS_SIGNS = str.maketrans(dict.fromkeys("\u2212\u2013\u2014\uff0d", "-"))  # and dashes
UNIT_BEHIND = re.compile(r"([+-]?[0-9]+(?:\.[0-9]*)?(?:[eE][+-]?[0-9]+)?)\s*[A-Za-z°º\u2103µμΩ%/'\"]+")
SHOWN = 100  # characters of a header in a message
SIZE_LIMIT_BYTES = 256 * 2**20
TRUTHS = {"1": True, "1.0": True, "true": True, "0": False, "0.0": False, "false": False, "": False}


@dataclass(frozen=True, slots=True)
class Table:
    """Columns of one file as text; `text` is the whole file, to find the line of an invalid cell.

    `rows` are the numbers of its rows in the file, if some are left out.
    """

    file: str
    columns: dict[str, tuple[str, ...]]
    text: str
    rows: tuple[int, ...] | None = None

    def without_copies(self) -> tuple[Table, int]:
        """The table without rows equal to an earlier one in every column that is read, and their number.

        A row of blanks is no copy.
        """
        first: dict[tuple[str, ...], int] = {}
        cells = zip(*([text.strip() for text in column] for column in self.columns.values()), strict=True)
        kept = [row for row, each in enumerate(cells) if first.setdefault(each, row) == row or not any(each)]
        columns = {name: tuple(column[row] for row in kept) for name, column in self.columns.items()}
        left_out = len(next(iter(self.columns.values()))) - len(kept)
        return Table(self.file, columns, self.text, tuple(kept)), left_out

    def numbers(self, column: str) -> NDArray[np.float64]:
        """A column (n,) of numbers; NaN for blanks. Raises InputError for any other text."""
        try:
            return np.array([_number(text) for text in self.columns[column]], dtype=np.float64)
        except ValueError:
            row = next(i for i, text in enumerate(self.columns[column]) if not is_number(text))
            self._refuse(column, row, "a number")

    def whole_numbers(self, column: str) -> NDArray[np.float64]:
        """A column (n,) of whole numbers, as floats; NaN for blanks."""
        values = self.numbers(column)
        broken = np.flatnonzero(np.isfinite(values) & (values != np.round(values)))
        if len(broken):
            self._refuse(column, int(broken[0]), "a whole number")
        return values

    def words(self, column: str, known: Sequence[str]) -> NDArray[np.str_]:
        """A column (n,) of `known` words; empty for blanks."""
        words = [text.strip().lower() for text in self.columns[column]]
        for row in np.flatnonzero(~np.isin(words, [*known, ""])):
            self._refuse(column, int(row), " or ".join(known))
        return np.array(words, dtype=np.str_)

    def truths(self, column: str) -> NDArray[np.bool_]:
        """A column (n,) of 1 or true, 0 or false, also with the decimals of a spreadsheet; a blank is false."""
        words = [text.strip().lower() for text in self.columns[column]]
        for row, word in enumerate(words):
            if word not in TRUTHS:
                self._refuse(column, row, "1, 0, true or false")
        return np.array([TRUTHS[word] for word in words], dtype=np.bool_)

    def lines(self, rows: NDArray[np.int_], most: int = 5) -> str:
        """Text of the lines of the file that hold `rows` (n,): "line 7", "lines 3, 5, 9 and 12 more"."""
        named = ", ".join(str(self._line(int(row))) for row in rows[:most])
        more = f" and {len(rows) - most} more" if len(rows) > most else ""
        return f"line{'s' if len(rows) > 1 else ''} {named}{more}"

    def _refuse(self, column: str, row: int, expected: str) -> NoReturn:
        text = self.columns[column][row]
        raise InputError(
            f"{self.file}: line {self._line(row)}, column {column}: '{text[:40]}' is not {expected}; "
            f"{advice(text[:40].strip())}"
        )

    def _line(self, row: int) -> int:
        return _line_of_row(self.text, row if self.rows is None else self.rows[row])


def read_table(path: Path, columns: Sequence[str], optional: Sequence[str] = ()) -> Table:
    """Read `columns` of a CSV file in UTF-8; other columns and blank lines, also above the header, are ignored.

    A line of blank cells, one for each column, is a row. A column of `optional` that the file lacks is blank. Raises
    InputError, with the line, if the file is too large, not UTF-8, not a table or lacks another column.
    """
    text = read_text(path, SIZE_LIMIT_BYTES)
    reader = _reader(text)
    try:
        header = [name.strip() for name in _header(reader)]
        _check_separator(header, columns, path.name)
        rows = [row for row in reader if len(row) == len(header) or not _is_blank(row)]
    except csv.Error as problem:
        raise InputError(f"{path.name}: line {reader.line_num}: {problem}") from None
    if set(map(len, rows)) - {len(header)}:
        ragged, row = next((i, row) for i, row in enumerate(rows) if len(row) != len(header))
        line = _line_of_row(text, ragged)
        raise InputError(f"{path.name}: line {line}: {len(row)} cells, but the header has {len(header)}")
    present = [*columns, *(name for name in optional if name in header)]
    if wrong := _problem_of_header(header, present, set(optional) - set(header)):
        raise InputError(f"{path.name}: {wrong}")
    by_column = list(zip(*rows, strict=True)) or [()] * len(header)
    blank = dict.fromkeys(optional, ("",) * len(rows))
    return Table(path.name, blank | {name: by_column[header.index(name)] for name in present}, text)


def _problem_of_header(header: Sequence[str], needed: Sequence[str], absent: Collection[str]) -> str:
    """Problem of a header line; empty if it has each column that is `needed` once.

    An `absent` column is optional; one that differs only in its capitals is a typing error.
    """
    wanted = ", ".join(needed)
    if not header:
        return f"is empty; expected a line with the names of the columns, {wanted}, and the rows below it"
    if all(map(is_number, header)):
        return f"line 1: has only numbers; put a line with the names of the columns above it: {wanted}"
    for name in needed:
        if header.count(name) > 1:
            return f"line 1: there is more than one column '{name}'; remove one, or give it another name"
        if name not in header:
            meant = nearest(name, header)
            seen = f"if '{meant}' is meant, rename it" if meant else f"the line has {', '.join(header)[:SHOWN]}"
            return f"line 1: there is no column '{name}'; {seen}"
    alike = {name.casefold(): name for name in header if name not in needed}
    slips = sorted((alike[name.casefold()], name) for name in absent if name.casefold() in alike)
    return f"line 1: column '{slips[0][0]}': write '{slips[0][1]}'" if slips else ""


def advice(text: str) -> str:
    """Advice on a text that is not a number, as written by a spreadsheet or a person."""
    if comma := re.fullmatch(r"([+-]?[0-9]*),([0-9]+)", text):
        return f"write {comma[1]}.{comma[2]}"
    plain = text.translate(MINUS_SIGNS).lstrip("'")
    if plain != text and is_number(plain):
        return f"write {plain}"
    if measured := UNIT_BEHIND.fullmatch(plain):
        return f"write the number alone, {measured[1]}, in the unit of the column"
    return "correct it, or leave the cell blank if it is missing"


def read_text(path: Path, limit_bytes: int) -> str:
    """Text of a file in UTF-8, with or without a byte order mark. Raises InputError."""
    try:
        data = read_bounded(path, limit_bytes)
    except UnfitFileError as problem:
        if not problem.size_bytes:
            raise InputError(f"{path}: {problem}") from None
        raise InputError(
            f"{path.name}: larger than {limit_bytes / 2**20:g} MiB; split it, or leave out what is not needed"
        ) from None
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        line = data.count(b"\n", 0, problem.start) + 1
        raise InputError(f"{path.name}: line {line}: not UTF-8; save the file in that encoding") from None


def _reader(text: str) -> Any:  # the standard library does not export the type
    return csv.reader(io.StringIO(text, newline=""), strict=True)


def _header(reader: Any) -> list[str]:
    """First line that is not blank; empty without one."""
    return next((cells for cells in reader if not _is_blank(cells)), [])


def _line_of_row(text: str, row: int) -> int:
    """Line on which a row ends; rows are counted from 0 after the header, without blank ones."""
    reader = _reader(text)
    width = len(_header(reader))
    filled = (reader.line_num for cells in reader if len(cells) == width or not _is_blank(cells))
    return int(next(islice(filled, row, None)))


def _check_separator(header: Sequence[str], columns: Sequence[str], file: str) -> None:
    """Raise InputError if the header has another separator."""
    for separator, name in ((";", "semicolons"), ("\t", "tabs")):
        split = [cell.strip() for cells in header for cell in cells.split(separator)]
        if len(split) > len(header) and sum(column in split for column in columns) > 1:
            raise InputError(
                f"{file}: line 1: the cells are separated by {name}; save the file with commas between cells, and with "
                "points in numbers"
            )


def _is_blank(cells: Sequence[str]) -> bool:
    return not any(map(str.strip, cells))


def _number(text: str) -> float:
    """Parse a number. Raises ValueError, also for an underscore between digits, which Python accepts."""
    if "_" in text:
        raise ValueError(text)
    return float(text.strip() or "nan")


def is_number(text: str) -> bool:
    """True for the text of a number, or a blank."""
    try:
        _number(text)
    except ValueError:
        return False
    return True
