"""Values ⇄ registers, in the formats of a profile; bytes inside a word are always high first."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from drivers.kinds.chamber.words import WordOrder, Words, float32_value, float32_words

ValueType = Literal["int16", "uint16", "int32", "uint32", "float32"]

_CODES = {"int16": "h", "uint16": "H", "int32": "i", "uint32": "I"}
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
        try:
            packed = struct.pack(f">{_CODES[self.type]}", round(value / self.scale))
        except struct.error:
            raise OverflowError(f"{value:g} does not fit {self.type}") from None
        return self._in_order(struct.unpack(f">{self.count}H", packed))

    def value(self, words: Sequence[int]) -> float:
        """Decode the value in registers; ValueError for a float that is not finite."""
        if self.type == "float32":
            return float32_value(words, self.word_order) * self.scale
        packed = struct.pack(f">{self.count}H", *self._in_order(tuple(words)))
        count: int = struct.unpack(f">{_CODES[self.type]}", packed)[0]
        return round(count * self.scale, _DIGITS)

    def _in_order(self, words: Words) -> Words:
        """Words with the high one first, in the order of the controller; or the other way round."""
        return words[::-1] if self.word_order == "low_first" else words
