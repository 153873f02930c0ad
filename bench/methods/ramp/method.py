"""Description of method M4b, the dynamic temperature test."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from bench.sequence.method import MethodDescription, NamedPart, Units
from drivers.schema.fields import InUnit, StrictModel, WholeNumber


class TemperatureRampSettings(StrictModel):
    """Settings of the dynamic temperature test."""

    sample_s: Annotated[float, InUnit("s", at_least=5)] = Field(
        10.0, alias="sample", description="duration of a sample; a longer one has a finer resolution"
    )
    jump_threshold_g: Annotated[float, InUnit("g", above=0)] = Field(
        60e-6, alias="jump_threshold", description="minimum size of a jump"
    )
    jump_window: Annotated[WholeNumber, Field(ge=2, le=1000)] = Field(
        8, description="number of samples on either side in the fit of a step"
    )
    misalignment_u_rad: Annotated[float, InUnit("rad", at_least=0)] = Field(
        1e-3,
        alias="misalignment_u",
        description="standard uncertainty of the misalignment of the input axis, which is contained in K1",
    )


UNITS: Units = {
    "K0/temperature_coefficient": ("g/°C", "µg/°C"),
    "K0/model_residual": ("g", "µg"),
    "K0/model_residual_rms": ("g", "µg"),
    "K0/hysteresis": ("g", "µg"),
    "K0/repeatability": ("g", "µg"),
    "K0/jumps": ("1", ""),
    "K0/largest_jump": ("g", "µg"),
    "K1/temperature_coefficient": ("1/°C", "ppm/°C"),
    "tilt/uncompensated": "°",
    "tilt/compensated": "°",
}
TEMPERATURE_RAMP = MethodDescription(
    name="temperature_ramp",
    title="Dynamic temperature test (method M4b)",
    target="bench.methods.ramp.reduction.run:reduce",
    words="bench.methods.ramp.words:WORDS",
    parts=(NamedPart("cycle", "loop", "the number of a cycle; needed if the same temperatures come more than once"),),
    rules="bench.methods.ramp.rules:RULES",
    spans="bench.methods.ramp.shown:legs",
    offline="bench.methods.ramp.offline:REDUCTIONS",
    settings=TemperatureRampSettings,
    quantities=UNITS,
    shown={"K0/jump": "µg"},
    counts_at="ramps",
    drawn_by="bench.methods.ramp.shown:ramp_plots",
    after=("IEEE Std 1293", "IEEE Std 530", "IEEE Std 1554"),
)
