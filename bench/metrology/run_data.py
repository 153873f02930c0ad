"""Input of a method: acquisitions of a run, their units, and the uncertainties of the bench."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from bench.metrology.acquisition import Acquisition, Array
from bench.metrology.bench_uncertainty import BenchRecord, Vector
from bench.metrology.calibration.temperature import Compensation
from bench.metrology.results.finding import Subject

AXES = ("x", "y", "z")


@dataclass(frozen=True, slots=True)
class ReleasedCalibration:
    """Conversion of the outputs of a unit to values, by channel; 1 g in it is `gravity_mps2`, NaN if not stated.

    `gravity_u_mps2` is its standard uncertainty.
    """

    channels: Mapping[str, Compensation]
    gravity_mps2: float = math.nan
    gravity_u_mps2: float = 0.0

    def of_output(self, output_unit: str) -> Compensation | None:
        """Conversion to g of a unit with one channel, wherever it was calibrated; None for another output."""
        found = [each for each in self.channels.values() if each.output_unit == output_unit]
        return found[0] if len(found) == 1 and found[0].value_unit == "g" else None

    def local_g(self, gravity_mps2: float) -> float:
        """Local gravity in the g of the calibration; 1 if that is not stated."""
        return gravity_mps2 / self.gravity_mps2 if np.isfinite(self.gravity_mps2) and self.gravity_mps2 else 1.0


@dataclass(frozen=True, slots=True)
class PowerCycles:
    """Repeatability over power cycles, standard deviations: biases in g and °/s, scale factors relative.

    None if not stated.
    """

    bias_g: float | None = None
    scale: float | None = None
    gyro_bias_dps: float | None = None
    gyro_scale: float | None = None


@dataclass(frozen=True, slots=True)
class TemperatureCircuit:
    """The unit's own thermometer: readings of its output in `unit`, and of the thermometer that it is compared with.

    Nominally its output is `nominal` at `at_c` and changes by `slope` with 1 °C; NaN if not stated.
    """

    output: str
    unit: str
    reference: str
    nominal: float = math.nan
    at_c: float = math.nan
    slope: float = math.nan

    def indicated_c(self, output: Array) -> Array:
        """Temperatures that outputs (n,) indicate by the nominal characteristic; NaN without one."""
        return output if self.unit == "°C" else self.at_c + (output - self.nominal) / self.slope


@dataclass(frozen=True, slots=True)
class UnitUnderTest:
    """One unit in its place; its output is pulses on a `channel`, or the voltage read by a `voltmeter`.

    Or it is the output that the unit sends itself on a channel of the `telemetry`, in `sent_unit`. `until_s` is the
    bench time at which it was dropped from the run. `nominal_per_g` is its nominal change of output for 1 g, in
    `output_unit`; None if not stated. `converter` is the reading of the thermometer at its converter and `source` the
    current source that can feed the converter, `ammeter` the ammeter in its cable, "" for none; `scale_a_per_g` is its
    nominal K1. An inertial unit has `channels`, by acc_x to gyro_z, and a thermometer at its gyros; `temperatures` are
    the readings at single sensors, by channel, and `channel_units` the units of the outputs that it sends. `arm_m` is
    its position relative to the axis of rotation by the bench file, with its standard uncertainty. `supply` is the
    supply that powers it, "" for none; `released` is the released calibration given to the run. `power_cycles` is its
    repeatability over power cycles. `sensor` is acc_x, acc_y or acc_z if it stands for one channel of an inertial unit,
    `circuit` the temperature circuit of an inertial unit.
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
    temperatures: Mapping[str, str] = field(default_factory=dict)
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
    clock_deg: float = 0.0
    ammeter: str = ""
    power_cycles: PowerCycles | None = None
    sensor: str = ""
    circuit: TemperatureCircuit | None = None

    @property
    def accelerometers(self) -> tuple[UnitUnderTest, ...]:
        """Accelerometer channels of an inertial unit, each as a unit with one channel; any other unit itself."""
        if not self.channels:
            return (self,)
        return tuple(self.alone(f"acc_{axis}") for axis in AXES)

    def alone(self, sensor: str) -> UnitUnderTest:
        """One channel of an inertial unit, by its name from acc_x to gyro_z, as a unit with one channel."""
        sent = self.channel_units.get(sensor)
        return replace(
            self, sensor=sensor, channels={}, channel_units={}, channel="" if sent else self.channels[sensor],
            telemetry=self.channels[sensor] if sent else None, sent_unit=sent or self.sent_unit,
            temperature=self.thermometer(sensor), temperatures={},
        )  # fmt: skip

    def thermometer(self, channel: str) -> str:
        """Reading of the thermometer of a sensor of an inertial unit: its own one, or that of its triad."""
        of_triad = self.gyro_temperature if channel.startswith("gyro") else self.temperature
        return self.temperatures.get(channel) or of_triad or self.temperature

    @property
    def thermometers(self) -> tuple[str, ...]:
        """Readings of all its thermometers."""
        circuit = () if self.circuit is None else (self.circuit.output, self.circuit.reference)
        found = (self.temperature, self.gyro_temperature, self.converter, *self.temperatures.values(), *circuit)
        return tuple(dict.fromkeys(name for name in found if name))

    @property
    def axis(self) -> str:
        """Axis of the inertial unit that it is a channel of, x, y or z; "" for a unit of its own."""
        return self.sensor.removeprefix("acc_")

    @property
    def row(self) -> int:
        """Row of its input axis among the axes of the unit: 0, or that of its axis in an inertial unit."""
        return AXES.index(self.axis) if self.sensor else 0

    @property
    def measured_by(self) -> str:
        """The channel of the counter or of the telemetry, or the voltmeter."""
        return self.telemetry or self.voltmeter or self.channel

    @property
    def is_counted(self) -> bool:
        """True if a counter counts its pulses."""
        return self.voltmeter is None and self.telemetry is None

    @property
    def output_unit(self) -> str:
        """Unit of its output; of an inertial unit, that of its accelerometers."""
        if self.channels:
            return self.unit_of("acc_x")
        if self.telemetry is not None:
            return self.sent_unit
        return "pulse/s" if self.voltmeter is None else "V"

    @property
    def gyro_output_unit(self) -> str:
        """The same for the gyros of an inertial unit; for any other, that of its output."""
        return self.unit_of("gyro_x") if self.channels else self.output_unit

    def unit_of(self, channel: str) -> str:
        """Unit of a channel of an inertial unit, by its name from acc_x to gyro_z."""
        return self.channel_units.get(channel, "pulse/s")


