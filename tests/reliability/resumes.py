"""Runs that are killed in virtual time and resumed."""

from __future__ import annotations

import random
import tempfile
from pathlib import Path

from tests.trials.resume import RUNS, killed


def once(number: int) -> str:
    """Killed at any moment."""
    return _played(number, random.Random(f"once {number}"), again=False)


def twice(number: int) -> str:
    """Killed again while the world is rebuilt, or after that."""
    return _played(number, random.Random(f"twice {number}"), again=True)


def _played(number: int, draw: random.Random, *, again: bool) -> str:
    sequence, share = list(RUNS)[number % len(RUNS)], draw.random()
    with tempfile.TemporaryDirectory() as folder:
        found = killed(Path(folder), sequence, share, draw.random() if again else None)
    return f"{sequence} at {share:.4f}: {found}" if found else ""
