"""The methods over temperature as a sequence sees them: the static tumble and the dynamic test (method M4)."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from bench.sequence.methods import OUTPUT, MethodDescription
from bench.sequence.methods.per_degree import BiasPerDegree, ScalePerDegree
from drivers.schema.fields import Celsius, InUnit, StrictModel, WholeNumber


class TemperatureTumbleSettings(BiasPerDegree, ScalePerDegree):
    """Settings of the static temperature tumble."""

    degree: Annotated[WholeNumber, Field(ge=1, le=4)] = Field(4, description="of the polynomials over temperature")
    reference_c: Celsius = Field(
        20.0, alias="reference", description="the temperature about which K0T1, K0T2, K1T1 and K1T2 hold"
    )
    closure_limit_g: Annotated[float, InUnit("g", above=0)] = Field(
        100e-6,
        alias="closure_limit",
        description="when the bias has moved further between the first dwell and the last, both at one set point, "
        "every verdict is marginal",
    )


TEMPERATURE_TUMBLE = MethodDescription(
    name="temperature_tumble",
    title="Static temperature tumble (method M4a)",
    target="bench.analysis.temperature_tumble:reduce",
    settings=TemperatureTumbleSettings,
    quantities={
        "K0": "g",
        "K1": f"{OUTPUT}/g",
        "K1_si": f"{OUTPUT}/(m/s²)",
        "K2": "g/g²",
        "misalignment": "rad",
        "K0/temperature_coefficient": "g/°C",
        "K1/temperature_coefficient": "1/°C",
        "K0T1": "g/°C",
        "K0T2": "g/°C²",
        "K1T1": "1/°C",
        "K1T2": "1/°C²",
        "K3": "g/g³",
        "Kip": "g/g²",
        "asymmetry": "1",
        "K0/hysteresis": "g",
        "K0/closure": "g",
        "K1/hysteresis": "1",
        "K0/model_residual": "g",
        "K1/model_residual": "1",
        "tilt/uncompensated": "°",
        "tilt/compensated": "°",
    },
    drawn_by="bench.report.tumble_shown:tumble_shown",
    after=("IEEE Std 1293", "IEEE Std 530", "IEEE Std 1554"),
)


class TemperatureRampSettings(StrictModel):
    """Settings of the dynamic temperature test."""

    sample_s: Annotated[float, InUnit("s", at_least=5)] = Field(
        10.0, alias="sample", description="the length of a sample; a longer one resolves more"
    )
    jump_threshold_g: Annotated[float, InUnit("g", above=0)] = Field(
        60e-6, alias="jump_threshold", description="a larger step is a jump"
    )
    jump_window: Annotated[WholeNumber, Field(ge=2, le=1000)] = Field(
        8, description="samples on either side between which a step is looked for"
    )
    misalignment_u_rad: Annotated[float, InUnit("rad", at_least=0)] = Field(
        1e-3,
        alias="misalignment_u",
        description="standard uncertainty of the input axis's misalignment, which is in K1",
    )


TEMPERATURE_RAMP = MethodDescription(
    name="temperature_ramp",
    title="Dynamic temperature test (method M4b)",
    target="bench.analysis.temperature_ramp:reduce",
    settings=TemperatureRampSettings,
    quantities={
        "K0/temperature_coefficient": "g/°C",
        "K0/model_residual": "g",
        "K0/model_residual_rms": "g",
        "K0/hysteresis": "g",
        "K0/repeatability": "g",
        "K0/jumps": "1",
        "K0/largest_jump": "g",
        "K1/temperature_coefficient": "1/°C",
        "tilt/uncompensated": "°",
        "tilt/compensated": "°",
    },
    counts_at="ramps",
    drawn_by="bench.report.ramp_plots:ramp_plots",
    after=("IEEE Std 1293", "IEEE Std 530", "IEEE Std 1554"),
)
