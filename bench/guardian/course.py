"""Supervision of one chamber after a run, without I/O: held, commanded to its safe set point, arrived or not."""

from __future__ import annotations

from typing import Literal, NamedTuple

from bench.config.devices import DeviceEntry
from drivers.kinds.chamber.arrival import SET_POINT_TOLERANCE_C, Arrival
from drivers.kinds.chamber.following import FollowWatch
from drivers.values import ChamberState

GONE_S = 600.0  # time without a reading after which supervision ends

Event = Literal[
    "held", "reading", "not_seen", "hold_ends", "commanded", "arrived", "not_arrived", "handed_over", "ended"
]


class Noted(NamedTuple):
    """Entry for the record: temperatures in °C, and the reason `why` if something is wrong.

    `from_safe_c` is the distance of the last command from the safe set point, 0 if the chamber is switched off.
    """

    event: Event
    why: str = ""
    air_c: float | None = None
    set_point_c: float | None = None
    from_safe_c: float | None = None


class Course:
    """State of a chamber after its run, from successful and failed readings; `noted` collects entries for the record.

    A `held` chamber must be commanded to its safe set point once `hold_is_over`, which is the reason. `state` is the
    last successful reading, `why_unseen` the reason why the last one failed, `end` the final entry. Times are in s, of
    any monotonic clock.
    """

    def __init__(self, entry: DeviceEntry, at_s: float, *, held: bool) -> None:
        self._entry, self._seen_s, self._held_c = entry, at_s, float("nan")
        self._arrival = Arrival(entry.safe.temperature, entry.options.follow, entry.limits.temperature)
        self._watch = FollowWatch(entry.options.follow, entry.limits.temperature)
        self.hold_ends_s = at_s + entry.safe.hold if held else at_s
        self.hold_is_over = ""
        self.is_held, self.is_over = held, False
        self.noted: list[Noted] = []
        self.state: ChamberState | None = None
        self.why_unseen = ""
        self.end: Noted | None = None

    @property
    def target_c(self) -> float:
        """Safe set point in °C."""
        return self._arrival.target_c

    def seen(self, at_s: float, state: ChamberState) -> None:
        """Process a successful reading."""
        self._seen_s, self.state, self.why_unseen = at_s, state, ""
        if self.is_held:
            self._seen_held(at_s, state)
        elif problem := self._arrival.problem(at_s, state):
            self._end(Noted("not_arrived", problem, state.process_value_c, state.target_c))
        elif self._arrival.has_arrived(state):
            self._end(Noted("arrived", "", state.process_value_c, state.target_c))

    def unseen(self, at_s: float, why: str, *, in_use: bool = False) -> None:
        """Process a failed reading; a bench that stays `in_use` counts as handed over."""
        self.why_unseen = why
        if self.is_held:
            self.noted.append(Noted("not_seen", why))  # its state meanwhile is not known
        if self.is_held and at_s >= self.hold_ends_s:
            self.hold_is_over = self.hold_is_over or "the hold time has expired"
        if at_s - max(self._seen_s, self.hold_ends_s) <= GONE_S:
            return
        if in_use and not self.is_held:
            self.hand_over(why)
            return
        left = "it is still held, and COULD NOT BE MADE SAFE" if self.is_held else "its air could not be read"
        self._end(Noted("not_arrived", f"{left} for {GONE_S / 60:g} min: {why}"))

    def commanded(self, at_s: float) -> None:
        """Record that the safe set point is in the controller."""
        if self.is_held:
            self.noted.append(Noted("hold_ends", self.hold_is_over))
        self.is_held, self.hold_ends_s, self._seen_s = False, at_s, at_s
        self.noted.append(Noted("commanded", set_point_c=self._arrival.target_c))

    def hand_over(self, why: str) -> None:
        """End supervision because another program has taken the chamber."""
        self._end(Noted("handed_over", why))

    def lock_out(self, why: str) -> None:
        """End supervision because of a lockout; nothing more is commanded."""
        self._end(Noted("not_arrived", f"the bench is {why}"))

    def leave(self, why: str) -> None:
        """End supervision before arrival."""
        self._end(Noted("ended", why))

    def _seen_held(self, at_s: float, state: ChamberState) -> None:
        noted = Noted("held", "", state.process_value_c, state.target_c, state.from_safe_c)
        if self._held_c != self._held_c:  # the first reading
            self._held_c = state.target_c
        else:
            noted = noted._replace(event="reading")
        self.noted.append(noted)
        wrong = self._watch.problem(at_s, state.process_value_c, state.set_point_c, commanded=True)
        if abs(state.target_c - self._held_c) > SET_POINT_TOLERANCE_C:
            wrong = f"another master changed the set point from {self._held_c:g} °C to {state.target_c:g} °C"
        if not wrong and at_s >= self.hold_ends_s:
            wrong = "the hold time has expired"
        self.hold_is_over = self.hold_is_over or wrong

    def _end(self, noted: Noted) -> None:
        self.is_over, self.end = True, noted
        self.noted.append(noted)
