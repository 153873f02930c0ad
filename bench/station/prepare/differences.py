"""Differences of texts, line by line, as `diff -u` writes them."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping


def difference(old: str, new: str, old_title: str, new_title: str, around: int = 3) -> list[str]:
    """Return the lines that differ, with some lines around them; [] if none do."""
    return list(difflib.unified_diff(old.splitlines(), new.splitlines(), old_title, new_title, lineterm="", n=around))


def difference_of(
    title: str, old: Mapping[str, str] | None, new: Mapping[str, str], around: int = 1,
    titles: tuple[str, str] = ("released", "now"),
) -> Iterator[str]:  # fmt: skip
    """Yield the lines that differ between two versions of files, with some lines around them."""
    for name in sorted({*(old or {}), *new}):
        old_title, new_title = (f"{title}: {name}, {each}" for each in titles)
        yield from difference((old or {}).get(name, ""), new.get(name, ""), old_title, new_title, around)
