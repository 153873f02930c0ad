"""One line of the table of trials."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """Result of one kind of trial: its number of trials, the outcome in words, and whether all met the expectation."""

    line: str
    trials: int
    result: str
    ok: bool
