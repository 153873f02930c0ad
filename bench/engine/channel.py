"""A channel of a device while a run goes on: its latest readings, and which of its readings are valid.

An implausible reading (not a number, or impossible for a working sensor) is neither used nor stored as a value.
Two of them in a row, or a value that never changes, are a fault of the sensor. One that is stamped in the future, or
not after the one before, is invalid too but proves no fault: adapters without a clock stamp together what has piled
up. Where nothing else comes, the channel becomes stale.
"""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from bench.config.channels import stale_after_s
from bench.config.models import BenchFile
from bench.metrology.temperature_checks import JUMP_C, POSSIBLE_C
from bench.quality import Absent, Fresh, Invalid, Latest, Stale, Valid, Window
from drivers.timing.awake import awake_s
from drivers.values import Reading

KEPT_S = 4 * 3600.0
TOO_MANY = 2  # rejected readings in a row
STEEPEST_C_PER_MIN = 60.0  # sensor in the chamber's air when the door opens; a unit is slower
CHANGES_WITHIN_S = 3600.0  # a thermometer of this resolution has shown its noise by then
FINE_C = 0.02
AHEAD_S = 0.5  # of the clock of the run; instrument times converted to it differ by less
ROUNDING_S = 1e-6  # of times of readings, which are sums


class Rule(NamedTuple):
    """Plausible readings of a working sensor, in the unit of its channel and seconds.

    From one reading to the next it changes at most by `jump` and `steepest_per_s`. It stays at one value for
    at most `changes_within_s`, if it has ever shown a change of at most `fine`: a coarser one may be constant.
    `matters`: a run cannot go on without it. An older reading than `stale_after_s` decides nothing.
    """

    low: float = -math.inf
    high: float = math.inf
    jump: float = math.inf
    steepest_per_s: float = 0.0
    changes_within_s: float = math.inf
    fine: float = math.inf
    matters: bool = True
    stale_after_s: float = math.inf


def rule_of(source: str, unit: str, bench: BenchFile) -> Rule:
    """Plausible readings of DEVICE.CHANNEL; for all but measured temperatures only that they are finite.

    A set point may jump, and the read-back of a supply with coarse resolution may be constant.
    A thermometer that the bench file does not name may be unconnected.
    """
    role, _, key = source.partition(".")
    entry = bench.devices[role]
    is_chamber = "thermal_chamber" in entry.description.capabilities
    stated = next((reading for reading in bench.readings.values() if reading.from_ == source), None)
    within_s, stale_s = stated.changes_within if stated is not None else None, stale_after_s(source, bench)
    if unit != "°C" or (is_chamber and key != "process_value"):
        return Rule(changes_within_s=math.inf if within_s is None else within_s, stale_after_s=stale_s)
    steepest = stated.steepest if stated is not None else None
    limits = [getattr(entry.limits, "temperature", None), stated.limits if stated is not None else None]
    return Rule(
        low=min([POSSIBLE_C[0], *(each.min - JUMP_C for each in limits if each is not None)]),
        high=max([POSSIBLE_C[1], *(each.max + JUMP_C for each in limits if each is not None)]),
        jump=JUMP_C,
        steepest_per_s=(STEEPEST_C_PER_MIN if steepest is None else steepest) / 60,
        changes_within_s=CHANGES_WITHIN_S if within_s is None else within_s,
        fine=FINE_C if within_s is None else math.inf,
        matters=is_chamber or stated is not None,
        stale_after_s=stale_s,
    )


