"""Leases of benches: who works at a bench, as long as there is a sign of life; a restart of the station ends all."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from bench.clock import since_boot_s
from bench.errors import BenchError

LASTS_S = 60.0


class LeasedError(BenchError):
    """Command to a bench that somebody else works at."""

    code = "leased"


class Lease(NamedTuple):
    """Lease of a bench: its holder, a note of the holder, and the time in s until it ends unless it is renewed."""

    holder: str
    note: str
    left_s: float


class Leases:
    """Leases of all benches."""

    def __init__(self, now_s: Callable[[], float] = since_boot_s) -> None:
        self._now_s = now_s
        self._leases: dict[str, tuple[str, str, float]] = {}

    def of(self, bench: str) -> Lease | None:
        """Return the lease of a bench; None if nobody has one."""
        holder, note, until_s = self._leases.get(bench, ("", "", 0.0))
        left_s = until_s - self._now_s()
        return Lease(holder, note, left_s) if left_s > 0 else None

    def expect(self, bench: str | None, person: str) -> None:
        """Raise LeasedError if somebody else has the lease of a bench."""
        found = self.of(bench) if bench is not None else None
        if found is not None and found.holder != person:
            raise LeasedError(
                f"{found.holder} works at bench '{bench}'; ask, or wait for the end of the lease in "
                f"{found.left_s:.0f} s; an engineer can take it over"
            )

    def take(self, bench: str, person: str, note: str = "") -> Lease:
        """Take or renew the lease of a bench. Raises LeasedError if somebody else has it."""
        self.expect(bench, person)
        return self.take_over(bench, person, note)

    def take_over(self, bench: str, person: str, note: str = "") -> Lease:
        """Take the lease of a bench, whoever has it."""
        self._leases[bench] = person, note, self._now_s() + LASTS_S
        return Lease(person, note, LASTS_S)

    def give_back(self, bench: str, person: str) -> None:
        """End the lease of a bench. Raises LeasedError if somebody else has it."""
        self.expect(bench, person)
        self._leases.pop(bench, None)
