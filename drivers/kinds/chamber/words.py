"""Numbers ⇄ the 16-bit words of registers; bytes inside a word are always high first."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from typing import Literal

Words = tuple[int, ...]
WordOrder = Literal["low_first", "high_first"]
COLDEST_C, HOTTEST_C = -273.15, 2000.0  # a value beyond them is no temperature


def float32_words(value: float, order: WordOrder) -> Words:
    """Encode a float32 into two words; OverflowError if it does not fit."""
    high, low = struct.unpack(">HH", struct.pack(">f", value))
    return (low, high) if order == "low_first" else (high, low)


def float32_value(words: Sequence[int], order: WordOrder) -> float:
    """Decode the float32 in two words; ValueError unless it is finite."""
    first, second = words
    high, low = (second, first) if order == "low_first" else (first, second)
    value: float = struct.unpack(">f", struct.pack(">HH", high, low))[0]
    if not math.isfinite(value):
        raise ValueError(f"{value} is not a finite number")
    return value


def int16_word(value: int) -> int:
    """Encode a signed integer into a word; OverflowError if it does not fit."""
    if not -0x8000 <= value <= 0x7FFF:
        raise OverflowError(f"{value} does not fit a signed word")
    return value & 0xFFFF


def int16_value(word: int) -> int:
    """Decode a word as a signed integer."""
    return word - 0x10000 if word & 0x8000 else word
