"""What a controller answers when it does not do what it was told."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Refusal:
    """An answer that says no: as it came, and what it means where that is known."""

    answer: str
    meaning: str = ""

    def __str__(self) -> str:
        return f"{self.answer}, {self.meaning}" if self.meaning else self.answer
