"""Texts of one shape, such as the frames of a server or of a log, read as one table and not one after the other."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from drivers.can.frame_block import FrameBlock

DECIMAL = frozenset({"seconds", "fraction"})  # groups of a shape with decimal digits; all others are hexadecimal

NIBBLES = np.full(256, 255, np.uint8)
for _index, _digit in enumerate(b"0123456789ABCDEF"):
    NIBBLES[_digit] = _index
for _index, _digit in enumerate(b"abcdef", start=10):
    NIBBLES[_digit] = _index


class Portion(NamedTuple):
    """Bytes that arrived between two instants: evenly, as far as is known."""

    since_s: float
    at_s: float
    data: bytes


@dataclass(frozen=True, slots=True)
class Arrivals:
    """Times of arrival of the bytes of a text, by portion; all (C,) and ascending.

    A portion is the bytes up to its end in `ends`, which arrived evenly between its times in `since_s` and `at_s`.
    """

    ends: NDArray[np.int64]
    since_s: NDArray[np.float64]
    at_s: NDArray[np.float64]

    @classmethod
    def at_once(cls, at_s: float) -> Arrivals:
        """All bytes at one time."""
        return cls(np.array([np.iinfo(np.int64).max]), np.array([at_s]), np.array([at_s]))

    @classmethod
    def of(cls, portions: Sequence[Portion], before: int = 0) -> Arrivals:
        """Times of portions, in order; `before` bytes ahead of the first one arrived with it."""
        ends = before + np.cumsum([len(each.data) for each in portions], dtype=np.int64)
        since_s, at_s = np.array([(each.since_s, each.at_s) for each in portions], np.float64).T
        return cls(ends, since_s, at_s)

    def of_bytes(self, places: NDArray[np.intp]) -> NDArray[np.float64]:
        """Times of the bytes at these places."""
        of = np.searchsorted(self.ends, places, side="right")
        left = (self.ends[of] - 1 - places) / np.diff(self.ends, prepend=0)[of]
        return self.at_s[of] - left * (self.at_s - self.since_s)[of]


class Alike(NamedTuple):
    """Rows (N,) of texts that have the shape of the first one of their length, and the digits of each group, (N, n)."""

    rows: NDArray[np.intp]
    digits: Mapping[str, NDArray[np.uint8]]


def alike(
    characters: NDArray[np.uint8], begins: NDArray[np.intp], ends: NDArray[np.intp], shape: re.Pattern[bytes]
) -> Iterator[Alike]:
    """Texts from `begins` to `ends` that match a shape, by length; those that differ from the first one are left out.

    The groups of the shape are numbers, whose digits may differ; everything else is compared.
    """
    lengths = ends - begins
    for length in np.flatnonzero(np.bincount(lengths)).tolist():  # np.unique imports numpy.ma, in 30 ms
        rows = np.flatnonzero(lengths == length)
        texts = sliding_window_view(characters, length)[begins[rows]]
        if form := shape.fullmatch(texts[0].tobytes()):
            yield _as_first(rows, texts, form)


def _as_first(rows: NDArray[np.intp], texts: NDArray[np.uint8], form: re.Match[bytes]) -> Alike:
    fixed, digits = np.ones(texts.shape[1], dtype=bool), {}
    for group in form.re.groupindex:
        begin, end = form.span(group)
        fixed[begin:end] = False
        digits[group] = NIBBLES[texts[:, begin:end]]
    checks = [each < (10 if group in DECIMAL else 16) for group, each in digits.items()]
    checks.append(texts[:, fixed] == texts[0, fixed])
    if all(each.all() for each in checks):  # of all at once: for each row it takes ten times as long
        return Alike(rows, digits)
    good = np.logical_and.reduce([each.all(axis=1) for each in checks])
    return Alike(rows[good], {group: each[good] for group, each in digits.items()})


def number_of(digits: NDArray[np.uint8], base: int) -> NDArray[np.int64]:
    """Numbers (N,) of their digits (N, n); they must fit."""
    numbers: NDArray[np.int64] = digits @ base ** np.arange(digits.shape[1] - 1, -1, -1, dtype=np.int64)
    return numbers


def bytes_of(digits: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Data of frames (N, 8) of their hexadecimal digits (N, n), zero past their end."""
    data = np.zeros((len(digits), 8), np.uint8)
    data[:, : digits.shape[1] // 2] = digits[:, 0::2] << 4 | digits[:, 1::2]
    return data


def in_order(parts: Sequence[tuple[NDArray[np.intp], FrameBlock]]) -> FrameBlock:
    """Frames of several parts, in the order of their rows."""
    if len(parts) == 1:
        return parts[0][1]
    rows = np.concatenate([rows for rows, _ in parts]) if parts else np.empty(0, np.intp)
    return FrameBlock.joined([block for _, block in parts]).at(np.argsort(rows, kind="stable"))
