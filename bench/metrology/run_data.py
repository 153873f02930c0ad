"""What a method gets of a run: acquisitions, the units that they are of, and what is known of the bench."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from bench.metrology.acquisition import Acquisition, Array
from bench.metrology.bench_uncertainty import BenchRecord, Vector
from bench.metrology.calibration.temperature import Compensation
from bench.metrology.results.finding import Subject


@dataclass(frozen=True, slots=True)
class ReleasedCalibration:
    """How the output of each channel of a unit becomes a value, by names; 1 g in it is `gravity_mps2`, NaN if untold.

    `gravity_u_mps2` is its standard uncertainty.
    """

    channels: Mapping[str, Compensation]
    gravity_mps2: float = math.nan
    gravity_u_mps2: float = 0.0


@dataclass(frozen=True, slots=True)
class PowerCycles:
    """Standard deviations of what a unit has after each power-on: biases in g and °/s, scale factors relative.

    None where nobody says.
    """

    bias_g: float | None = None
    scale: float | None = None
    gyro_bias_dps: float | None = None
    gyro_scale: float | None = None


@dataclass(frozen=True, slots=True)
class UnitUnderTest:
    """One unit in its place; its output are the pulses on a `channel`, or the volts that a `voltmeter` reads.

    Or it is what the unit sends itself on a channel of the `telemetry`, in `sent_unit`. `until_s` is the bench time at
    which it was dropped from the run. `nominal_per_g` is what its output is made to change by for 1 g, in
    `output_unit`; None where nobody says. `converter` is the reading of the thermometer at its converter and `source`
    the current source that can feed that, `ammeter` what is in its cable, "" for none; `scale_a_per_g` is its nominal
    K1. An inertial unit has `channels`, by acc_x to gyro_z, and a thermometer at its gyros; `channel_units` are what
    those are in that it sends. `arm_m` is where the bench file says that it is from the axis that turns it, with its
    standard uncertainty. `supply` is what powers it, "" for none; `released` is the calibration that was given to the
    run for it. `power_cycles` is its repeatability over power cycles.
    """

    place: str
    serial: str
    channel: str
    mount_angle_deg: float
    temperature: str
    until_s: float = math.inf
    voltmeter: str | None = None
    nominal_per_g: float | None = None
    channels: Mapping[str, str] = field(default_factory=dict)
    gyro_temperature: str = ""
    converter: str = ""
    source: str = ""
    scale_a_per_g: float = math.nan
    arm_m: Vector | None = None
    arm_u_m: float = 0.0
    supply: str = ""
    released: ReleasedCalibration | None = None
    telemetry: str | None = None
    sent_unit: str = "code"
    channel_units: Mapping[str, str] = field(default_factory=dict)
    ammeter: str = ""
    power_cycles: PowerCycles | None = None

    @property
    def measured_by(self) -> str:
        """The channel of the counter or of the telemetry, or the voltmeter."""
        return self.telemetry or self.voltmeter or self.channel

    @property
    def is_counted(self) -> bool:
        """Whether a counter counts its pulses."""
        return self.voltmeter is None and self.telemetry is None

    @property
    def output_unit(self) -> str:
        """What its output is in; of an inertial unit that of its accelerometers."""
        if self.channels:
            return self.unit_of("acc_x")
        if self.telemetry is not None:
            return self.sent_unit
        return "pulse/s" if self.voltmeter is None else "V"

    @property
    def gyro_output_unit(self) -> str:
        """The same of the gyros of an inertial unit; of any other it is that of its output."""
        return self.unit_of("gyro_x") if self.channels else self.output_unit

    def unit_of(self, channel: str) -> str:
        """What a channel of an inertial unit is in, by its name from acc_x to gyro_z."""
        return self.channel_units.get(channel, "pulse/s")


@dataclass(frozen=True, slots=True)
class RunData:
    """The acquisitions under one label, in the order of the run, and what is needed to reduce them.

    `closure` are those that tell what has changed over the run. `span_s` is the bench time from the beginning of the
    run to the end of what it recorded, zeros where nobody says.
    """

    label: str
    units: tuple[UnitUnderTest, ...]
    acquisitions: tuple[Acquisition, ...]
    bench: BenchRecord
    closure: tuple[Acquisition, ...] = ()
    span_s: tuple[float, float] = (0.0, 0.0)

    def subject(self, unit: UnitUnderTest) -> Subject:
        """Whom findings of a unit are of."""
        return Subject(self.label, unit.place, unit.serial)

    def run_share(self, at_s: Array) -> Array:
        """Where bench times (n,) are in the run: from -½ at its beginning to ½ at its end.

        Where nobody says how long it was, its acquisitions do.
        """
        began_s, ended_s = self.span_s
        if ended_s <= began_s:
            every = (*self.acquisitions, *self.closure)
            began_s, ended_s = min(each.begin_s for each in every), max(each.end_s for each in every)
        return np.asarray((at_s - began_s) / (ended_s - began_s) - 0.5)

    def groups(self) -> dict[str, list[Acquisition]]:
        """The acquisitions by the groups of steps that they belong to, both in the order of the run."""
        found: dict[str, list[Acquisition]] = {}
        for acquisition in self.acquisitions:
            found.setdefault(acquisition.group, []).append(acquisition)
        return found

    def by_length(self) -> Iterator[RunData]:
        """The units that were in to the end together, then each that was dropped with what had ended before."""
        stayed = tuple(unit for unit in self.units if math.isinf(unit.until_s))
        if stayed:
            yield replace(self, units=stayed)
        for unit in self.units:
            if unit not in stayed:
                before, closure = (
                    tuple(each for each in acquired if each.end_s <= unit.until_s)
                    for acquired in (self.acquisitions, self.closure)
                )
                yield replace(self, units=(unit,), acquisitions=before, closure=closure)
