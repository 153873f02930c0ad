"""Refusals of a controller."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Refusal:
    """A refusal as received, with its meaning if known."""

    answer: str
    meaning: str = ""

    def __str__(self) -> str:
        return f"{self.answer}, {self.meaning}" if self.meaning else self.answer
