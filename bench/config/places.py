"""Places for units under test in a bench file, and nominal data of the units."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Annotated, Literal

from pydantic import ConfigDict, Field, model_validator

from bench.config.devices import CoverageFactor, Text
from bench.config.fixture import Vector
from bench.config.inertial import CircuitEntry, ImuChannels, SensorThermometers
from drivers.quantity.quantities import Quantity, parse
from drivers.schema.fields import (
    NOT_EMPTY,
    Amperes,
    AnyQuantity,
    Degrees,
    Flag,
    InUnit,
    Name,
    PositiveSeconds,
    Range,
    Ratio,
    StrictModel,
)
from drivers.schema.wording import telling

UnitKind = Literal["channel", "inertial unit"]
AccelerometerChannel = Literal["acc_x", "acc_y", "acc_z"]
ACCELEROMETERS: tuple[AccelerometerChannel, ...] = ("acc_x", "acc_y", "acc_z")
"""Accelerometer channels of an inertial unit."""

UNIT_KINDS: Mapping[UnitKind, str] = {"channel": "units with one channel", "inertial unit": "inertial units"}
"""Names of the kinds in messages."""


class CurrentWindow(Range):
    """Permitted current of a unit while its supply is on, from `min` to `max`.

    A current outside ends the run; if the supply feeds one of several units, only that unit is dropped.
    """

    min: Amperes
    max: Amperes


def total_current(windows: Iterable[CurrentWindow | None]) -> tuple[float, float]:
    """Return the least and greatest permitted total current in A of units on one supply; ±∞ without a window."""
    least_a, most_a = 0.0, 0.0
    for window in windows:
        least_a += window.min if window else 0.0
        most_a += window.max if window else math.inf
    return least_a, most_a


class Nominal(StrictModel):
    """Nominal data of units of this type.

    K1, S and `output` are negative if the output falls while the input rises. `time_constants` and `self_heating` serve
    estimates of the settling time.
    """

    K1: Annotated[float, InUnit("A/g", not_zero=True)] | None = Field(
        None, description="scale factor; optional only for a unit that sends its `output`"
    )
    S: Annotated[float, InUnit("Hz/A", not_zero=True)] | None = Field(None, description="scale of its converter")
    resistor: Annotated[float, InUnit("Ω", above=0)] | None = Field(
        None, description="what its current flows through, for a voltmeter"
    )
    output: AnyQuantity | None = Field(None, description="the change of a sent output with 1 g, such as 8192 code/g")
    max_current: Annotated[float, InUnit("A", above=0)] | None = Field(None, description="its maximum input current")
    load: Annotated[float, InUnit("Ω", at_least=0)] | None = Field(
        None, description="resistance of its input, for which the compliance of a source must suffice"
    )
    time_constants: Annotated[tuple[PositiveSeconds, ...], NOT_EMPTY] = Field(
        (180.0, 60.0), description="time constants of its thermal lag, in series: case, sensor"
    )
    self_heating: Annotated[float, InUnit("°C", at_least=0)] = Field(
        0.0, description="its self-heating above the air temperature while its supply is on"
    )
    converter_time_constant: PositiveSeconds = Field(
        120.0, description="with which its converter follows the air, where that is in the chamber"
    )

    @model_validator(mode="after")
    def _has_output_per_g(self) -> Nominal:
        if self.K1 is None and self.output is None:
            raise telling("needs K1, or of a unit that sends its output what 1 g changes that by: output")
        return self

    @property
    def amperes_per_g(self) -> float:
        """K1 in A/g; NaN if not stated."""
        return math.nan if self.K1 is None else self.K1


class Arm(StrictModel):
    """Position of the sensor of a place relative to the axis of rotation, in the frame of the fixture."""

    x: Annotated[float, InUnit("m")] = Field(0.0, description="along the x of the fixture")
    y: Annotated[float, InUnit("m")] = Field(0.0, description="along the y of the fixture")
    z: Annotated[float, InUnit("m")] = Field(0.0, description="along the z of the fixture")
    U: Annotated[float, InUnit("m", at_least=0)] = Field(0.0, description="expanded uncertainty of each")
    k: CoverageFactor = Field(2.0, description="coverage factor of U")

    @property
    def vector_m(self) -> Vector:
        """All three coordinates in m."""
        return self.x, self.y, self.z


class PowerCyclesEntry(StrictModel):
    """Repeatability over power cycles of a unit of this type: change of bias and scale factor at each power-on.

    The method `repeatability` determines both, as K0/sd and K1/sd with k = 1. A result that combines data from before
    and after an interruption has a line for it in its budget. Zero states that there is no change.
    """

    bias: Annotated[float, InUnit("g", at_least=0)] | None = Field(
        None, description="expanded uncertainty of the bias of an accelerometer"
    )
    scale: Annotated[Ratio, InUnit("", at_least=0)] | None = Field(
        None, description="expanded relative uncertainty of its scale factor"
    )
    gyro_bias: Annotated[float, InUnit("°/s", at_least=0)] | None = Field(
        None, description="the same of the bias of a gyro"
    )
    gyro_scale: Annotated[Ratio, InUnit("", at_least=0)] | None = Field(
        None, description="the same of the scale factor of a gyro"
    )
    k: CoverageFactor = Field(1.0, description="coverage factor of all of them; of standard deviations 1")

    @model_validator(mode="after")
    def _is_paired(self) -> PowerCyclesEntry:
        accelerometer, gyro = (self.bias, self.scale), (self.gyro_bias, self.gyro_scale)
        if any((None in pair) != (pair == (None, None)) for pair in (accelerometer, gyro)):
            raise telling("needs bias and scale together, and gyro_bias and gyro_scale")
        if accelerometer == gyro == (None, None):
            raise telling("needs bias and scale, or of gyros gyro_bias and gyro_scale")
        return self

    @property
    def standard_u(self) -> Mapping[str, float | None]:
        """Return standard uncertainties, by the names that reductions use."""
        stated = {
            "bias_g": self.bias, "scale": self.scale,
            "gyro_bias_dps": self.gyro_bias, "gyro_scale": self.gyro_scale,
        }  # fmt: skip
        return {name: None if value is None else value / self.k for name, value in stated.items()}


class PlaceEntry(StrictModel):
    """Place for a unit under test: orientation, measurement of its output, thermometers and supply.

    The output is the pulses on a `channel`, the voltage read by a `voltmeter`, or values that the unit sends on a
    channel of the `telemetry`; an inertial unit has `channels`, of a counter or of the telemetry, and a second
    thermometer at its gyros beside the one at its accelerometers, or `temperatures` of single sensors. `source` is the
    current source that can be plugged into its converter in place of the accelerometer.
    """

    model_config = ConfigDict(
        json_schema_extra={
            "oneOf": [{"required": [name]} for name in ("channel", "channels", "voltmeter", "telemetry")]
        }
    )

    channel: str = Field(
        default_factory=str, min_length=1, description="the channel of the counter that counts its pulses"
    )
    channels: ImuChannels | None = None
    voltmeter: Name | None = Field(
        None, description="the voltmeter across the resistor that its current flows through, where none counts it"
    )
    telemetry: str | None = Field(
        None, min_length=1, description="the channel of the telemetry on which it sends its output itself"
    )
    type: Text = Field("accelerometer channel", description="description of the unit in the report")
    mount_angle: Degrees = Field(0.0, description="its angle in the fixture; added to the head angle")
    clock: Degrees = Field(
        0.0, description="then its rotation about its own pendulous axis; 90° for the y channel of an instrument"
    )
    overload: Flag = Field(
        False,
        description="it may be beyond its range in mounts where its input axis is upright with the head at 0°, while "
        "another channel of the same instrument is measured",
    )
    temperature: Name = Field(description="the reading of the thermometer at the unit")
    gyro_temperature: Name | None = Field(
        None, description="the reading of the thermometer at the gyros of an inertial unit; as temperature unless given"
    )
    temperatures: SensorThermometers | None = None
    circuit: CircuitEntry | None = None
    supply: Name = Field(description="the power supply of the unit")
    supply_current: CurrentWindow | None = None
    source: Name | None = None
    ammeter: Name | None = Field(
        None, description="the ammeter in the cable of its source, which a method may believe instead"
    )
    converter_temperature: Name | None = Field(
        None, description="the reading of the thermometer at its converter, where that is in the chamber"
    )
    nominal: Nominal | None = None
    power_cycles: PowerCyclesEntry | None = None
    range: AnyQuantity | None = Field(
        None, description="the largest input that it reads, either way: in g, or of a gyro in °/s"
    )
    arm: Arm | None = None

    @model_validator(mode="after")
    def _has_one_output(self) -> PlaceEntry:
        found = [name for name in ("channel", "channels", "voltmeter", "telemetry") if getattr(self, name)]
        if len(found) != 1:
            has = f"it has {' and '.join(found)}" if found else "it has none of them"
            what = "needs channel, channels, voltmeter or telemetry, which measures the output of the unit"
            raise telling(f"{what}; {has}")
        if self.ammeter is not None and self.source is None:
            raise telling("ammeter is for a place with a source, in whose cable it is")
        if self.channels is None and self.gyro_temperature is not None:
            raise telling("gyro_temperature is for a unit with channels")
        if self.channels is None and self.temperatures is not None:
            raise telling("temperatures is for a unit with channels; the thermometer of any other is its temperature")
        if self.channels is None and self.circuit is not None:
            raise telling("circuit is for a unit with channels")
        if self.range is not None:
            if self.channels is not None:
                raise telling("range is for a unit with one channel")
            if _range_unit(self.range) is None or self.range.base_value <= 0:
                raise telling(f"range is {self.range}, expected a quantity above 0 in g, or in °/s for a gyro")
        return self

    @property
    def largest_input(self) -> tuple[float, str]:
        """Range and its unit, g or °/s; infinite if not stated."""
        unit = None if self.range is None else _range_unit(self.range)
        return (math.inf, "g") if self.range is None or unit is None else (self.range.to(unit), unit)

    @property
    def measured_by(self) -> Mapping[str, str]:
        """Channels and devices that measure the unit, by keys such as "voltmeter", "channel" or "channels.acc_x"."""
        if self.channels is not None:
            return {f"channels.{name}": channel for name, channel in self.channels}
        if self.telemetry is not None:
            return {"telemetry": self.telemetry}
        return {"channel": self.channel} if self.voltmeter is None else {"voltmeter": self.voltmeter}

    @property
    def accelerometers(self) -> Mapping[str, str]:
        """Channels of the accelerometers of an inertial unit, by ACCELEROMETERS; empty for any other unit."""
        return {} if self.channels is None else {name: getattr(self.channels, name) for name in ACCELEROMETERS}

    @property
    def dependencies(self) -> frozenset[str]:
        """Thermometers, supply and source of the unit; other places may share them."""
        circuit = None if self.circuit is None else self.circuit.output
        found = (*self.read.values(), self.supply, self.source, circuit)
        return frozenset(name for name in found if name is not None)

    @property
    def read(self) -> Mapping[str, str]:
        """Readings of its thermometers, by their keys such as "temperature" or "temperatures.Ax"."""
        keys = ("temperature", "gyro_temperature", "converter_temperature")
        found: dict[str, str] = {key: name for key in keys if (name := getattr(self, key)) is not None}
        own = {} if self.temperatures is None else self.temperatures.named
        found |= {f"temperatures.{key}": name for key, name in own.items()}
        reference = None if self.circuit is None else self.circuit.reference
        return found if reference is None else found | {"circuit.reference": reference}

    @property
    def at_sensors(self) -> Mapping[str, str]:
        """Reading of the thermometer of each sensor of an inertial unit, by its channel; empty for any other unit."""
        if self.channels is None:
            return {}
        own = {} if self.temperatures is None else self.temperatures.named
        triads = {"A": ("acc", self.temperature), "W": ("gyro", self.gyro_temperature or self.temperature)}
        return {
            f"{sensor}_{axis}": own.get(f"{letter}{axis}", of_triad)
            for letter, (sensor, of_triad) in triads.items()
            for axis in "xyz"
        }

    @property
    def kind(self) -> UnitKind:
        """Kind of the unit, which a method must support."""
        return "channel" if self.channels is None else "inertial unit"

    @property
    def is_counted(self) -> bool:
        """True if a counter counts its pulses."""
        return self.voltmeter is None and self.telemetry is None

    @property
    def has_power_cycles(self) -> bool:
        """True if the repeatability over power cycles is stated for everything that the unit measures."""
        stated = self.power_cycles
        return stated is not None and (self.channels is None or None not in (stated.bias, stated.gyro_bias))

    @property
    def output_per_g_keys(self) -> tuple[str, ...]:
        """Keys of `nominal` that give the change of its output for 1 g."""
        if self.telemetry is not None:
            return ("output",)
        return ("K1", "S" if self.voltmeter is None else "resistor")


def _range_unit(quantity: Quantity) -> str | None:
    """Return the unit of an input in a quantity, g or °/s; None for any other."""
    return next((unit for unit in ("g", "°/s") if quantity.dimension == parse(f"1 {unit}").dimension), None)
