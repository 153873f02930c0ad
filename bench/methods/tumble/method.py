"""Descriptions of method M4a, the static temperature tumble, and of the repeatability of a tumble."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from bench.sequence.method import OUTPUT, MethodDescription, NamedPart, Units
from bench.sequence.per_degree import BiasPerDegree, ScalePerDegree
from drivers.schema.fields import Celsius, InUnit, WholeNumber


class TemperatureTumbleSettings(BiasPerDegree, ScalePerDegree):
    """Settings of the static temperature tumble."""

    degree: Annotated[WholeNumber, Field(ge=1, le=4)] = Field(
        4, description="degree of the polynomials over temperature"
    )
    reference_c: Celsius = Field(
        20.0, alias="reference", description="reference temperature of K0T1, K0T2, K1T1 and K1T2"
    )
    closure_limit_g: Annotated[float, InUnit("g", above=0)] = Field(
        100e-6,
        alias="closure_limit",
        description="maximum change of the bias from the first dwell to the last, both at one set point; "
        "beyond it every verdict is marginal",
    )


UNITS: Units = {
    "K0": ("g", "µg"),
    "K1": f"{OUTPUT}/g",
    "K1_si": f"{OUTPUT}/(m/s²)",
    "K2": ("g/g²", "µg/g²"),
    "misalignment": ("rad", "µrad"),
    "K0/temperature_coefficient": ("g/°C", "µg/°C"),
    "K1/temperature_coefficient": ("1/°C", "ppm/°C"),
    "K0T1": ("g/°C", "µg/°C"),
    "K0T2": ("g/°C²", "µg/°C²"),
    "K1T1": ("1/°C", "ppm/°C"),
    "K1T2": ("1/°C²", "ppm/°C²"),
    "K3": ("g/g³", "µg/g³"),
    "Kip": ("g/g²", "µg/g²"),
    "Kio": ("g/g²", "µg/g²"),
    "misalignment_y": ("rad", "µrad"),
    "asymmetry": ("1", "ppm"),
    "K0/loop": ("g", "µg"),
    "K0/hysteresis": ("g", "µg"),
    "K0/closure": ("g", "µg"),
    "K1/loop": ("1", "ppm"),
    "K1/hysteresis": ("1", "ppm"),
    "K0/model_residual": ("g", "µg"),
    "K1/model_residual": ("1", "ppm"),
    "tilt/uncompensated": "°",
    "tilt/compensated": "°",
}
TEMPERATURE_TUMBLE = MethodDescription(
    name="temperature_tumble",
    title="Static temperature tumble (method M4a)",
    target="bench.methods.tumble.reduction.run:reduce",
    rules="bench.methods.tumble.rules:RULES",
    words="bench.methods.tumble.words:WORDS",
    offline="bench.methods.tumble.offline:REDUCTIONS",
    settings=TemperatureTumbleSettings,
    quantities=UNITS,
    parts=(NamedPart("cycle", "loop", "the number of a cycle; needed if the same temperatures come more than once"),),
    drawn_by="bench.methods.tumble.shown:tumble_shown",
    after=("IEEE Std 1293", "IEEE Std 530", "IEEE Std 1554"),
)


class RepeatabilitySettings(BiasPerDegree):
    """Settings of the repeatability: prior knowledge of the unit."""


REPEATABILITY_UNITS: Units = {
    "K0/sd": ("g", "µg"),
    "K1/sd": ("1", "ppm"),
    "misalignment/sd": ("rad", "µrad"),
    "K0/closure": ("g", "µg"),
}
REPEATABILITY = MethodDescription(
    name="repeatability",
    title="Repeatability over remountings or power cycles",
    target="bench.methods.tumble.reduction.repeatability:reduce",
    rules="bench.methods.tumble.rules:RULES",
    words="bench.methods.tumble.words:WORDS",
    settings=RepeatabilitySettings,
    quantities=REPEATABILITY_UNITS,
    first_dwell=1,
    drawn_by="bench.methods.tumble.shown_repeatability:repeated_shown",
)


class VerifyCompensationSettings(ScalePerDegree):
    """Settings of the verification of a calibration: prior knowledge of the unit."""


VERIFICATION_UNITS: Units = {
    "K0/left": ("g", "µg"),
    "K1/left": ("1", "ppm"),
    "K0/left_largest": ("g", "µg"),
    "K1/left_largest": ("1", "ppm"),
    "tilt/left_largest": "°",
    "tilt/verified": "°",
    "tilt_of_two/uncompensated": "°",
    "tilt_of_two/verified": "°",
    "tilt_of_two/left_largest": "°",
    "tilt_of_two/skew": ("rad", "µrad"),
}
VERIFY_COMPENSATION = MethodDescription(
    name="verify_compensation",
    title="Verification of a calibration over temperature, out of sample (method M4)",
    target="bench.methods.tumble.reduction.verification:reduce",
    rules="bench.methods.tumble.rules:RULES",
    words="bench.methods.tumble.words:WORDS",
    settings=VerifyCompensationSettings,
    quantities=VERIFICATION_UNITS,
    needs_calibration=True,
    meaning=(
        "The output of the unit is converted by its released calibration from an earlier run, at the temperatures of "
        "its own thermometer. What is left is the error of a user of the unit who compensates it: bias and relative "
        "scale factor at each dwell, and the tilt that a level unit would indicate. The uncertainty is that of this "
        "measurement."
    ),
    after=("IEEE Std 1293",),
)
