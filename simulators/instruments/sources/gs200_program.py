"""Program of a simulated GS200: successive levels, each with a slope and an interval.

Commands are those sent by the drivers of PyMeasure and QCoDeS to ramp a level. A level set while a program is edited
becomes a step of it (user's manual, page 13-12). Event bits are those of QCoDeS.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import IntFlag

from simulators.instruments.scpi import SETTINGS_CONFLICT, Handler, Refusal
from simulators.instruments.stored_settings import StoredSettings, stored_number, stored_switch

_INTERVAL_S, _SLOPE_S, _REPEAT = "PROGram:INTerval", "PROGram:SLOPe", "PROGram:REPeat"
_STORED = {
    _INTERVAL_S: stored_number(1.0, 0.1, 3600.0, lambda seconds: f"{seconds:.1f}"),
    _SLOPE_S: stored_number(0.0, 0.0, 3600.0, lambda seconds: f"{seconds:.1f}"),
    _REPEAT: stored_switch("0"),
    "PROGram:COUNt": stored_number(1, 1, 10_000, lambda step: str(round(step))),
}


class Event(IntFlag):
    """Bits of the extended event register set by a program."""

    END_OF_STEP = 1 << 6
    END_OF_PROGRAM = 1 << 7


class Program:
    """One program; `begins` returns the level from which it begins, and raises Refusal if it cannot."""

    def __init__(self, now_s: Callable[[], float], begins: Callable[[], float]) -> None:
        self._now_s, self._begins = now_s, begins
        self._stored = StoredSettings(_STORED)
        self.reset()

    def reset(self) -> None:
        """Clear the program."""
        self._stored.reset()
        self.edited = False
        self._steps: list[float] = []
        self._from, self._begun_s = 0.0, math.nan
        self._events = Event(0)

    def commands(self) -> dict[str, Handler]:
        """Handlers to edit, run and end it, by header."""
        return {
            **self._stored.commands(),
            "PROGram:LOAD?": lambda _: '""',  # no file in its memory
            "PROGram:EDIT:STARt": lambda _: self._edit(),
            "PROGram:EDIT:END": lambda _: self._end_editing(),
            "PROGram:RUN": lambda _: self._run(),
        }

    def add(self, level: float) -> None:
        """Add a level while the program is edited."""
        self._steps.append(level)

    def end(self) -> None:
        """End the program."""
        self._begun_s = math.nan

    @property
    def level(self) -> float | None:
        """Present level, None if it does not run; one without repetition stays at its last level."""
        since_s = self._now_s() - self._begun_s
        if math.isnan(since_s):
            return None
        interval_s = float(self._stored[_INTERVAL_S])
        step = math.floor(since_s / interval_s)
        if step >= len(self._steps) and self._stored[_REPEAT] == "0":
            return self._steps[-1]
        before = self._steps[(step - 1) % len(self._steps)] if step else self._from
        slope_s = min(float(self._stored[_SLOPE_S]), interval_s)
        passed = min((since_s - step * interval_s) / slope_s, 1.0) if slope_s else 1.0
        return before + passed * (self._steps[step % len(self._steps)] - before)

    def take_events(self) -> Event:
        """Events since the last query."""
        since_s = self._now_s() - self._begun_s
        steps = 0 if math.isnan(since_s) else math.floor(since_s / float(self._stored[_INTERVAL_S]))
        happened = Event.END_OF_STEP if steps else Event(0)
        if steps >= len(self._steps) > 0:
            happened |= Event.END_OF_PROGRAM
        new, self._events = happened & ~self._events, happened
        return new

    def _edit(self) -> None:
        self.edited, self._steps = True, []

    def _end_editing(self) -> None:
        self.edited = False

    def _run(self) -> None:
        if self.edited or not self._steps:
            raise Refusal(SETTINGS_CONFLICT)
        self._from, self._begun_s, self._events = self._begins(), self._now_s(), Event(0)
