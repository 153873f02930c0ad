"""Benefit of double reading: inverted bits accepted on serial lines without checksum, with one read and two."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

from campaigns.line_faults.campaign import GRAMMATICAL, play
from campaigns.line_faults.cases import CASES, Link
from drivers.transport.double_read import DoubleRead
from simulators.faults.line_faults import LineFault

UNPROTECTED = [name for name, case in CASES.items() if case.link is Link.NOTHING]


def believed(trials: int, seed: int) -> tuple[int, list[str]]:
    """Number of accepted wrong values among inverted bits on each line, and unexpected outcomes."""
    tallies = [play(name, CASES[name], trials, seed, [LineFault.FLIP]) for name in UNPROTECTED]
    unexpected = [sentence for tally in tallies for sentence in tally.unexpected]
    return sum(tally.outcomes[GRAMMATICAL] for tally in tallies), unexpected


@contextmanager
def one_take() -> Iterator[None]:
    """As if nothing were asked twice."""

    async def first(_self: DoubleRead, _what: str, read: Callable[[], Awaitable[Any]], **_: object) -> Any:
        return await read()

    with patch.object(DoubleRead, "confirmed", first):
        yield
