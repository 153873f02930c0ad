"""A channel of a device while a run goes on: its latest readings, and which of its readings are accepted.

An implausible reading (not a number, or impossible for a working sensor) is neither used nor stored as a value.
Two of them in a row, or a value that never changes, are a fault of the sensor.
"""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.analysis.thermometer import JUMP_C, POSSIBLE_C
from bench.config.models import BenchFile
from drivers.values import Reading

Values = NDArray[np.float64]

KEPT_S = 4 * 3600.0
TOO_MANY = 2  # rejected readings in a row
STEEPEST_C_PER_MIN = 60.0  # the sensor in the air of a chamber past an open door; a unit, which is heavier, is slower
CHANGES_WITHIN_S = 3600.0  # by then any thermometer as fine as that shows its noise
FINE_C = 0.02


@dataclass(frozen=True, slots=True)
class Rule:
    """Plausible readings of a working sensor, in the unit of its channel and seconds.

    From one reading to the next it changes at most by `jump` and `steepest_per_s`. It stays at one value for
    at most `changes_within_s`, if it has ever shown a change of at most `fine`: a coarser one may be constant.
    `matters`: a run cannot go on without it.
    """

    low: float = -math.inf
    high: float = math.inf
    jump: float = math.inf
    steepest_per_s: float = 0.0
    changes_within_s: float = math.inf
    fine: float = math.inf
    matters: bool = True


def rule_of(source: str, unit: str, bench: BenchFile) -> Rule:
    """Plausible readings of DEVICE.CHANNEL; for all but measured temperatures only that they are finite.

    A set point may jump, and the read-back of a supply with coarse resolution may be constant.
    A thermometer that the bench file does not name may be unconnected.
    """
    role, _, key = source.partition(".")
    entry = bench.devices[role]
    is_chamber = "thermal_chamber" in entry.description.capabilities
    stated = next((reading for reading in bench.readings.values() if reading.from_ == source), None)
    within_s = stated.changes_within if stated is not None else None
    if unit != "°C" or (is_chamber and key != "process_value"):
        return Rule(changes_within_s=math.inf if within_s is None else within_s)
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
    )


@dataclass(frozen=True, slots=True)
class Doubted:
    """A rejected reading, and why."""

    reading: Reading
    why: str


class Channel:
    """A reading of a device: its latest values, its name on this bench, and its problem, if any.

    `problem` is "" while its sensor works, or a run can go on without it; otherwise the message.
    """

    def __init__(self, name: str, unit: str, rule: Rule) -> None:
        self.name, self.unit = name, unit
        self.newest: Reading | None = None
        self.problem = ""
        self._rule = rule
        self._in_a_row = 0
        self._finest = math.inf  # change that was ever seen
        self._same_since_s = math.inf
        self._at_s, self._values = array("d"), array("d")

    def take(self, readings: Sequence[Reading]) -> tuple[list[Reading], list[Doubted]]:
        """Take in values in the order of their times: all plausible ones, and the first few rejected ones."""
        believed: list[Reading] = []
        doubted: list[Doubted] = []
        for reading in readings:
            if why := self._doubt(reading):
                self._in_a_row += 1
                if self._in_a_row <= TOO_MANY:
                    doubted.append(Doubted(reading, why))
                if self._in_a_row == TOO_MANY:
                    self._fail(f"{why}, and the reading before it was implausible too. Check the sensor")
            else:
                self._believe(reading)
                self._at_s.append(reading.at_s)
                self._values.append(reading.value)
                believed.append(reading)
        if believed:
            self._forget(believed[-1].at_s)
        return believed, doubted

    def last(self, span_s: float) -> Values:
        """The values over the last `span_s` before the newest: (N, 2), time and value."""
        if self.newest is None:
            return np.empty((0, 2))
        begin = bisect_left(self._at_s, self.newest.at_s - span_s - 1e-6)
        return np.array([self._at_s[begin:], self._values[begin:]]).T

    def _doubt(self, reading: Reading) -> str:
        """Why a reading is rejected, to follow the name of the channel; "" if it is accepted."""
        rule, (at_s, value), newest = self._rule, reading, self.newest
        if not math.isfinite(value):
            return "was read as not-a-number"
        if not rule.low <= value <= rule.high:
            return f"was read as {value:.6g} {self.unit}, outside the possible range"
        if newest is None or abs(value - newest.value) <= rule.jump + rule.steepest_per_s * (at_s - newest.at_s):
            return ""
        return (
            f"was read as {value:.6g} {self.unit} {at_s - newest.at_s:.3g} s after {newest.value:.6g} {self.unit}, "
            f"faster than it can change"
        )

    def _believe(self, reading: Reading) -> None:
        """The newest value is this one; a problem that it shows."""
        before, self.newest, self._in_a_row = self.newest, reading, 0
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

    def _fail(self, what: str) -> None:
        if self._rule.matters and not self.problem:
            self.problem = f"{self.name} {what}, its cable, and the instrument that reads it."

    def _forget(self, now_s: float) -> None:
        """Drops what is no longer kept, seldom."""
        if self._at_s[0] < now_s - 2 * KEPT_S:
            passed = bisect_left(self._at_s, now_s - KEPT_S)
            del self._at_s[:passed], self._values[:passed]
