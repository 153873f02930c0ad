"""Faults of simulated instruments: what breaks, from when on, and until when.

A simulator names what can happen to it in one way: the mapping MISHAPS of its class, kind → Mishap. What any line can
do to an instrument is not in it: `silent`, `cut`, and the kinds in `LINE_FAULTS`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from simulators.faults.line_faults import LineFault

OPEN_C = 320.0  # what an open thermometer reads
FaultKind = Literal[
    "silent", "cut", "delay", "late", "duplicate", "garbage", "cut_short", "split", "flip", "echo", "half_open",
    "slow_close", "frozen", "stuck", "lag", "restart", "door_open", "emergency_stop", "front_panel", "program",
    "interlock", "compliance", "tripped", "alarm", "open_sensor", "dead", "open_thermometer", "current",
    "lost_frames", "lost_bursts", "doubled_frames", "late_frames", "foreign_frames", "short_frames", "swapped_frames",
    "error_frames", "bus_off", "stuck_count", "cleared_count",
    "heater_dead", "cooling_dead", "runaway", "detached_sensor", "slow",
    "detached_thermometer",
]  # fmt: skip
LINE_FAULTS: Mapping[FaultKind, LineFault] = {
    "delay": LineFault.DELAY, "late": LineFault.LATE, "duplicate": LineFault.DUPLICATE, "garbage": LineFault.GARBAGE,
    "cut_short": LineFault.CUT, "split": LineFault.SPLIT, "flip": LineFault.FLIP, "echo": LineFault.ECHO,
    "half_open": LineFault.HALF_OPEN, "slow_close": LineFault.SLOW_CLOSE,
}  # fmt: skip

BROKEN_DRAWS = 3.0  # times its current
LAG_S = 0.7  # between what an instrument acknowledges and what it does, where it lags


def nothing(_instrument: Any) -> None:
    """No action: the simulator checks for the fault itself."""


@dataclass(frozen=True, slots=True)
class Mishap:
    """What happens to an instrument when a fault begins and when it ends; without an end it stays as it then is."""

    begin: Callable[[Any], object] = nothing
    end: Callable[[Any], object] = nothing


LOOKED_FOR = Mishap()
OBEYS: Mapping[FaultKind, Mishap] = {"stuck": LOOKED_FOR, "lag": LOOKED_FOR}
MEASURES_AND_OBEYS: Mapping[FaultKind, Mishap] = {"frozen": LOOKED_FOR, **OBEYS}
"""What can happen to most instruments: values that stand still, commands that are not carried out."""


def mishaps_of(simulator: type) -> Mapping[FaultKind, Mishap]:
    """What can happen to the instruments of a class; one that names nothing can only be on a bad line."""
    found: Mapping[FaultKind, Mishap] = getattr(simulator, "MISHAPS", {})
    return found


class Breakable(Protocol):
    """A simulated instrument, node or unit."""

    @property
    def faults(self) -> FaultPlan:
        """How it breaks."""


def begin(victim: Breakable, kind: FaultKind) -> None:
    """A fault happens to it from now on."""
    victim.faults.begin(kind)
    mishaps_of(type(victim)).get(kind, LOOKED_FOR).begin(victim)


def end(victim: Breakable, kind: FaultKind) -> None:
    """The fault is over."""
    victim.faults.end(kind)
    mishaps_of(type(victim)).get(kind, LOOKED_FOR).end(victim)


class FaultPlan:
    """The faults of one instrument, or of one unit: kind → seconds after the start from which it is active.

    `silent`: requests are carried out or not, but nothing is answered; frames stop. `cut`: the connection is closed.
    `frozen`: measured values (for a counter: its clock, latch sequence and counts) stand still. `stuck`: commands are
    accepted and not carried out. `lag`: they are accepted, and carried out LAG_S later. `restart`: once, an instrument
    loses its power for a moment and begins anew. Of a unit `silent` stops the frames of its channel and `dead` its
    pulses; `open_thermometer` opens that at it, and with `current` it draws more than it should; `detached_thermometer`
    is one that lies in the room. The others are told in docs/how-to/rehearse_a_bad_night.md.

    Of what sends frames the bus is bad as in `simulators.faults.frame_faults`, has `error_frames` now and then, or is
    off: one error frame says so, and then nothing comes. Of a counter the first channel's counts stand
    (`stuck_count`), or all counts are cleared, once, and nothing else (`cleared_count`).
    """

    def __init__(self, starts_s: Mapping[str, float] | None = None, now_s: Callable[[], float] = lambda: 0.0) -> None:
        self._spans_s = {kind: [(start_s, math.inf)] for kind, start_s in (starts_s or {}).items()}
        self._now_s = now_s
        self._late: deque[tuple[float, Callable[[], object], tuple[type[Exception], ...]]] = deque()

    def active(self, kind: FaultKind) -> bool:
        """Whether a fault is there now."""
        if kind not in self._spans_s:
            return False
        now_s = self._now_s()
        return any(start_s <= now_s < end_s for start_s, end_s in self._spans_s[kind])

    def spans_s(self, kind: FaultKind) -> list[tuple[float, float]]:
        """When a fault was there so far, and will be: from, to; infinite for no end."""
        return self._spans_s.get(kind, [])

    def since_s(self, kind: FaultKind) -> float:
        """When a fault has begun, or will, the last time; infinite for never."""
        return max((start_s for start_s, _ in self.spans_s(kind)), default=math.inf)

    def times(self, kind: FaultKind) -> int:
        """How often a fault has begun."""
        return sum(start_s <= self._now_s() for start_s, _ in self.spans_s(kind))

    def begin(self, kind: FaultKind) -> None:
        """From now on."""
        self._spans_s.setdefault(kind, []).append((self._now_s(), math.inf))

    def end(self, kind: FaultKind) -> None:
        """Until now, that one of the kind which has lasted longest."""
        spans_s = self.spans_s(kind)
        index = next((i for i, (_, end_s) in enumerate(spans_s) if end_s == math.inf), None)
        if index is not None:
            spans_s[index] = (spans_s[index][0], self._now_s())

    def carry_out(self, setting: Callable[[], object], *refusals: type[Exception]) -> None:
        """Execute a command of an instrument: at once, delayed with `lag`, never with `stuck`.

        A delayed refusal (one of `refusals`) is not reported.
        """
        if not self.active("stuck"):
            self.do(setting, *refusals)

    def do(self, setting: Callable[[], object], *refusals: type[Exception]) -> None:
        """The same of what is never stuck."""
        if self.active("lag"):
            self._late.append((self._now_s() + LAG_S, setting, refusals))
        else:
            setting()

    def catch_up(self) -> None:
        """Does what was to be done by now; an instrument is looked at after it."""
        while self._late and self._late[0][0] <= self._now_s():
            _, setting, refusals = self._late.popleft()
            with suppress(*refusals):
                setting()

    def on_the_line(self) -> LineFault | None:
        """What happens to the answers now."""
        return next((fault for kind, fault in LINE_FAULTS.items() if self.active(kind)), None)