@dataclass(frozen=True, slots=True)
class RunData:
    """Acquisitions under one label, in run order, and the data needed to reduce them.

    `closure` are those of the stability check, start against end. `span_s` is the bench time from the beginning of the
    run to the end of its records, zeros if unknown.
    """

    label: str
    units: tuple[UnitUnderTest, ...]
    acquisitions: tuple[Acquisition, ...]
    bench: BenchRecord
    closure: tuple[Acquisition, ...] = ()
    span_s: tuple[float, float] = (0.0, 0.0)

    def subject(self, unit: UnitUnderTest) -> Subject:
        """Subject of the findings of a unit, or of a channel of an inertial unit."""
        whole = Subject(self.label, unit.place, unit.serial)
        return whole.part(unit.axis) if unit.sensor else whole

    def run_share(self, at_s: Array) -> Array:
        """Position of bench times (n,) in the run: from -½ at its beginning to ½ at its end.

        If its duration is unknown, that of its acquisitions is used.
        """
        began_s, ended_s = self.span_s
        if ended_s <= began_s:
            every = (*self.acquisitions, *self.closure)
            began_s, ended_s = min(each.begin_s for each in every), max(each.end_s for each in every)
        return np.asarray((at_s - began_s) / (ended_s - began_s) - 0.5)

    def groups(self) -> dict[str, list[Acquisition]]:
        """Acquisitions by their groups of steps, both in run order."""
        found: dict[str, list[Acquisition]] = {}
        for acquisition in self.acquisitions:
            found.setdefault(acquisition.group, []).append(acquisition)
        return found

    def by_length(self) -> Iterator[RunData]:
        """Units that remained to the end together, then each dropped one with the acquisitions before its drop."""
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
