"""Truth of one simulated unit as stated in its file (`config/uut/*.yaml`); only the simulators read it.

A value is a quantity, or `{mean, sd}`: drawn once per run from a normal distribution cut at 2.5 sd, with a random
stream of its own derived from (seed, place, path of the key), so that adding or fixing one value changes no other.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, GetCoreSchemaHandler, model_validator
from pydantic_core import CoreSchema, core_schema

from drivers.schema.fields import (
    Celsius,
    Flag,
    InUnit,
    PositiveAmperes,
    PositiveCelsius,
    PositiveSeconds,
    Seconds,
    StrictModel,
)

CUT_SD = 2.5


@dataclass(frozen=True, slots=True)
class Draw:
    """A number, or a normal distribution to draw it from."""

    mean: float
    sd: float = 0.0

    def value(self, stream: np.random.Generator) -> float:
        """Number for one run; the normal distribution is truncated by drawing again."""
        while abs(normal := float(stream.standard_normal())) > CUT_SD:
            pass
        return self.mean + self.sd * normal


@dataclass(frozen=True, slots=True)
class DrawIn:
    """Validates a quantity or `{mean, sd}` in `unit` into a Draw."""

    unit: str

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        number = handler.generate_schema(Annotated[float, InUnit(self.unit)])
        width = handler.generate_schema(Annotated[float, InUnit(self.unit, at_least=0)])
        fields = {"mean": core_schema.typed_dict_field(number), "sd": core_schema.typed_dict_field(width)}
        drawn = core_schema.typed_dict_schema(fields, extra_behavior="forbid")
        schemas: Mapping[str, CoreSchema] = {"fixed": number, "drawn": drawn}
        return core_schema.no_info_after_validator_function(
            lambda found: Draw(**found) if isinstance(found, dict) else Draw(found),
            core_schema.tagged_union_schema(
                dict(schemas), discriminator=lambda raw: "drawn" if isinstance(raw, Mapping) else "fixed"
            ),
        )


Ratio = Annotated[Draw, DrawIn("")]
Polynomial = tuple[float, float, float, float, float]


class BiasModel(StrictModel):
    """K0 in g as a polynomial about the reference temperature."""

    at_reference: Annotated[Draw, DrawIn("g")]
    linear: Annotated[Draw, DrawIn("g/°C")] = Draw(0)
    quadratic: Annotated[Draw, DrawIn("g/°C²")] = Draw(0)
    cubic: Annotated[Draw, DrawIn("g/°C³")] = Draw(0)
    quartic: Annotated[Draw, DrawIn("g/°C⁴")] = Draw(0)


class ScaleModel(StrictModel):
    """K1 in A/g at the reference temperature, and its relative polynomial."""

    at_reference: Annotated[Draw, DrawIn("A/g")]
    linear: Annotated[Draw, DrawIn("1/°C")] = Draw(0)
    quadratic: Annotated[Draw, DrawIn("1/°C²")] = Draw(0)
    cubic: Annotated[Draw, DrawIn("1/°C³")] = Draw(0)
    quartic: Annotated[Draw, DrawIn("1/°C⁴")] = Draw(0)


class HysteresisModel(StrictModel):
    """Prandtl-Ishlinskii: play operators on temperature, total ± amplitude."""

    amplitude: Annotated[Draw, DrawIn("g")] = Draw(0)
    thresholds: tuple[Annotated[float, InUnit("°C", above=0)], ...] = ()


class InputHysteresisModel(StrictModel):
    """Prandtl-Ishlinskii: play operators on the specific force along the input axis, total ± amplitude."""

    amplitude: Annotated[Draw, DrawIn("g")] = Draw(0)
    thresholds: tuple[Annotated[float, InUnit("g", above=0)], ...] = ()


class JumpModel(StrictModel):
    """A step of the bias, once: when the sensor first warms to a temperature."""

    at: Celsius
    size: Annotated[Draw, DrawIn("g")]


class WarmUpModel(StrictModel):
    """A bias that decays exponentially from power-on."""

    amplitude: Annotated[Draw, DrawIn("g")] = Draw(0)
    time_constant: PositiveSeconds = 1200.0


class NoiseModel(StrictModel):
    """White noise of the given density, and slow drift of the given standard deviation."""

    density: Annotated[Draw, DrawIn("g/Hz^0.5")] = Draw(0)
    instability: Annotated[Draw, DrawIn("g")] = Draw(0)


class AccelerometerModel(StrictModel):
    """The accelerometer of equations 8.4. Without a damping it is instantaneous, with any bandwidth."""

    range: Annotated[float, InUnit("g", above=0)] = 20.0
    reference_temperature: Celsius = 20.0
    K0: BiasModel
    K1: ScaleModel
    K2: Annotated[Draw, DrawIn("1/g")] = Draw(0)
    K3: Annotated[Draw, DrawIn("1/g²")] = Draw(0)
    Kip: Annotated[Draw, DrawIn("1/g")] = Draw(0)
    Kio: Annotated[Draw, DrawIn("1/g")] = Draw(0)
    misalignment_o: Annotated[Draw, DrawIn("rad")] = Draw(0)
    misalignment_p: Annotated[Draw, DrawIn("rad")] = Draw(0)
    Kd: Annotated[Draw, DrawIn("g·s/°C")] = Draw(0)
    hysteresis: HysteresisModel = HysteresisModel()
    input_hysteresis: InputHysteresisModel = InputHysteresisModel()
    jumps: tuple[JumpModel, ...] = ()
    drift: Annotated[Draw, DrawIn("g/s")] = Draw(0)
    warm_up: WarmUpModel = WarmUpModel()
    turn_on: Annotated[Draw, DrawIn("g")] = Draw(0)  # standard deviation of the bias step at each power-on
    turn_on_scale: Ratio = Draw(0)  # the same of the relative step of the scale factor
    noise: NoiseModel = NoiseModel()
    bandwidth: Annotated[float, InUnit("Hz", above=0)] = 300.0  # far above the signal of a dwell at rest
    damping: Annotated[float, InUnit("", above=0, at_most=0.99)] | None = None
    delay: Seconds = 0.0


class ConverterModel(StrictModel):
    """The current-to-frequency converter of equations 8.5."""

    S: Annotated[Draw, DrawIn("Hz/A")]
    alpha: Annotated[Draw, DrawIn("1/°C")] = Draw(0)
    alpha2: Annotated[Draw, DrawIn("1/°C²")] = Draw(0)
    asymmetry: Ratio = Draw(0)
    nonlinearity: Ratio = Draw(0)
    full_scale: Annotated[float, InUnit("A", above=0)]
    zero: Annotated[Draw, DrawIn("pulse/s")] = Draw(0)
    zero_drift: Annotated[Draw, DrawIn("pulse/s/°C")] = Draw(0)
    dead_band: Annotated[Draw, DrawIn("A")] = Draw(0)
    max_rate: Annotated[float, InUnit("Hz", above=0)]
    counter_bits: Annotated[int, Field(ge=8, le=64)] = 24
    temperature: Celsius = 25.0
    in_chamber: Flag = False
    time_constant: PositiveSeconds = 120.0


class ResistorModel(StrictModel):
    """Load resistor for a voltmeter, as in the bench file, and an amplifier behind it.

    It is on the board of the converter, at the same temperature.
    """

    alpha: Annotated[Draw, DrawIn("1/°C")] = Draw(0)
    alpha2: Annotated[Draw, DrawIn("1/°C²")] = Draw(0)
    zero: Annotated[Draw, DrawIn("V")] = Draw(0)
    zero_drift: Annotated[Draw, DrawIn("V/°C")] = Draw(0)


class CodesModel(StrictModel):
    """Codes with a number of bits: a zero, and white noise on each sample."""

    zero: Annotated[Draw, DrawIn("code")] = Draw(0)
    noise: Annotated[Draw, DrawIn("code")] = Draw(0)
    bits: Annotated[int, Field(ge=8, le=32)] = 24


class CurrentCodes(CodesModel):
    """The A/D converter of an accelerometer: S times its current."""

    S: Annotated[Draw, DrawIn("code/A")]


class BoardCodes(CurrentCodes):
    """An A/D converter on the board of the converter, at the same temperature."""

    alpha: Annotated[Draw, DrawIn("1/°C")] = Draw(0)
    alpha2: Annotated[Draw, DrawIn("1/°C²")] = Draw(0)
    zero_drift: Annotated[Draw, DrawIn("code/°C")] = Draw(0)


class TelemetryModel(BoardCodes):
    """The A/D converter of a unit that sends codes; `clock` is the relative error of the clock by which it samples."""

    clock: Ratio = Draw(0)


class ThermostatModel(StrictModel):
    """A heater in the case, its power in proportion to the error within ± `band` of the set point.

    Without power the sensor is `least_rise` warmer than the case, at full power `most_rise`.
    """

    set_point: Celsius
    band: PositiveCelsius = 0.02
    least_rise: PositiveCelsius = 2.0
    most_rise: PositiveCelsius = 80.0


class ThermalModel(StrictModel):
    """Thermal response of the unit to the chamber."""

    case_time_constant: PositiveSeconds = 180.0
    sensor_time_constant: PositiveSeconds = 60.0
    self_heating: Celsius = 0.0
    thermostat: ThermostatModel | None = None


class SupplyModel(StrictModel):
    """Supply current of the unit."""

    current: PositiveAmperes = 0.06


class UnitFile(StrictModel):
    """One `config/uut/*.yaml`."""

    schema_: Literal["itb-uut/1"] = Field(alias="schema")
    title: str
    accelerometer: AccelerometerModel
    converter: ConverterModel
    thermal: ThermalModel = ThermalModel()
    supply: SupplyModel = SupplyModel()
    telemetry: TelemetryModel | None = None
    resistor: ResistorModel = ResistorModel()

    @model_validator(mode="after")
    def _fits(self) -> UnitFile:
        top = abs(self.accelerometer.range * self.accelerometer.K1.at_reference.mean * self.converter.S.mean)
        if top > self.converter.max_rate:
            raise ValueError(
                f"range x K1 x S is {top:.6g} pulse/s, above the converter's max_rate {self.converter.max_rate:.6g}"
            )
        return self


def stream(seed: int, *path: str) -> np.random.Generator:
    """Random stream for a path of names; the same for the same seed everywhere."""
    digest = hashlib.sha256("/".join((str(seed), *path)).encode()).digest()
    return np.random.Generator(np.random.PCG64(int.from_bytes(digest[:16], "big")))
