"""The methods on a rate table as a sequence sees them: range and frequency response (method M3)."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from bench.sequence.methods import MethodDescription
from drivers.fields import Hertz, InUnit, Ratio, StrictModel

Tolerance = Annotated[Ratio, InUnit("", at_least=0, at_most=0.5)]
Basis = Literal["reading", "full_scale"]
PositiveG = Annotated[float, InUnit("g", above=0)]
PositiveRate = Annotated[float, InUnit("°/s", above=0)]


class GyroScale(StrictModel):
    """What turns the pulses of a gyro into a rate."""

    scale_ppd: Annotated[float, InUnit("pulse/°", above=0)] = Field(
        alias="scale", description="scale factor as stated; errors and gains are against it"
    )


class AccelerometerScale(StrictModel):
    """What turns the pulses of an accelerometer into an acceleration."""

    scale_pps_per_g: Annotated[float, InUnit("pulse/s/g", above=0)] = Field(
        alias="scale", description="scale factor as it was calibrated"
    )
    scale_u: Tolerance = Field(1e-4, description="its standard uncertainty, relative")
    scale_per_c_u: Annotated[float, InUnit("1/°C", at_least=0)] = Field(
        6e-5,
        alias="scale_per_degree_u",
        description="by how much of itself it may change with 1 °C; it is not corrected for that",
    )


class RangeSettings(StrictModel):
    """How errors over a range are judged."""

    linearity_basis: Basis = Field("reading", description="what errors are relative to")
    rate_tolerance: Tolerance = Field(1e-3, description="how far the table may be from its rate, relative")


class GyroRangeSettings(GyroScale, RangeSettings):
    """Settings of the range of a gyro."""

    full_scale_dps: PositiveRate = Field(alias="full_scale", description="the end of the range")
    clip_dps: PositiveRate = Field(alias="clip", description="where the output stays when the rate goes on")


class AccelerometerRangeSettings(AccelerometerScale, RangeSettings):
    """Settings of the range of an accelerometer."""

    linearity_basis: Basis = Field("full_scale", description="what errors are relative to")
    full_scale_g: PositiveG = Field(alias="full_scale", description="the end of the range")
    clip_g: PositiveG = Field(alias="clip", description="where the output stays when the acceleration goes on")
    radius_up_to_g: PositiveG = Field(
        1.0, alias="radius_up_to", description="the radius is found at rates that give no more than this"
    )


class ResponseSettings(StrictModel):
    """How counts of a swing are read."""

    play_pulses: Annotated[float, InUnit("pulse", at_least=0)] = Field(
        1.0, alias="play", description="what a converter must go back at a reversal beyond what it goes for a pulse"
    )


class GyroResponseSettings(GyroScale, ResponseSettings):
    """Settings of the frequency response of a gyro."""

    gain_reference: Literal["absolute", "lowest"] = Field(
        "absolute", description="gains against the stated scale factor, or over that at the lowest frequency"
    )


class AccelerometerResponseSettings(AccelerometerScale, ResponseSettings):
    """Settings of the frequency response of an accelerometer."""

    lever_hz: Hertz = Field(0.5, alias="lever_frequency", description="at which the arms are found; gains are over it")


OF_A_GYRO = (
    "The gyro is measured together with its converter, against the encoder of the table, with which it has one clock. "
)
OF_AN_ACCELEROMETER = (
    "The accelerometer is measured together with its converter, in units of local g by the scale factor stated in the "
    "sequence. "
)

GYRO_RANGE = MethodDescription(
    name="gyro_range",
    title="Range of a gyro (method M3a)",
    target="bench.analysis.range_method:reduce_gyro",
    settings=GyroRangeSettings,
    quantities={
        "rest_rate": "°/s",
        "rate_error": "°/s",
        "rate_error/relative": "1",
        "saturated_points": "1",
        "scale_error": "1",
        "asymmetry": "1",
        "nonlinearity/cubic": "1",
    },
    counts_at="table",
    drawn_by="bench.report.range_plots:range_plots",
    after=("IEEE Std 952", "IEEE Std 292", "IEEE Std 1554"),
    meaning=OF_A_GYRO
    + (
        "The rate at rest contains the part of earth's rate along the axis of the table. Errors are against the scale "
        "factor stated in the sequence; the bias is taken off, and with it earth's rate."
    ),
)
GYRO_RESPONSE = MethodDescription(
    name="gyro_response",
    title="Frequency response of a gyro (method M3b)",
    target="bench.analysis.response_method:reduce_gyro",
    settings=GyroResponseSettings,
    quantities={"gain": "1", "phase": "°", "bandwidth": "Hz", "phase_at_bandwidth": "°"},
    counts_at="table",
    drawn_by="bench.report.response_plots:response_plots",
    after=("IEEE Std 292", "IEEE Std 1057", "IEEE Std 1554"),
    meaning=OF_A_GYRO
    + (
        "Gains are amplitudes over those of the table, phases are negative where the gyro lags. The play of the "
        "converter at each reversal is taken out."
    ),
)
ACCELEROMETER_RANGE = MethodDescription(
    name="accelerometer_range",
    title="Range of an accelerometer on a centrifuge (method M3c)",
    target="bench.analysis.range_method:reduce_accelerometer",
    settings=AccelerometerRangeSettings,
    quantities={
        "rest_output": "g", "radius": "m", "acceleration_error": "g", "acceleration_error/relative": "1",
        "saturated_points": "1", "scale_error": "1", "nonlinearity/quadratic": "1",
    },
    counts_at="table",
    drawn_by="bench.report.range_plots:range_plots",
    after=("IEEE Std 836", "IEEE Std 1554"),
    meaning=OF_AN_ACCELEROMETER
    + (
        "What is wrong with the scale factor is in the radius, as the accelerometer finds it at low rates: the errors "
        "over the range are those of linearity. A stretch of the arm is in them."
    ),
)  # fmt: skip
ACCELEROMETER_RESPONSE = MethodDescription(
    name="accelerometer_response",
    title="Frequency response of an accelerometer (method M3d)",
    target="bench.analysis.response_method:reduce_accelerometer",
    settings=AccelerometerResponseSettings,
    quantities={
        "gain": "1", "phase": "°", "bandwidth": "Hz", "phase_at_bandwidth": "°", "lever_arm/x": "m", "lever_arm/y": "m",
    },
    counts_at="table",
    drawn_by="bench.report.response_plots:response_plots",
    after=("IEEE Std 836", "IEEE Std 1057", "IEEE Std 1554"),
    meaning=OF_AN_ACCELEROMETER
    + (
        "Gains are over that of the slow swing at which the accelerometer found its arms, phases are against the table "
        "and negative where it lags. The play of the converter at each reversal is taken out. The arms contain the "
        "misalignment of the input axis."
    ),
)  # fmt: skip
