"""Faults of simulated instruments: what breaks, and from when on."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Literal

OPEN_C = 320.0  # what an open thermometer reads
FaultKind = Literal["silent", "cut", "frozen", "stuck", "restart", "dead", "open_thermometer", "current"]

BROKEN_DRAWS = 3.0  # times its current


class FaultPlan:
    """The faults of one instrument, or of one unit: kind → seconds after the start from which it is active.

    `silent`: requests are carried out or not, but nothing is answered; frames stop. `cut`: the connection is closed.
    `frozen`: measured values (for a counter: its clock, latch sequence and counts) stand still. `stuck`: commands are
    accepted and not carried out. `restart`: once, a counter loses its power for a moment and begins anew. Of a unit
    `silent` stops the frames of its channel and `dead` its pulses; `open_thermometer` opens that at it, and with
    `current` it draws more than it should.
    """

    def __init__(self, starts_s: Mapping[str, float] | None = None, now_s: Callable[[], float] = lambda: 0.0) -> None:
        self._starts_s = dict(starts_s or {})
        self._now_s = now_s

    def active(self, kind: FaultKind) -> bool:
        """Whether a fault is there now."""
        since_s = self._starts_s.get(kind)
        return since_s is not None and self._now_s() >= since_s

    def since_s(self, kind: FaultKind) -> float:
        """When a fault begins; infinite for never."""
        return self._starts_s.get(kind, math.inf)

    def begin(self, kind: FaultKind) -> None:
        """From now on."""
        self._starts_s[kind] = self._now_s()
