"""Start-up of a compensated inertial unit: its zeros and scale factors against time since power-on (a check of M2).

Residual zero and scale errors after compensation by the released calibration are the errors for the users of the unit.
They include the errors of that calibration and of the unit's thermometers, which are therefore no sources of
uncertainty here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.methods.imu.reduction.attitudes import local_earth_rate_dps
from bench.methods.imu.reduction.budget import OwnErrors
from bench.methods.imu.reduction.table_errors import table_errors
from bench.methods.imu.reduction.windows import visits
from bench.methods.imu.start_up.courses import Courses, Part, Settling, fit_courses, settling
from bench.methods.imu.start_up.readings import PowerOn, Readings
from bench.methods.imu.words import OTHER_THERMOMETER
from bench.metrology.least_squares import Array, NotDetermined
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import LOWER_BOUND, Finding, Interval, UnitResult
from bench.metrology.results.flag import Flag
from bench.metrology.run_data import AXES, ReleasedCalibration, RunData, UnitUnderTest

PARTS: Mapping[str, Part] = {"K0": "zero", "K1": "scale", "D0": "zero", "KG": "scale"}
UNITS = {"K0": "g", "K1": "1", "D0": "°/s", "KG": "1"}
GYRO = ("D0", "KG")
LIMITS = {"K0": "accelerometer_zero_g", "K1": "accelerometer_scale", "D0": "gyro_zero_dps", "KG": "gyro_scale"}
FIRST = "left after compensation at the first reading after power-on"
WARM = "left after compensation when the watch ended"
SETTLING = "time from power-on until what is left after compensation stays within its limit"
FROM_THE_START = "within_from_the_start"
PERHAPS_TO_THE_END = "perhaps_to_the_end"
NOT_DETERMINED = "practically_not_determined"
SCATTER = "readings: scatter about the courses"
MODEL = "readings: their courses with other time constants"
OTHERWISE = math.sqrt(3)  # factor on the time constants, which are usually a factor of three apart
UP = np.array([0.0, 0.0, 1.0])
Sources = Mapping[BudgetLine, Array]  # gains (m,) of a time history at the times of the grid, by source


@dataclass(frozen=True, slots=True)
class Watched:
    """One quantity of one axis after one power-on: time history over `grid_s`, standard uncertainty, in its unit.

    `at_s` and `points` (n,) are the readings; `limit` is the maximum error.
    """

    quantity: str
    axis: str
    grid_s: Array
    off: Array
    u: Array
    at_s: Array
    points: Array
    limit: float
    settling: Settling


@dataclass(frozen=True, slots=True)
class StartUpDetail:
    """Data for the report: quantities after each power-on, with the set point of the chamber."""

    power_ons: tuple[tuple[float, tuple[Watched, ...]], ...]


def reduce(data: RunData, settings: Mapping[str, Any]) -> list[UnitResult]:
    """Reduce a run to the findings of every unit."""
    return [_reduced(data, unit, settings) for unit in data.units]


def _reduced(data: RunData, unit: UnitUnderTest, settings: Mapping[str, Any]) -> UnitResult:
    released = unit.released
    if released is None:
        return UnitResult(unit.place, unit.serial, (), (), ("calibration",), (Flag("not_given", of="calibration"),))
    after = [
        _Watch(data, unit, released, PowerOn(visit, unit, released, data.bench), settings)
        for visit in visits(data, unit)
    ]
    findings = tuple(finding for each in after for finding in each.findings())
    return UnitResult(
        place=unit.place,
        uut=unit.serial,
        findings=findings,
        models=(),
        left_out=tuple(name for each in after for name in each.left_out),
        flags=(
            *_other_thermometers(unit, released),
            *(flag for each in after for flag in dict.fromkeys(each.power_on.flags)),
        ),
        detail=StartUpDetail(tuple((each.power_on.visit.set_c, tuple(each.watched)) for each in after)),
    )


def _other_thermometers(unit: UnitUnderTest, released: ReleasedCalibration) -> Iterator[Flag]:
    """Channels whose temperature is not that of the thermometer of their calibration."""
    for channel, known in released.channels.items():
        read = unit.thermometer(channel)
        if known.thermometer not in ("", read):
            values = {"sensor": channel, "thermometer": known.thermometer, "read": read}
            yield Flag(OTHER_THERMOMETER, values=values)


class _Watch:
    """Results after one power-on; `findings` computes them."""

    def __init__(
        self, data: RunData, unit: UnitUnderTest, released: ReleasedCalibration, power_on: PowerOn,
        settings: Mapping[str, Any],
    ) -> None:  # fmt: skip
        self._subject, self._bench = data.subject(unit), data.bench
        self._unit, self._released, self._settings = unit, released, settings
        self.power_on = power_on
        self.watched: list[Watched] = []
        self.left_out: list[str] = []

    def findings(self) -> Iterator[Finding]:
        """Findings of all axes; the scale factor of a gyro only if the sequence rotates it."""
        for axis in range(len(AXES)):
            yield from self._of(axis, self.power_on.accelerometer(axis), ("K0", "K1"))
            yield from self._of(axis, self.power_on.gyro_at_rest(axis), ("D0",))
            if self.power_on.visit.turned(axis):
                yield from self._of(axis, self.power_on.gyro_turned(axis), ("KG",))

    def _of(self, axis: int, readings: Readings, quantities: Sequence[str]) -> Iterator[Finding]:
        taus_s = self._settings["time_constants_s"]
        try:
            courses, otherwise = (
                fit_courses(readings.at_s, readings.values, readings.drive, [factor * tau_s for tau_s in taus_s])
                for factor in (1.0, OTHERWISE)
            )
        except NotDetermined:
            names = [f"{AXES[axis]}/{quantity}" for quantity in quantities]
            self.left_out += [f"{self.power_on.visit.path}/{name}".strip("/") for name in names]
            self.power_on.flags += [Flag("start_up_not_determined", of=name) for name in names]
            return
        for quantity in quantities:
            yield from self._of_quantity(quantity, axis, readings, courses, otherwise)

    def _of_quantity(
        self, quantity: str, axis: int, readings: Readings, courses: Courses, otherwise: Courses
    ) -> Iterator[Finding]:
        part, grid_s = PARTS[quantity], courses.grid_s
        nominal = 1.0 if part == "scale" else 0.0
        off = courses.of(part, grid_s) - nominal
        apart = np.abs(otherwise.of(part, grid_s) - courses.of(part, grid_s))
        sources = {BudgetLine(MODEL, "B", 1.0): apart, **dict(self._sources(quantity, axis, readings, courses))}
        u = np.sqrt(sum((source.u * gain) ** 2 for source, gain in sources.items()))
        limit = float(self._settings[LIMITS[quantity]])
        found = settling(grid_s, off, u, limit)
        points = courses.points(part) - nominal
        self.watched.append(Watched(quantity, AXES[axis], grid_s, off, u, courses.at_s, points, limit, found))
        steps = tuple(window.step for window in readings.windows)
        first = int(np.searchsorted(grid_s, courses.at_s.min()))
        for name, index, name_text in (("power_on", first, FIRST), ("warm", -1, WARM)):
            lines = _lines(sources, index, 1.0)
            yield self._finding(f"{quantity}/{name}", axis, name_text, float(off[index]), UNITS[quantity], lines, steps)
        yield self._settling(quantity, axis, found, sources, grid_s, u, steps)

    def _settling(
        self, quantity: str, axis: int, found: Settling, sources: Sources, grid_s: Array, u: Array,
        steps: tuple[str, ...],
    ) -> Finding:  # fmt: skip
        """Settling time of a quantity, with the shares of its sources at that time."""
        index = int(np.searchsorted(grid_s, found.at_s).clip(0, len(grid_s) - 1))
        begun_s, ended_s = self.power_on.between_s or (0.0, 0.0)
        index = index if u[index] else int(np.argmax(u))  # a time history may be known exactly there, but not elsewhere
        lines = _lines(sources, index, found.u_s / float(u[index]) if u[index] else 0.0)
        lines.append(BudgetLine("power-on: command to reading back", "B", (ended_s - begun_s) / math.sqrt(12)))
        is_open = found.perhaps_to_the_end and not found.to_the_end
        marks = {
            LOWER_BOUND: found.to_the_end,
            PERHAPS_TO_THE_END: is_open,
            NOT_DETERMINED: is_open and found.interval_s.low == 0,
            FROM_THE_START: found.from_the_start,
        }
        flags = tuple(flag for flag, marked in marks.items() if marked)
        aside_s, range_s = (ended_s - begun_s) / 2, found.interval_s
        interval = Interval(max(range_s.low - aside_s, 0.0), range_s.high + aside_s, range_s.from_scatter)
        return self._finding(f"{quantity}/settling", axis, SETTLING, found.at_s, "s", lines, steps, flags, interval)

    def _sources(
        self, quantity: str, axis: int, readings: Readings, courses: Courses
    ) -> Iterator[tuple[BudgetLine, Array]]:
        """Sources of uncertainty of a time history, with its gains (m,)."""
        weights = courses.weights(PARTS[quantity], courses.grid_s)
        fit, always = courses.fit, np.ones(len(courses.grid_s))
        scatter = max(fit.residual_sd if fit.dof else 0.0, readings.alone)
        yield (
            BudgetLine(SCATTER, "A" if fit.dof else "B", 1.0, fit.dof or None),
            scatter * np.linalg.norm(weights, axis=-1),
        )
        own = OwnErrors(self._unit, self._bench, f"{'gyro' if quantity in GYRO else 'acc'}_{AXES[axis]}")
        if own.is_sent:
            yield BudgetLine(own.steps, "B", 1.0), readings.hidden(weights)
        if PARTS[quantity] == "scale":
            yield from ((each, always) for each in own.clock_of_scale(1.0))
        if quantity == "KG":
            return  # of whole turns by the table's own angle
        earth_dps = local_earth_rate_dps(self._bench.latitude_deg)
        errors = table_errors(readings.windows, self._unit, self._bench)
        seen = errors.seen(earth_dps if quantity == "D0" else UP, axis)
        for cause, u_seen in errors.propagated(seen, weights).items():  # each is one rotation in every attitude
            yield cause.source, u_seen
        if quantity == "D0":  # rotated by half a turn about east, it senses north with the other sign; the mean cancels
            across_dps = np.delete(errors.axes @ earth_dps, axis, axis=-1)
            across = np.linalg.norm(weights @ across_dps, axis=-1)
            yield BudgetLine("gyro: earth rate across its axis", "B", self._settings["misalignment_rad"]), across
        if quantity == "K1":
            known_mps2 = self._released.gravity_mps2
            if not math.isnan(known_mps2) and known_mps2 != self._bench.gravity_mps2:  # otherwise the same survey
                u = math.hypot(self._bench.gravity_u_mps2, self._released.gravity_u_mps2) / known_mps2
                yield BudgetLine("site: gravity, against that of the calibration", "B", u), always

    def _finding(
        self, quantity: str, axis: int, name: str, value: float, unit: str, lines: Sequence[BudgetLine],
        steps: tuple[str, ...], flags: tuple[str, ...] = (), interval: Interval | None = None,
    ) -> Finding:  # fmt: skip
        visit, subject = self.power_on.visit, self._subject.part(AXES[axis])
        at = {"visit": visit.number, "axis": AXES[axis], "temperature_set_c": visit.told_set_c}
        return subject.finding(quantity, name, value, unit, lines, at, steps, visit.tail, flags, interval)


def _lines(sources: Sources, index: int, factor: float) -> list[BudgetLine]:
    """Budget of a time history at one time of the grid, times a factor."""
    return [source.times(float(gain[index])).times(factor) for source, gain in sources.items()]
