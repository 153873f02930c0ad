"""Uncertainties of a bench from certificates and surveys, as standard uncertainties, and as sources of budgets."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from bench.metrology.results.budget import BudgetLine, common, gain_and_offset

WOBBLE = "axis: wobble"
Vector = tuple[float, float, float]


class AxisRecord(NamedTuple):
    """An axis of the table: direction of its positive end with all angles at 0 (east, north, up), and its errors.

    `harmonics_u_deg` are standard uncertainties of the cosine and the sine amplitude of harmonics 1, 2, … of its error,
    `wobble_u_deg` those of its tilt once a turn. `backlash_u_deg` is that of the difference in angle after an approach
    from above, None if not stated.
    """

    points: Vector = (0.0, -1.0, 0.0)
    zero_u_deg: float = 0.0
    harmonics_u_deg: tuple[float, ...] = ()
    repeatability_u_deg: float = 0.0
    backlash_u_deg: float | None = None
    wobble_u_deg: float = 0.0


class SourceRecord(NamedTuple):
    """Certificate of a current source or an ammeter, as standard uncertainties.

    Gain (1), offset (A), drift (1/s).
    """

    gain_u: float
    offset_u_a: float
    drift_u_per_s: float

    def u_a(self, current_a: float) -> float:
        """Standard uncertainty of a current, without the drift."""
        return math.hypot(self.gain_u * current_a, self.offset_u_a)


@dataclass(frozen=True, slots=True)
class Drift:
    """Change of an error, linear in time, from the beginning of a run to its end.

    `u` is a standard uncertainty, in °C of a thermometer and in degrees of the level. `is_stated` is true if the
    certificate states it.
    """

    u: float = 0.0
    is_stated: bool = True


class ClockRecord(NamedTuple):
    """Clock of a node that latches an encoder, as standard uncertainties.

    `skew_u_s` is that of the time from the latch of the encoder to that of the pulses, or to the end of the sample.
    """

    name: str
    time_base_u: float
    skew_u_s: float

    @property
    def time_base(self) -> BudgetLine:
        """Relative error of its times."""
        return common(f"{self.name}: time base", self.time_base_u)


class TiltPairRecord(NamedTuple):
    """Two places whose accelerometers measure a tilt together: `across` is up when `along` is level.

    Their input axes are at 90° and the skew to each other, with its standard uncertainty.
    """

    along: str
    across: str
    skew_rad: float
    skew_u_rad: float


@dataclass(frozen=True, slots=True)
class BenchRecord:
    """Uncertainties of the bench by certificates and surveys; every `u` is a standard uncertainty.

    `axes` are those of the table, outer first; `x` and `z` are directions of the fixture with all angles at 0.
    `level_deg` tilts the whole table about south, and changes by `level_drift` within a run. `thermometers_u` are
    offset (°C) and gain (relative to the temperature in °C) by the name of the reading, `thermometer_drifts` the change
    of their errors within a run, `voltmeters_u` gain (relative to the reading) and offset (V) by voltmeter, `sources`
    the current sources and ammeters with a certificate, by their roles. `orthogonality_u_deg` is that of each axis to
    the one that carries it, in two directions. `host_clock_u` is the relative uncertainty of the host's clock, 0 if not
    stated. `encoder_skew_u_s` is that of the time between the latches of encoder and pulses. `telemetry` is the clock
    of units that send their output, None if no encoder is latched with it. `tilt_pairs` measure a tilt together.
    """

    gravity_mps2: float
    gravity_u_mps2: float
    axes: Mapping[str, AxisRecord]
    x: Vector
    z: Vector
    level_deg: float
    level_u_deg: float
    time_base_u: float
    thermometers_u: Mapping[str, tuple[float, float]]
    voltmeters_u: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    latitude_deg: float = 0.0
    azimuth_u_deg: float = 0.0
    orthogonality_u_deg: float = 0.0
    sources: Mapping[str, SourceRecord] = field(default_factory=dict)
    encoder_skew_u_s: float = 0.0
    host_clock_u: float = 0.0
    telemetry: ClockRecord | None = None
    level_drift: Drift = Drift()
    thermometer_drifts: Mapping[str, Drift] = field(default_factory=dict)
    tilt_pairs: tuple[TiltPairRecord, ...] = ()

    def clock(self, *, sent: bool) -> ClockRecord:
        """Clock of the measurement of a table: that of a unit which has `sent` its output, or the counter's."""
        if sent and self.telemetry is not None:
            return self.telemetry
        return ClockRecord("counter", self.time_base_u, self.encoder_skew_u_s)

    @property
    def level(self) -> BudgetLine:
        """Error of the level of the fixture, in rad."""
        return common("fixture: level", math.radians(self.level_u_deg))

    @property
    def wobble(self) -> BudgetLine:
        """Tilt of the outermost axis once a turn, in rad."""
        return BudgetLine(WOBBLE, "B", math.radians(self.head.wobble_u_deg), None, "table.wobble")

    def gravity(self, value: float) -> BudgetLine:
        """Contribution of gravity to a value that is proportional to it."""
        return common("site: gravity", value * self.gravity_u_mps2 / self.gravity_mps2)

    def temperature(self, name: str, temperature_c: float) -> BudgetLine:
        """Error of a temperature reading, in °C."""
        return BudgetLine(f"{name}: offset, gain", "B", self.temperature_u_c(name, temperature_c), None, name)

    def voltmeter(self, name: str) -> tuple[BudgetLine, BudgetLine]:
        """Errors of a voltmeter: of its gain, and of its offset in V; zeros without a certificate."""
        return gain_and_offset(name, *self.voltmeters_u.get(name, (0.0, 0.0)))

    def current(self, role: str) -> tuple[BudgetLine, BudgetLine]:
        """Errors of a current source or ammeter: of its gain, and of its offset in A; zeros without a certificate."""
        known = self.sources.get(role, SourceRecord(0.0, 0.0, 0.0))
        return gain_and_offset(role, known.gain_u, known.offset_u_a)

    def thermometer(self, name: str) -> tuple[BudgetLine, BudgetLine]:
        """Errors of the thermometer of a reading: of its gain, and of its offset in °C; zeros without a certificate."""
        offset_c, gain = self.thermometer_u(name)
        return gain_and_offset(name, gain, offset_c)

    def thermometer_u(self, name: str) -> tuple[float, float]:
        """Offset (°C) and gain of the thermometer of a reading; zeros without a certificate."""
        return self.thermometers_u.get(name, (0.0, 0.0))

    def thermometer_drift(self, name: str) -> Drift:
        """Drift within a run of the thermometer of a reading; none without a certificate."""
        return self.thermometer_drifts.get(name, Drift())

    def temperature_u_c(self, name: str, temperature_c: float) -> float:
        """Standard uncertainty of a temperature reading."""
        offset_c, gain = self.thermometer_u(name)
        return math.hypot(offset_c, gain * temperature_c)

    def axis(self, role: str) -> AxisRecord:
        """Stated errors of an axis; none if nothing is stated."""
        return self.axes.get(role, AxisRecord())

    @property
    def head(self) -> AxisRecord:
        """The head, which is the outermost axis; one without errors if there is none."""
        return next(iter(self.axes.values()), AxisRecord())
