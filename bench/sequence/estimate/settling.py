"""Time for a unit to reach the temperature of its chamber, estimated from the bench file.

The air follows the set point by `simulation.chamber`, a unit the air by `places.*.nominal`, and its thermometer the
unit by `simulation.thermometer`; without these entries the defaults apply.
"""

from __future__ import annotations

import cmath
import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

from bench.config.models import BenchFile
from bench.config.places import Nominal, PlaceEntry
from bench.sequence.estimate.lags import Poles, after_its_end, followed, gain, lag_poles, loop_poles, over_after_s
from bench.sequence.language.readings import unit_of
from bench.sequence.steps.fields import is_known
from bench.sequence.steps.waits import LOOK_EVERY_S, WINDOW_COVERAGE, Soak, Stable, WaitUntil
from drivers.quantity.quantities import Quantity

PEAK_TO_PEAK_SD = 6.0  # peak-to-peak noise over a soak, in standard deviations
SAMPLES_OF_A_HOLD = 200  # samples of a window at most; a longer hold time is sampled more coarsely than in the run


@cache
def _usual_unit() -> Nominal:
    """Unit that a bench file does not describe; only its thermal properties are used."""
    return Nominal.model_validate({"K1": "1 A/g"})


class _Reading(NamedTuple):
    """Response of a temperature to the set point, and the supply of the unit at which it is measured.

    `restless_c` is its peak-to-peak noise in the settled state.
    """

    behind_set_point: Poles
    behind_heating: Poles = ()
    supply: str = ""
    heating_c: float = 0.0
    restless_c: float = 0.0


class _Change(NamedTuple):
    """Linear change of the set point by `by` (°C), or with a supply start (1) or end (-1) of self-heating."""

    at_s: float
    by: float
    duration_s: float = 0.0
    supply: str = ""


@dataclass(frozen=True)
class _Course:
    """A predicted temperature: its final value, and the changes it still follows."""

    still_c: float
    moving: tuple[tuple[float, Poles, float, float], ...]  # (amount, poles, start, duration)

    @property
    def over_s(self) -> float:
        """Time after which nothing changes any more."""
        return max((at_s + over_after_s(poles, over_s) for _, poles, at_s, over_s in self.moving), default=0.0)

    def temperature_c(self, now_s: float) -> float:
        """Temperature at a time."""
        if now_s >= self._ended_s:
            since_s = now_s - self._ended_s
            return self._end_c + sum([(part_c * cmath.exp(pole * since_s)).real for pole, part_c in self._parts])
        return self.still_c + math.fsum(
            by_c * followed(poles, now_s - at_s, over) for by_c, poles, at_s, over in self.moving
        )

    @cached_property
    def _ended_s(self) -> float:
        return max((at_s + over_s for _, _, at_s, over_s in self.moving), default=-math.inf)

    @cached_property
    def _end_c(self) -> float:
        return self.still_c + math.fsum(by_c for by_c, *_ in self.moving)

    @cached_property
    def _parts(self) -> list[tuple[complex, complex]]:
        """Exponentials whose sum is the remainder of all changes after the last has ended."""
        parts: dict[complex, complex] = {}
        for by_c, poles, at_s, over_s in self.moving:
            for pole, weight in after_its_end(poles, over_s):
                since_s = self._ended_s - at_s - over_s
                parts[pole] = parts.get(pole, 0.0) + by_c * weight * cmath.exp(pole * since_s)
        return list(parts.items())