class Channel:
    """A reading of a device: its latest values, its name on this bench, and its problem, if any.

    `problem` is "" while its sensor works, or a run can go on without it; otherwise the message. `invalid` is the
    newest reading if it is so.
    """

    def __init__(self, name: str, unit: str, rule: Rule) -> None:
        self.name, self.unit = name, unit
        self.problem = ""
        self._rule = rule
        self._number = 0
        self._newest: Valid | None = None
        self.invalid: Invalid | None = None  # the newest reading, if it is invalid
        self._in_a_row = 0  # invalid readings
        self._implausible = 0  # of these, those that indicate a fault of the sensor
        self._lost_s = math.inf  # time at which they became too many
        self._finest = math.inf  # smallest change seen so far
        self._same_since_s = math.inf
        self._at_s, self._values = array("d"), array("d")

    def take(self, readings: Sequence[Reading], now_s: float) -> tuple[list[Valid], list[Invalid]]:
        """Add the values read by `now_s`: all valid readings, and the first few invalid ones of each series."""
        valid: list[Valid] = []
        invalid: list[Invalid] = []
        for at_s, value in readings:
            self._number += 1
            untimely = self._untimely(at_s, now_s)
            if why := untimely or self._implausibility(at_s, value):
                self.invalid = Invalid(at_s if math.isfinite(at_s) else now_s, why, self._number, repr(value))
                self._reject(at_s, why, untimely=bool(untimely))
                if self._in_a_row <= TOO_MANY:
                    invalid.append(self.invalid)
            else:
                valid.append(self._accept(Valid(at_s, value, self._number)))
        if valid:
            self._forget(valid[-1].at_s)
        return valid, invalid

    def latest(self, age_of: Callable[[float], float] = awake_s) -> Latest:
        """Return the newest reading with its age if it is valid and not stale, otherwise the reason.

        For display and limits. `age_of` returns the age of an instant on the clock of the run.
        """
        if self._newest is None:
            return self.invalid or Stale("has not been read yet", math.inf)
        age_s = age_of(self._newest.at_s)
        if age_s > self._rule.stale_after_s:
            last = f": the newest one {self.invalid.why}" if self.invalid is not None else ""
            return Stale(f"has had no valid reading for {age_s:.3g} s{last}", age_s)
        return self.invalid or Fresh(self._newest, max(age_s, 0.0))

    def window(self, span_s: float, since_s: float, age_of: Callable[[float], float] = awake_s) -> Window | Absent:
        """Return the readings of the last `span_s` before the newest, none older than `since_s`.

        For decisions over a time. Absent if the newest reading is invalid or stale, or if there was a gap of valid
        readings between two of them.
        """
        latest = self.latest(age_of)
        if not isinstance(latest, Fresh):
            return latest
        newest_s = latest.reading.at_s
        begin = bisect_left(self._at_s, max(newest_s - span_s - ROUNDING_S, since_s))
        at_s = np.array(self._at_s[begin:])
        if not len(at_s):
            return Stale(f"was last read {since_s - newest_s:.3g} s before the step began", latest.age_s)
        if len(at_s) > 1:
            gap = int(np.diff(at_s).argmax())
            gap_s = at_s[gap + 1] - at_s[gap]
            if gap_s > self._rule.stale_after_s:
                gap_s = age_of(float(at_s[gap])) - age_of(float(at_s[gap + 1]))
            if gap_s > self._rule.stale_after_s:
                return Stale(f"has had no valid reading for {gap_s:.3g} s within the time that is judged", latest.age_s)
        return Window(at_s, np.array(self._values[begin:]))

    def _untimely(self, at_s: float, now_s: float) -> str:
        """Return the fault of a reading's time stamp, to follow the name of the channel; "" if it is valid."""
        newest = self._newest
        if newest is not None and newest.at_s < at_s <= now_s:
            return ""
        if not at_s <= now_s + AHEAD_S:
            return f"was read with a time stamp {at_s - now_s:.3g} s in the future"
        if newest is None or at_s > newest.at_s:
            return ""
        if at_s == newest.at_s:
            return "was read with the time stamp of the reading before it"
        return f"was read with a time stamp {newest.at_s - at_s:.3g} s before that of the reading before it"

    def _implausibility(self, at_s: float, value: float) -> str:
        """Return the reason why a value is rejected, to follow the name of the channel; "" if it is accepted."""
        rule, newest = self._rule, self._newest
        if not math.isfinite(value):
            return "was read as not-a-number"
        if not rule.low <= value <= rule.high:
            return f"was read as {value:.6g} {self.unit}, outside the possible range"
        if newest is None or abs(value - newest.value) <= rule.jump:
            return ""
        # A jump stays implausible however long the channel was not read.
        changing_s = min(at_s, self._lost_s) - newest.at_s
        if abs(value - newest.value) <= rule.jump + rule.steepest_per_s * changing_s:
            return ""
        return (
            f"was read as {value:.6g} {self.unit} {at_s - newest.at_s:.3g} s after {newest.value:.6g} {self.unit}, "
            f"faster than it can change"
        )

    def _reject(self, at_s: float, why: str, *, untimely: bool) -> None:
        """Count an invalid reading; return the fault of the sensor, "" if none."""
        self._in_a_row += 1
        if untimely:
            return
        self._implausible += 1
        if self._implausible == TOO_MANY:
            self._lost_s = at_s
            self._fail(f"{why}, and the reading before it was implausible too. Check the sensor")

    def _accept(self, reading: Valid) -> Valid:
        """Store a valid reading as the newest, with the problem it reveals, and return it."""
        before, self._newest = self._newest, reading
        if self.invalid is not None:
            self.invalid, self._in_a_row, self._implausible, self._lost_s = None, 0, 0, math.inf
        self._at_s.append(reading.at_s)
        self._values.append(reading.value)
        if before is None or reading.value != before.value:
            if before is not None:
                self._finest = min(self._finest, abs(reading.value - before.value))
            self._same_since_s = reading.at_s
        elif reading.at_s - self._same_since_s > self._rule.changes_within_s and self._finest <= self._rule.fine:
            self._fail(
                f"has been constant at {reading.value:.6g} {self.unit} for {self._rule.changes_within_s / 60:.3g} min, "
                f"although new readings arrive. If that is normal, set changes_within in the bench file. Check the "
                "sensor"
            )
        return reading

    def _fail(self, what: str) -> None:
        if self._rule.matters and not self.problem:
            self.problem = f"{self.name} {what}, its cable, and the instrument that reads it."

    def _forget(self, now_s: float) -> None:
        """Discard readings that are too old, once in a while."""
        if self._at_s[0] < now_s - 2 * KEPT_S:
            passed = bisect_left(self._at_s, now_s - KEPT_S)
            del self._at_s[:passed], self._values[:passed]
