"""Descriptions of the methods on a rate table: range and frequency response (method M3)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Literal

from pydantic import Field, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from bench.sequence.method import OUTPUT_UNITS, MethodDescription, Units
from bench.sequence.per_degree import ScalePerDegree
from drivers.quantity.quantities import as_quantity, parse
from drivers.quantity.units import QuantityError, parse_unit
from drivers.schema.fields import Celsius, Hertz, InUnit, Ratio, StrictModel
from drivers.schema.wording import telling

Tolerance = Annotated[Ratio, InUnit("", at_least=0, at_most=0.5)]
Basis = Literal["reading", "full_scale"]
PositiveG = Annotated[float, InUnit("g", above=0)]
PositiveRate = Annotated[float, InUnit("°/s", above=0)]
Scales = dict[str, float] | dict[str, dict[str, float]]
GYROS, ACCELEROMETERS = (tuple(f"{kind}_{axis}" for axis in "xyz") for kind in ("gyro", "acc"))


@dataclass(frozen=True, slots=True)
class ScaleOf:
    """Validator of scale factors, one or a list of one for each kind of output, to numbers by the unit of the output.

    They are in that unit over `per`, such as 4000 pulse/°, which is 4000 pulse/s for 1 °/s. Of an inertial unit they
    may be stated for each of its `sensors`: a mapping, to such numbers by sensor.
    """

    per: str
    sensors: tuple[str, ...]

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self._validate)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        listed = {"type": "array", "items": {"type": "string"}, "minItems": 1}
        own = {sensor: {"oneOf": [{"type": "string"}, listed]} for sensor in self.sensors}
        by_sensor = {"type": "object", "properties": own, "additionalProperties": False, "minProperties": 1}
        return {"oneOf": [{"type": "string"}, listed, by_sensor]}

    def _validate(self, raw: object) -> Scales:
        if not isinstance(raw, Mapping) or not raw:
            return self._by_output(raw)
        if unknown := [key for key in raw if key not in self.sensors]:
            raise telling(f"has '{unknown[0]}', expected {', '.join(self.sensors)}")
        return {sensor: self._by_output(given) for sensor, given in raw.items()}

    def _by_output(self, raw: object) -> dict[str, float]:
        units = {output: f"{output}/({self.per})" for output in (*OUTPUT_UNITS, self.per)}
        found: dict[str, float] = {}
        for given in raw if isinstance(raw, list | tuple) and raw else [raw]:
            try:
                scale = parse(given) if isinstance(given, str) else as_quantity(given)
            except QuantityError as problem:
                raise telling(str(problem)) from None
            output = next((each for each, unit in units.items() if parse_unit(unit).dimension == scale.dimension), None)
            if output is None:
                wanted = ", ".join(units[each] for each in OUTPUT_UNITS)
                raise telling(f"is {scale}, expected a quantity in one of {wanted}")
            if scale.base_value == 0:
                raise telling(f"is {scale}, expected a quantity other than 0")
            if output in found:
                raise telling(f"has two scale factors of an output in {output}")
            found[output] = scale.to(units[output])
        return found


def scales_of(scale: Mapping[str, Any], sensor: str) -> Mapping[str, float]:
    """Stated scale factors of a sensor by the unit of its output: its own, or those of all sensors.

    Empty if only those of other sensors are stated.
    """
    own = scale.get(sensor)
    if own is not None:
        return dict(own)
    return {unit: value for unit, value in scale.items() if not isinstance(value, Mapping)}


class GyroScale(StrictModel):
    """Scale factor of a gyro, from output to rate."""

    scale: Annotated[Scales, ScaleOf("°/s", GYROS)] = Field(
        description="stated scale factor, the reference of errors and gains; a quantity such as 4000 pulse/°, "
        "16000 code/(°/s) or 10 mV/(°/s), or a list of one for each kind of output; of an inertial unit that of all "
        "gyros, or a mapping of gyro_x, gyro_y and gyro_z to their own"
    )


class AccelerometerScale(ScalePerDegree):
    """Scale factor of an accelerometer, from output to acceleration."""

    scale: Annotated[Scales, ScaleOf("g", ACCELEROMETERS)] = Field(
        description="calibrated scale factor; a quantity such as 11300 pulse/s/g, 45200 code/g or 226 mV/g, "
        "or a list of one for each kind of output; of an inertial unit that of all accelerometers, or a mapping of "
        "acc_x, acc_y and acc_z to their own"
    )
    scale_u: Tolerance = Field(
        1e-4,
        description="its relative standard uncertainty, including nonlinearity and asymmetry at the "
        "accelerations that determine a radius or a lever arm",
    )
    scale_c: Celsius = Field(20.0, alias="scale_at", description="temperature of the unit at which it applies")


class RangeSettings(StrictModel):
    """Basis and conditions of the errors over a range."""

    linearity_basis: Basis = Field("reading", description="reference of relative errors")
    rate_tolerance: Tolerance = Field(1e-3, description="maximum relative deviation of the table from its rate")


class GyroRangeSettings(GyroScale, ScalePerDegree, RangeSettings):
    """Settings of the range of a gyro."""

    full_scale_dps: PositiveRate = Field(alias="full_scale", description="full scale")
    clip_dps: PositiveRate = Field(alias="clip", description="the output at which it saturates")


class AccelerometerRangeSettings(AccelerometerScale, RangeSettings):
    """Settings of the range of an accelerometer."""

    linearity_basis: Basis = Field("full_scale", description="reference of relative errors")
    full_scale_g: PositiveG = Field(alias="full_scale", description="full scale")
    clip_g: PositiveG = Field(alias="clip", description="the output at which it saturates")
    radius_up_to_g: PositiveG = Field(
        1.0, alias="radius_up_to", description="maximum acceleration at the rates that determine the radius"
    )


class ResponseSettings(StrictModel):
    """Settings of the evaluation of an oscillation."""

    play_pulses: Annotated[float, InUnit("pulse", at_least=0)] = Field(
        1.0, alias="play", description="hysteresis of a converter: charge at a reversal beyond that of a pulse"
    )
    expected_hz: Hertz | None = Field(
        None,
        alias="expected_bandwidth",
        description="expected bandwidth; the check warns unless 0.5 to 2 times of it are swept",
    )
    waveform_hz: Hertz | None = Field(
        None,
        alias="waveform_at",
        description="frequency of the oscillation whose waveform the report shows; default: the bandwidth",
    )


class GyroResponseSettings(GyroScale, ResponseSettings):
    """Settings of the frequency response of a gyro."""

    gain_reference: Literal["absolute", "lowest"] = Field(
        "absolute", description="gains relative to the stated scale factor, or to that at the lowest frequency"
    )
    lever_hz: Hertz | None = Field(
        None,
        alias="lever_frequency",
        description="frequency of an oscillation for the lever arms of accelerometers under the same label; it is left "
        "out of the response",
    )


class AccelerometerResponseSettings(AccelerometerScale, ResponseSettings):
    """Settings of the frequency response of an accelerometer."""

    lever_hz: Hertz = Field(
        0.5,
        alias="lever_frequency",
        description="frequency of the oscillation that determines the lever arms; gains are relative to it",
    )


OF_A_GYRO = "The gyro is measured together with its converter, against the encoder of the table, on one clock. "
OF_AN_ACCELEROMETER = (
    "The accelerometer is measured together with its converter, in units of local g by the scale factor stated in the "
    "sequence. "
)

on_a_table = partial(
    MethodDescription,
    counts_at="table",
    measures=("channel", "inertial unit"),
    rules="bench.methods.rate_table.rules:RULES",
    words="bench.methods.rate_table.words:WORDS",
    spans="bench.methods.rate_table.shown_range:motions",
    offline="bench.methods.rate_table.offline:REDUCTIONS",
)
GYRO_UNITS: Units = {
    "rest_rate": ("°/s", "°/h"),
    "rate_error": "°/s",
    "rate_error/relative": ("1", "ppm"),
    "saturated_points": ("1", ""),
    "scale_error": ("1", "ppm"),
    "asymmetry": ("1", "ppm"),
    "nonlinearity/cubic": ("1", "ppm"),
}
GYRO_RANGE = on_a_table(
    name="gyro_range",
    title="Range of a gyro (method M3a)",
    target="bench.methods.rate_table.reduction.range:reduce_gyro",
    settings=GyroRangeSettings,
    quantities=GYRO_UNITS,
    drawn_by="bench.methods.rate_table.shown_range:range_plots",
    after=("IEEE Std 952", "IEEE Std 292", "IEEE Std 1554"),
    meaning=OF_A_GYRO
    + (
        "The rate at rest contains the part of earth's rate along the axis of the table. Errors are relative to the "
        "scale factor stated in the sequence; the bias is subtracted, and with it the earth's rate."
    ),
)
GYRO_RESPONSE = on_a_table(
    name="gyro_response",
    title="Frequency response of a gyro (method M3b)",
    target="bench.methods.rate_table.reduction.response:reduce_gyro",
    settings=GyroResponseSettings,
    quantities={"gain": ("1", ""), "phase": "°", "bandwidth": "Hz", "phase_at_bandwidth": "°"},
    drawn_by="bench.methods.rate_table.shown_response:response_plots",
    after=("IEEE Std 292", "IEEE Std 1057", "IEEE Std 1554"),
    meaning=OF_A_GYRO
    + (
        "Gains are ratios of amplitudes to those of the table, phases are negative where the gyro lags. The "
        "hysteresis of the converter at each reversal is removed. A sample that the gyro sends itself is a mean over "
        "its period; its delay of half a period is corrected."
    ),
)
ACCELEROMETER_UNITS: Units = {
    "rest_output": ("g", "µg"),
    "radius": ("m", "mm"),
    "acceleration_error": ("g", "µg"),
    "acceleration_error/relative": ("1", "ppm"),
    "saturated_points": ("1", ""),
    "scale_error": ("1", "ppm"),
    "nonlinearity/quadratic": ("1", "ppm"),
}
ACCELEROMETER_RANGE = on_a_table(
    name="accelerometer_range",
    title="Range of an accelerometer on a centrifuge (method M3c)",
    target="bench.methods.rate_table.reduction.range:reduce_accelerometer",
    settings=AccelerometerRangeSettings,
    quantities=ACCELEROMETER_UNITS,
    drawn_by="bench.methods.rate_table.shown_range:range_plots",
    after=("IEEE Std 836", "IEEE Std 1554"),
    meaning=OF_AN_ACCELEROMETER
    + (
        "An error of the scale factor is contained in the radius, which the accelerometer determines at low rates: "
        "the errors over the range are those of linearity. They contain a stretch of the arm."
    ),
)  # fmt: skip
ACCELEROMETER_RESPONSE = on_a_table(
    name="accelerometer_response",
    title="Frequency response of an accelerometer (method M3d)",
    target="bench.methods.rate_table.reduction.response:reduce_accelerometer",
    settings=AccelerometerResponseSettings,
    quantities={
        "gain": ("1", ""), "gain/two_sample": ("1", ""), "phase": "°", "bandwidth": "Hz", "phase_at_bandwidth": "°",
        "lever_arm/x": ("m", "mm"), "lever_arm/y": ("m", "mm"),
    },
    drawn_by="bench.methods.rate_table.shown_response:response_plots",
    after=("IEEE Std 836", "IEEE Std 1057", "IEEE Std 1554"),
    meaning=OF_AN_ACCELEROMETER
    + (
        "Gains are relative to that of the slow oscillation that determines the lever arms, phases are relative to "
        "the table and negative where the accelerometer lags. The hysteresis of the converter at each reversal is "
        "removed. The arms contain the misalignment of the input axis."
    ),
)  # fmt: skip
