"""How long a unit takes to have the temperature of its chamber, as far as a bench file lets it be known.

The air follows the set point as `simulation.chamber` says, a unit follows the air as `places.*.nominal` says, and its
thermometer follows the unit as `simulation.thermometer` says; of a bench file that does not say it, the defaults hold.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from bench.config.models import BenchFile, Nominal, PlaceEntry
from bench.sequence.lags import Array, Poles, followed, gain, lag_poles, loop_poles
from bench.sequence.readings import unit_of
from bench.sequence.step_fields import is_known
from bench.sequence.waits import LOOK_EVERY_S, WINDOW_COVERAGE, Soak, Stable, WaitUntil
from drivers.quantities import Quantity

PEAK_TO_PEAK_SD = 6.0  # what noise spans over a soak, in its standard deviations
SAMPLES_OF_A_HOLD = 200  # at most; a longer hold time is looked at less often than in the run
_USUAL_UNIT = Nominal.model_validate({"K1": "1 A/g"})  # only its thermal behaviour is asked for


@dataclass(frozen=True, slots=True)
class _Reading:
    """How a temperature follows the set point, and the supply of the unit that it is measured at.

    `restless_c` is what it spans, peak to peak, when all has settled.
    """

    behind_set_point: Poles
    behind_heating: Poles = ()
    supply: str = ""
    heating_c: float = 0.0
    restless_c: float = 0.0


@dataclass(frozen=True, slots=True)
class _Change:
    """The set point goes evenly by `by`, in °C; or, with a supply, units on it begin (1) or cease (-1) to warm."""

    at_s: float
    by: float
    duration_s: float = 0.0
    supply: str = ""


class Settling:
    """What has changed the temperatures so far, and when a unit has settled after it; a copy goes on by itself."""

    def __init__(self, bench: BenchFile) -> None:
        self._bench = bench
        self._changes: tuple[_Change, ...] = ()
        self._powered: frozenset[str] = frozenset()

    def ramp(self, from_c: float, to_c: float, at_s: float, duration_s: float) -> None:
        """The set point goes from one temperature to another."""
        if to_c != from_c:
            self._changes += (_Change(at_s, to_c - from_c, duration_s),)

    def power(self, supply: str, on: bool, at_s: float) -> None:
        """The output of a supply goes on or off, and with it the units on it."""
        if on != (supply in self._powered):
            self._powered ^= {supply}
            self._changes += (_Change(at_s, 1.0 if on else -1.0, supply=supply),)

    def soak_s(self, step: Soak, at_s: float) -> float:
        """How long a soak that begins at `at_s` takes; as long as it may, when nothing tells that it ends before."""
        reading, stable = self._reading(step.role), step.until_stable
        if stable is None or reading is None or math.isnan(stable.band_c * stable.slope_c_per_h * stable.hold_s):
            return step.least_s
        longest_s = max(step.give_up_after_s or 0.0, step.at_least_s)
        every_s = max(LOOK_EVERY_S, stable.hold_s / SAMPLES_OF_A_HOLD)
        for until_s in (step.at_least_s, longest_s):  # most are stable when their time is over
            looks_s = at_s + np.arange(step.at_least_s, until_s + every_s, every_s)
            settled = self._stable(reading, stable, looks_s, every_s)
            if settled.any():
                return float(looks_s[settled.argmax()]) - at_s
        return longest_s

    def _stable(self, reading: _Reading, stable: Stable, looks_s: Array, every_s: float) -> NDArray[np.bool_]:
        """Whether a reading is stable at each of the times (n,), `every_s` apart."""
        back_s = np.arange(-max(round(stable.hold_s / every_s), 2), 1) * every_s
        before_s = looks_s[0] + back_s[:-1]
        windows = sliding_window_view(self._temperature_c(reading, np.concatenate([before_s, looks_s])), len(back_s))
        hours = (back_s - back_s.mean()) / 3600
        slope_c_per_h: Array = windows @ hours / (hours @ hours)
        spread_c: Array = np.ptp(windows, axis=1) + reading.restless_c
        is_still = (spread_c <= stable.band_c) & (np.abs(slope_c_per_h) <= stable.slope_c_per_h)
        return is_still & (looks_s >= WINDOW_COVERAGE * stable.hold_s)  # readings begin with the run

    def wait_s(self, step: WaitUntil, at_s: float) -> float:
        """How long a temperature takes to fulfil a condition; as long as it may, when nothing tells that it does.

        Of other readings nothing is known but the time for which the condition must hold.
        """
        reading, bounds = self._reading(step.reading), [each for each in (step.above, step.below) if each is not None]
        if reading is None or not all(map(is_known, bounds)) or math.isnan(step.hold_s):
            return step.least_s
        looks_s = at_s + np.arange(0.0, step.give_up_after_s + LOOK_EVERY_S, LOOK_EVERY_S)
        temperature_c = self._temperature_c(reading, looks_s)
        fulfilled = (temperature_c > _celsius(step.above, -math.inf)) & (temperature_c < _celsius(step.below, math.inf))
        count = math.ceil(WINDOW_COVERAGE * step.hold_s / LOOK_EVERY_S) + 1
        held = sliding_window_view(fulfilled, count).all(axis=1) if len(fulfilled) >= count else np.zeros(1, np.bool_)
        return float(held.argmax() + count - 1) * LOOK_EVERY_S if held.any() else step.give_up_after_s

    def _temperature_c(self, reading: _Reading, at_s: Array) -> Array:
        """What a reading shows at rising times (n,)."""
        shown_c = np.full_like(at_s, self._bench.simulation.chamber.start)
        for change in self._changes:
            if not change.supply:
                shown_c += change.by * followed(reading.behind_set_point, at_s - change.at_s, change.duration_s)
            elif change.supply == reading.supply and reading.heating_c:
                shown_c += change.by * reading.heating_c * followed(reading.behind_heating, at_s - change.at_s, 0.0)
        return shown_c

    def _reading(self, name: str) -> _Reading | None:
        """What is known of a temperature: that of the air, and those at the units; None of any other reading."""
        bench, chamber = self._bench, self._bench.simulation.chamber
        if unit_of(name, bench) != "°C":
            return None
        air = loop_poles(chamber.natural_period, chamber.damping)
        swing_c = 2 * math.sqrt(2) * chamber.limit_cycle  # peak to peak
        place = next(self._places_at(name), None)
        if place is not None:
            unit, thermometer = place.nominal or _USUAL_UNIT, bench.simulation.thermometer
            lags = lag_poles((*unit.time_constants, thermometer.lag))
            restless_c = swing_c * gain(lags, chamber.limit_cycle_period) + PEAK_TO_PEAK_SD * thermometer.noise
            return _Reading((*air, *lags), lags, place.supply, unit.self_heating, restless_c)
        device = bench.devices[self._source(name).partition(".")[0]]
        return _Reading(air, restless_c=swing_c) if "thermal_chamber" in device.description.capabilities else None

    def _places_at(self, name: str) -> Iterator[PlaceEntry]:
        source = self._source(name)
        return (place for place in self._bench.places.values() if self._source(place.temperature) == source)

    def _source(self, name: str) -> str:
        return self._bench.readings[name].from_ if name in self._bench.readings else name


def _celsius(bound: Quantity | None, otherwise: float) -> float:
    return bound.to("°C") if bound is not None else otherwise
