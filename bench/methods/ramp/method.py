"""Description of method M4b, the dynamic temperature test."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from bench.sequence.method import MethodDescription, NamedPart, Units
from drivers.schema.fields import InUnit, StrictModel, WholeNumber


class SampledRamp(StrictModel):
    """How the legs of a ramp are divided."""

    sample_s: Annotated[float, InUnit("s", at_least=5)] = Field(
        10.0, alias="sample", description="duration of a sample; a longer one has a finer resolution"
    )


class TemperatureRampSettings(SampledRamp):
    """Settings of the dynamic temperature test."""

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
CYCLE = NamedPart("cycle", "loop", "the number of a cycle; needed if the same temperatures come more than once")
TEMPERATURE_RAMP = MethodDescription(
    name="temperature_ramp",
    title="Dynamic temperature test (method M4b)",
    target="bench.methods.ramp.reduction.run:reduce",
    words="bench.methods.ramp.words:WORDS",
    parts=(CYCLE,),
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


class VerifyOnRampSettings(SampledRamp):
    """Settings of the verification of a calibration on a ramp."""


VERIFICATION_UNITS: Units = {
    "K0/left_mean": ("g", "µg"),
    "K0/left_largest": ("g", "µg"),
    "K0/left_largest_dynamic": ("g", "µg"),
    "K1/left_largest": ("1", "ppm"),
    "tilt/uncompensated": "°",
    "tilt/verified": "°",
    "tilt/verified_dynamic": "°",
    "tilt_of_two/uncompensated": "°",
    "tilt_of_two/verified": "°",
    "tilt_of_two/verified_dynamic": "°",
    "tilt_of_two/left_largest": "°",
    "tilt_of_two/left_largest_dynamic": "°",
}
VERIFY_ON_RAMP = MethodDescription(
    name="verify_on_ramp",
    title="Verification of a calibration on a temperature ramp, out of sample (method M4)",
    target="bench.methods.ramp.reduction.verification:reduce",
    words="bench.methods.ramp.words:WORDS",
    parts=(CYCLE,),
    rules="bench.methods.ramp.rules:RULES",
    spans="bench.methods.ramp.shown:legs",
    settings=VerifyOnRampSettings,
    quantities=VERIFICATION_UNITS,
    counts_at="ramps",
    drawn_by="bench.methods.ramp.shown_verification:left_plots",
    needs_calibration=True,
    meaning=(
        "The output of the unit is converted by its released calibration from an earlier run, at the temperatures of "
        "its own thermometer while they change: by its curves over temperature (static), and by its dynamic model with "
        "dT/dt, if it has one. What is left is the error of a user of the unit who compensates it and has zeroed it "
        "once, since a ramp does not separate the bias from the misalignment: bias and relative scale factor about "
        "their means, and the span of the tilt that a level unit would indicate. Use the dynamic model where the "
        "temperature changes fast, else the static one. The uncertainty is that of this measurement."
    ),
    after=("IEEE Std 1293",),
)