class Settling:
    """Temperature changes so far, and the settling time of units after them; a copy continues independently."""

    def __init__(self, bench: BenchFile) -> None:
        self._bench = bench
        self._changes: tuple[_Change, ...] = ()
        self._powered: frozenset[str] = frozenset()
        self._reading = cache(self._reading_on_bench)  # soaks of a loop look at the same readings

    def ramp(self, from_c: float, to_c: float, at_s: float, duration_s: float) -> None:
        """Add a linear change of the set point."""
        if to_c != from_c:
            self._changes += (_Change(at_s, to_c - from_c, duration_s),)

    def power(self, supply: str, on: bool, at_s: float) -> None:
        """Add the switching of a supply, which heats the units on it."""
        for member in self._bench.members(supply):
            if on != (member in self._powered):
                self._powered ^= {member}
                self._changes += (_Change(at_s, 1.0 if on else -1.0, supply=member),)

    def soak_s(self, step: Soak, at_s: float) -> float:
        """Duration of a soak that begins at `at_s`; its maximum if an earlier end is not known."""
        return max(self._soak_s(step, name, at_s) for name in self._bench.members(step.role))

    def _soak_s(self, step: Soak, name: str, at_s: float) -> float:
        reading, stable = self._reading(name), step.until_stable
        if stable is None or reading is None or step.give_up_after_s is None:
            return step.least_s
        if math.isnan(stable.band_c + stable.slope_c_per_h + stable.hold_s + step.at_least_s + step.give_up_after_s):
            return step.least_s  # only a measurement decides
        longest_s = max(step.give_up_after_s, step.at_least_s)
        every_s = max(LOOK_EVERY_S, stable.hold_s / SAMPLES_OF_A_HOLD)
        count = max(round(stable.hold_s / every_s), 2)
        first_s = at_s + step.at_least_s
        course = self._course(reading, first_s - count * every_s)
        last_s = min(at_s + longest_s, max(first_s, course.over_s) + stable.hold_s)
        window: deque[float] = deque(maxlen=count + 1)
        for look in range(-count, math.ceil((last_s - first_s) / every_s) + 1):
            now_s = first_s + look * every_s
            window.append(course.temperature_c(now_s))
            is_covered = now_s >= WINDOW_COVERAGE * stable.hold_s  # readings begin with the run
            if look >= 0 and is_covered and _is_stable(window, every_s, stable, reading.restless_c):
                return now_s - at_s
        return longest_s

    def wait_s(self, step: WaitUntil, at_s: float) -> float:
        """Time for a temperature to fulfil a condition; the maximum if it is not known to.

        A reading in s is assumed to count from the beginning of the run. For others only the hold time is known.
        """
        return max(self._wait_s(step, name, at_s) for name in self._bench.members(step.reading))

    def _wait_s(self, step: WaitUntil, name: str, at_s: float) -> float:
        if step.above is not None and is_known(step.above) and unit_of(name, self._bench) == "s":
            return max(step.least_s, step.above.to("s") - at_s)
        reading, bounds = self._reading(name), [each for each in (step.above, step.below) if each is not None]
        if reading is None or not all(map(is_known, bounds)) or math.isnan(step.hold_s + step.give_up_after_s):
            return step.least_s
        low_c, high_c = _celsius(step.above, -math.inf), _celsius(step.below, math.inf)
        needed_s = math.ceil(WINDOW_COVERAGE * step.hold_s / LOOK_EVERY_S) * LOOK_EVERY_S
        course = self._course(reading, at_s)
        begun_s: float | None = None  # start of the time for which the condition holds
        for look in range(math.ceil((min(step.give_up_after_s, max(course.over_s - at_s, 0.0))) / LOOK_EVERY_S) + 1):
            waited_s = look * LOOK_EVERY_S
            is_so = low_c < course.temperature_c(at_s + waited_s) < high_c
            begun_s = (waited_s if begun_s is None else begun_s) if is_so else None
            if begun_s is not None and waited_s - begun_s >= needed_s:
                return waited_s
        return min(begun_s + needed_s, step.give_up_after_s) if begun_s is not None else step.give_up_after_s

    def _course(self, reading: _Reading, from_s: float) -> _Course:
        """Predicted temperature of a reading from `from_s` on."""
        still_c, moving = self._bench.simulation.chamber.start, []
        for change in self._changes:
            if change.supply not in ("", reading.supply):
                continue
            poles = reading.behind_heating if change.supply else reading.behind_set_point
            by_c = change.by * (reading.heating_c if change.supply else 1.0)
            if change.at_s + over_after_s(poles, change.duration_s) < from_s:
                still_c += by_c
            else:
                moving.append((by_c, poles, change.at_s, change.duration_s))
        return _Course(still_c, tuple(moving))

    def _reading_on_bench(self, name: str) -> _Reading | None:
        """Model of a temperature of the air or of units; None for any other reading."""
        bench, chamber = self._bench, self._bench.simulation.chamber
        if unit_of(name, bench) != "°C":
            return None
        air = loop_poles(chamber.natural_period, chamber.damping)
        swing_c = 2 * math.sqrt(2) * chamber.limit_cycle  # peak to peak
        thermometer = bench.simulation.thermometer
        noise_c = PEAK_TO_PEAK_SD * thermometer.noise
        place = next(self._places_at(name), None)
        if place is not None:
            unit = place.nominal or _usual_unit()
            lags = lag_poles((*unit.time_constants, thermometer.lag))
            restless_c = swing_c * gain(lags, chamber.limit_cycle_period) + noise_c
            return _Reading((*air, *lags), lags, place.supply, unit.self_heating, restless_c)
        converter = next(self._converters_at(name), None)
        if converter is not None:
            lags = lag_poles(((converter.nominal or _usual_unit()).converter_time_constant, thermometer.lag))
            restless_c = swing_c * gain(lags, chamber.limit_cycle_period) + noise_c
            return _Reading((*air, *lags), restless_c=restless_c)
        device = bench.devices[self._source(name).partition(".")[0]]
        return _Reading(air, restless_c=swing_c) if "thermal_chamber" in device.description.capabilities else None

    def _places_at(self, name: str) -> Iterator[PlaceEntry]:
        source = self._source(name)
        return (
            place
            for place in self._bench.places.values()
            if source in map(self._source, (place.temperature, *place.at_sensors.values()))
        )

    def _converters_at(self, name: str) -> Iterator[PlaceEntry]:
        source = self._source(name)
        return (
            place
            for place in self._bench.places.values()
            if place.converter_temperature and self._source(place.converter_temperature) == source
        )

    def _source(self, name: str) -> str:
        return self._bench.readings[name].from_ if name in self._bench.readings else name


def _is_stable(window: deque[float], every_s: float, stable: Stable, restless_c: float) -> bool:
    """True if equidistant temperatures are within the band and their fitted line is flat enough."""
    if abs(window[-1] - window[0]) + restless_c > stable.band_c:  # found sooner than all of its extremes
        return False
    if max(window) - min(window) + restless_c > stable.band_c:
        return False
    middle = (len(window) - 1) / 2
    rise_c = math.fsum((index - middle) * temperature_c for index, temperature_c in enumerate(window))
    slope_c_per_h = rise_c / sum((index - middle) ** 2 for index in range(len(window))) / every_s * 3600
    return abs(slope_c_per_h) <= stable.slope_c_per_h


def _celsius(bound: Quantity | None, otherwise: float) -> float:
    return bound.to("°C") if bound is not None else otherwise
