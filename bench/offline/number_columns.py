"""Columns of numbers of a CSV file with millions of rows."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from bench.errors import InputError
from bench.offline.csv_record import advice, is_number
from drivers.schema.bounded import UnfitFileError, expect_bounded

BLOCK_CHARACTERS = 2**24  # read at once
LIMIT_BYTES = 4 * 2**30
BLANK = re.compile(r"(?<=,)[ \t]*(?=,|$)|^[ \t]*(?=,)", re.MULTILINE)
Array = NDArray[np.float64]


def read_header(path: Path) -> list[str]:
    """Names of the columns of a file, from its first line. Raises InputError."""
    with _opened(path) as file:
        header = [name.strip() for name in next(csv.reader([file.readline()]), [])]
    if not any(header) or all(map(is_number, header)):
        raise InputError(f"{path.name}: line 1: has no names of columns, such as t_s,T_C and those of the channels")
    for name in header:
        if header.count(name) > 1:
            raise InputError(f"{path.name}: line 1: there is more than one column '{name}'; rename one")
    return header


def read_numbers(path: Path, names: Sequence[str]) -> Array:
    """Columns `names` (n, c) of a file with these and others in its header; NaN for blanks.

    Raises InputError with the line and the column of a cell that is no number.
    """
    header = read_header(path)
    columns = [header.index(name) for name in names]
    with _opened(path) as file:
        file.readline()
        blocks = [_parsed(path, lines, before, header, columns) for before, lines in _blocks(path, file)]
    return np.concatenate(blocks) if blocks else np.empty((0, len(names)))


def _opened(path: Path) -> TextIO:
    try:
        expect_bounded(path, LIMIT_BYTES)
        return path.open(encoding="utf-8-sig", newline=None)
    except UnfitFileError as problem:
        raise InputError(f"{path}: {problem}") from None
    except OSError as problem:
        raise InputError(f"{path}: cannot be read ({problem.strerror})") from None


def _blocks(path: Path, file: TextIO) -> Iterator[tuple[int, list[str]]]:
    """Blocks of lines, each with the number of lines before it."""
    before = 1
    try:
        while lines := file.readlines(BLOCK_CHARACTERS):
            yield before, lines
            before += len(lines)
    except UnicodeDecodeError:
        raise InputError(f"{path.name}: after line {before}: not UTF-8; save the file in that encoding") from None


def _parsed(path: Path, lines: list[str], before: int, header: list[str], columns: list[int]) -> Array:
    """Numbers of a block (n, c)."""
    text = "".join(lines)
    if BLANK.search(text):
        text = BLANK.sub("nan", text)
    if not text.strip():
        return np.empty((0, len(columns)))
    try:
        return np.loadtxt(io.StringIO(text), delimiter=",", usecols=columns, ndmin=2, comments=None, quotechar='"')
    except ValueError as problem:
        _refuse(path, lines, before, header, columns)
        raise InputError(f"{path.name}: after line {before}: {problem}") from None


def _refuse(path: Path, lines: list[str], before: int, header: list[str], columns: list[int]) -> None:
    """Raise InputError for the first bad cell of a block that could not be parsed."""
    for number, cells in enumerate(csv.reader(lines), before + 1):
        if any(cell.strip() for cell in cells) and len(cells) != len(header):
            raise InputError(f"{path.name}: line {number}: {len(cells)} cells, but the header has {len(header)}")
        for column in columns if cells else ():
            text = cells[column].strip()
            if text and not is_number(text):
                raise InputError(
                    f"{path.name}: line {number}, column {header[column]}: '{text[:40]}' is not a number; "
                    f"{advice(text[:40])}"
                )
