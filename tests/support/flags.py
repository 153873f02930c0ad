"""Flags as they are in results."""

from collections.abc import Iterable

from bench.metrology.results.flag import Flag


def texts(flags: Iterable[Flag]) -> tuple[str, ...]:
    """Their forms in results."""
    return tuple(map(str, flags))


def flag_of(flags: Iterable[Flag], text: str) -> Flag:
    """The one of a form in results."""
    (found,) = [flag for flag in flags if str(flag) == text]
    return found
