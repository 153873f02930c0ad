"""Name and reason that a person gives for an entry of a record."""

from __future__ import annotations

from bench.errors import InputError

LONGEST_REASON, LONGEST_NAME = 500, 100


def check_signed(by: str, reason: str) -> None:
    """Raise InputError if the name or the reason is empty, too long or not printable."""
    _check("--reason", reason, LONGEST_REASON)
    _check("--by", by, LONGEST_NAME)


def _check(option: str, text: str, longest: int) -> None:
    if not text.strip() or not text.isprintable() or len(text) > longest:
        raise InputError(f"{option}: expected up to {longest} printable characters")
