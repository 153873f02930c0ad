"""Faults of simulated instruments, with their times.

A simulator class lists its faults in the mapping FAULT_EFFECTS, kind → FaultEffect. Faults of any line are not in it:
`silent`, `cut`, and the kinds in `LINE_FAULTS`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from simulators.faults.line_faults import LineFault

OPEN_C = 320.0  # reading of an open thermometer
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

BROKEN_DRAWS = 3.0  # factor of its current
LAG_S = 0.7  # delay from acknowledgement to execution with `lag`


def nothing(_instrument: Any) -> None:
    """Do nothing: the simulator checks for the fault itself."""


@dataclass(frozen=True, slots=True)
class FaultEffect:
    """Actions at the begin and at the end of a fault; without an end the state remains."""

    begin: Callable[[Any], object] = nothing
    end: Callable[[Any], object] = nothing


def sets(attribute: str, during: object, after: object) -> FaultEffect:
    """Fault that gives an attribute of the instrument one value, and another one at its end."""
    return FaultEffect(
        lambda victim: setattr(victim, attribute, during), lambda victim: setattr(victim, attribute, after)
    )


PASSIVE_FAULT = FaultEffect()
COMMAND_FAULTS: Mapping[FaultKind, FaultEffect] = {"stuck": PASSIVE_FAULT, "lag": PASSIVE_FAULT}
MEASUREMENT_AND_COMMAND_FAULTS: Mapping[FaultKind, FaultEffect] = {"frozen": PASSIVE_FAULT, **COMMAND_FAULTS}
"""Faults of most instruments: frozen values, and commands that are not executed."""


def fault_effects_of(simulator: type) -> Mapping[FaultKind, FaultEffect]:
    """Faults of the instruments of a class; without FAULT_EFFECTS only those of a line."""
    found: Mapping[FaultKind, FaultEffect] = getattr(simulator, "FAULT_EFFECTS", {})
    return found


class Breakable(Protocol):
    """A simulated instrument, node or unit."""

    @property
    def faults(self) -> FaultPlan:
        """Its faults."""


def begin(victim: Breakable, kind: FaultKind) -> None:
    """Begin a fault."""
    victim.faults.begin(kind)
    fault_effects_of(type(victim)).get(kind, PASSIVE_FAULT).begin(victim)


def end(victim: Breakable, kind: FaultKind) -> None:
    """End a fault."""
    victim.faults.end(kind)
    fault_effects_of(type(victim)).get(kind, PASSIVE_FAULT).end(victim)


class FaultPlan:
    """Faults of one instrument or unit: kind → seconds after the start from which it is active.

    `silent`: requests may be executed, but are not answered; frames stop. `cut`: the connection is closed. `frozen`:
    measured values (of a counter: its clock, latch sequence and counts) do not change. `stuck`: commands are accepted
    and not executed. `lag`: they are accepted, and executed LAG_S later. `restart`: once, a short power failure. Of a
    unit `silent` stops the frames of its channel and `dead` its pulses; `open_thermometer` opens its thermometer,
    `current` makes it draw too much, and `detached_thermometer` puts its thermometer into the room. The others are
    described in docs/how-to/rehearse_a_bad_night.md.

    A device that sends frames may have the bus faults of `simulators.faults.frame_faults`, occasional `error_frames`,
    or a bus-off: one error frame reports it, and then no frame follows. The first channel of a counter may stop
    counting (`stuck_count`), or all its counts are cleared once (`cleared_count`).
    """

    def __init__(self, starts_s: Mapping[str, float] | None = None, now_s: Callable[[], float] = lambda: 0.0) -> None:
        self._spans_s = {kind: [(start_s, math.inf)] for kind, start_s in (starts_s or {}).items()}
        self._now_s = now_s
        self._late: deque[tuple[float, Callable[[], object], tuple[type[Exception], ...]]] = deque()

    def active(self, kind: FaultKind) -> bool:
        """Return whether a fault is active."""
        if kind not in self._spans_s:
            return False
        now_s = self._now_s()
        return any(start_s <= now_s < end_s for start_s, end_s in self._spans_s[kind])

    def spans_s(self, kind: FaultKind) -> list[tuple[float, float]]:
        """Past and future intervals of a fault: from, to; infinite without an end."""
        return self._spans_s.get(kind, [])

    def since_s(self, kind: FaultKind) -> float:
        """Time of the last begin of a fault, also a future one; infinite for never."""
        return max((start_s for start_s, _ in self.spans_s(kind)), default=math.inf)

    def times(self, kind: FaultKind) -> int:
        """Number of times a fault has begun."""
        return sum(start_s <= self._now_s() for start_s, _ in self.spans_s(kind))

    def begin(self, kind: FaultKind) -> None:
        """Begin a fault now."""
        self._spans_s.setdefault(kind, []).append((self._now_s(), math.inf))

    def end(self, kind: FaultKind) -> None:
        """End a fault now: the longest active one of its kind."""
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
        """The same for a command that is never stuck."""
        if self.active("lag"):
            self._late.append((self._now_s() + LAG_S, setting, refusals))
        else:
            setting()

    def catch_up(self) -> None:
        """Execute commands that are due; called before every access to an instrument."""
        while self._late and self._late[0][0] <= self._now_s():
            _, setting, refusals = self._late.popleft()
            with suppress(*refusals):
                setting()

    def on_the_line(self) -> LineFault | None:
        """Present fault of the answers."""
        return next((fault for kind, fault in LINE_FAULTS.items() if self.active(kind)), None)
