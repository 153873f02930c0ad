"""Suggestion of the nearest known name for a misspelt one."""

from __future__ import annotations

import functools
from collections.abc import Iterable


def nearest(name: str, known: Iterable[str]) -> str | None:
    """Nearest known name; case is ignored, so that `k0` matches K0."""
    return _nearest(name, tuple(known))


_LOOKS_LIKE = str.maketrans("oil", "011")  # letters mistaken for digits, such as KO for K0


@functools.lru_cache(maxsize=1024)
def _nearest(name: str, known: tuple[str, ...]) -> str | None:
    import difflib  # here, because most files have no unknown name

    alike = {known_name.casefold().translate(_LOOKS_LIKE): known_name for known_name in known}
    if same := alike.get(name.casefold().translate(_LOOKS_LIKE)):
        return same
    spelled = {known_name.casefold(): known_name for known_name in known}
    close = difflib.get_close_matches(name.casefold(), spelled, n=1, cutoff=0.6)
    return spelled[close[0]] if close else None


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Tail of an error message: "; did you mean 'x'?", or the list of known names."""
    names = list(dict.fromkeys(known))
    if close := nearest(name, names):
        return f"; did you mean '{close}'?"
    if not names:
        return "; none is known here"
    return "; expected " + (names[0] if len(names) == 1 else ", ".join(names[:-1]) + f" or {names[-1]}")
