"""Description of the method over temperature and input level (method M0)."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from bench.sequence.method import OUTPUT, MethodDescription, Units
from drivers.schema.fields import Celsius, InUnit, PositiveCelsius, PositiveSeconds, Ratio, StrictModel


class ChannelSettings(StrictModel):
    """Settings of the channel over temperature and input level."""

    threshold: Annotated[Ratio, InUnit("", above=0)] = Field(
        description="maximum deviation of slopes for which one model serves both levels, such as 5 %"
    )
    compare_basis: Literal["normalised", "raw"] = Field(
        "normalised", description="slopes for the decision: relative to the rate, or absolute"
    )
    reference_policy: Literal["claim", "embodiment"] = Field(
        "claim", description="reference of source runs: up_1g, or src_1g, which itself is compared with up_1g"
    )
    reference_temperature_c: Celsius = Field(
        25.0, alias="reference_temperature", description="of the converter, to which the rates refer"
    )
    current_from: Literal["source", "meter"] = Field(
        "source",
        description="the instrument that measures the currents: the source, or the ammeter in its cable "
        "(places.*.ammeter)",
    )
    gate_s: PositiveSeconds = Field(10.0, alias="gate", description="the time between two read-outs of the counters")
    accelerometer_c: Celsius | None = Field(
        None, alias="accelerometer", description="temperature of its thermostat; not checked if not given"
    )
    accelerometer_tolerance_c: PositiveCelsius = Field(
        0.2,
        alias="accelerometer_tolerance",
        description="maximum deviation of the accelerometer from its thermostat; gates beyond it are left out",
    )
    accelerometer_drift_u: Annotated[float, InUnit("1/°C", at_least=0)] = Field(
        60e-6,  # of a quartz flexure accelerometer at 1 g: 58 ppm/°C of its scale factor and 10 µg/°C of its bias
        description="standard uncertainty of the temperature coefficient of the rate with the temperature of the "
        "accelerometer itself",
    )
    bias_g: Annotated[float, InUnit("g")] = Field(
        0.0,
        alias="bias",
        description="bias of the channel at the reference temperature, as by the calibration of its accelerometer; for "
        "the conversion of its output to g",
    )
    bias_u_g: Annotated[float, InUnit("g", at_least=0)] = Field(
        1e-3, alias="bias_u", description="standard uncertainty of that bias"
    )
    quadratic_g_per_g2: Annotated[float, InUnit("g/g²")] = Field(
        0.0, alias="quadratic", description="second-order nonlinearity of the channel, K2, for the same conversion"
    )
    quadratic_u_g_per_g2: Annotated[float, InUnit("g/g²", at_least=0)] = Field(
        20e-6, alias="quadratic_u", description="standard uncertainty of that nonlinearity"
    )
    max_ramp_c_per_h: Annotated[float, InUnit("°C/h", above=0)] = Field(
        30.0, alias="max_ramp", description="a faster ramp is flagged"
    )
    min_span_c: PositiveCelsius = Field(
        5.0, alias="min_span", description="below this temperature span no decision is made"
    )
    drift_limit: Annotated[Ratio, InUnit("", above=0)] = Field(
        10e-6, description="a run whose input drifted more between opening and closing point is marginal"
    )


UNITS: Units = {
    "rate": OUTPUT,
    "rate/temperature_coefficient": f"{OUTPUT}/°C",
    "rate/relative_temperature_coefficient": ("1/°C", "ppm/°C"),
    "rate/model_residual": ("1", "ppm"),
    "rate/drift": ("1", "ppm"),
    "current": ("A", "mA"),
    "current/deviation": ("1", "ppm"),
    "zero": OUTPUT,
    "zero/drift": OUTPUT,
    "deviation/raw": ("1", "%"),
    "deviation/normalised": ("1", "%"),
    "tempco_offset": f"{OUTPUT}/°C",
    "tempco_scale": ("1/°C", "ppm/°C"),
}
CHANNEL_TEMPERATURE = MethodDescription(
    name="channel_temperature",
    title="Accelerometer channel over temperature and input level (method M0)",
    target="bench.methods.channel.reduction.run:reduce",
    settings=ChannelSettings,
    quantities=UNITS,
    counts_at="levels",
    measures=("channel", "inertial unit"),
    drawn_by="bench.methods.channel.shown:channel_plots",
    after=("IEEE Std 530", "IEEE Std 1554"),
    rules="bench.methods.channel.rules:RULES",
    words="bench.methods.channel.words:WORDS",
    spans="bench.methods.channel.shown:levels",
    offline="bench.methods.channel.offline:REDUCTIONS",
)
