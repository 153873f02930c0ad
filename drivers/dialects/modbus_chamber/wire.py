"""Values ⇄ registers, in the formats of a profile; bytes inside a word are always high first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from drivers.kinds.chamber.words import WordOrder, Words, float32_value, float32_words

ValueType = Literal["int16", "uint16", "int32", "uint32", "float32"]

_BOUNDS = {
    "int16": (-(1 << 15), (1 << 15) - 1),
    "uint16": (0, (1 << 16) - 1),
    "int32": (-(1 << 31), (1 << 31) - 1),
    "uint32": (0, (1 << 32) - 1),
}
_DIGITS = 9  # decimals; the rounding residue of a scale beyond them is dropped


@dataclass(frozen=True, slots=True)
class ValueFormat:
    """Format of one value; `scale` is the value of one count, `word_order` that of two registers."""

    type: ValueType = "int16"
    scale: float = 1.0
    word_order: WordOrder = "high_first"

    @property
    def count(self) -> int:
        """Number of registers."""
        return 1 if self.type in ("int16", "uint16") else 2

    def words(self, value: float) -> Words:
        """Encode a value into registers, rounded to whole counts; OverflowError if it does not fit."""
        if self.type == "float32":
            return float32_words(value / self.scale, self.word_order)
        count = round(value / self.scale)
        low, high = _BOUNDS[self.type]
        if not low <= count <= high:
            raise OverflowError(f"{value:g} does not fit {self.type}")
        if self.count == 1:
            return (count & 0xFFFF,)
        upper, lower = count >> 16 & 0xFFFF, count & 0xFFFF
        return (lower, upper) if self.word_order == "low_first" else (upper, lower)

    def value(self, words: Sequence[int]) -> float:
        """Decode the value in registers; ValueError for a float that is not finite."""
        if self.type == "float32":
            return float32_value(words, self.word_order) * self.scale
        high_first = words[::-1] if self.word_order == "low_first" else words
        count = 0
        for word in high_first:
            count = count << 16 | word
        if count > _BOUNDS[self.type][1]:
            count -= 1 << 16 * self.count
        return round(count * self.scale, _DIGITS)
