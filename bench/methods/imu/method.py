"""Descriptions of the methods for inertial units (method M2)."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from bench.sequence.method import CIRCUIT_OUTPUT, GYRO_OUTPUT, OUTPUT, MethodDescription, Units
from bench.sequence.per_degree import BiasPerDegree, ScalePerDegree
from drivers.schema.fields import InUnit, PositiveSeconds, Ratio, StrictModel

MEANING = (
    "Each accelerometer is measured together with its converter. K0, in units of local g, contains K2 and the "
    "converter's zero, because it is the mean over attitudes with the axis up and down; K1 contains K3. D0 is the "
    "mean over the same attitudes, in which earth rate and g-sensitivity along the axis cancel. Misalignments are "
    "relative to the axes of the table, and contain the seating of the unit in its fixture."
)


START_UP_MEANING = (
    "The unit's output is compensated by its released calibration, at the temperature of its own thermometers, as by "
    "its users. The residual zero and scale factor are the errors of the compensated unit, including those of its "
    "calibration; constants and exponentials are fitted to them from power-on."
)

CHANGES = {  # of the constants of a sensor
    "K0": ("g", "µg"), "K1": ("1", "ppm"), "D0": ("°/s", "°/h"), "KG": ("1", "ppm"),
}  # fmt: skip
UNITS: Units = {
    "K0": ("g", "µg"),
    "K1": f"{OUTPUT}/g",
    "K1_si": f"{OUTPUT}/(m/s²)",
    "K2": ("g/g²", "µg/g²"),
    "misalignment": ("rad", "µrad"),
    "D0": ("°/s", "°/h"),
    "KG": f"{GYRO_OUTPUT}/(°/s)",
    "gyro_misalignment": ("rad", "µrad"),
    "g_sensitivity": ("°/s/g", "°/h/g"),
    **{
        f"{quantity}/{what}": units
        for quantity, units in CHANGES.items()
        for what in ("change", "interpolation", "repeatability")
    },
    **{f"N/{what}": OUTPUT for what in ("change", "left")},
    **{f"W/{what}": GYRO_OUTPUT for what in ("change", "left")},
    "circuit/nominal": CIRCUIT_OUTPUT,
    "circuit/deviation": "°C",
    "K0/closure": ("g", "µg"),
    "level/closure": ("rad", "µrad"),
}
START_UP_UNITS: Units = {
    f"{quantity}/{what}": units
    for quantity, own in CHANGES.items()
    for what, units in (("power_on", own), ("warm", own), ("settling", ("s", "min")))
}


class ImuCalibrationSettings(BiasPerDegree, ScalePerDegree):
    """Settings of the calibration of an inertial unit."""

    gyro_bias_per_c_u: Annotated[float, InUnit("°/s/°C", at_least=0)] = Field(
        1e-5,
        alias="gyro_bias_per_degree_u",
        description="standard uncertainty of the change of the bias of a gyro with 1 °C",
    )

    nominal_c: Annotated[float, InUnit("°C")] | None = Field(
        None,
        alias="nominal",
        description="nominal temperature of the sensors, to which outputs are regressed; by default that of each "
        "sensor at the first set point",
    )
    gradient_limit_c: Annotated[float, InUnit("°C", above=0)] = Field(
        5.0,
        alias="gradient_limit",
        description="maximum deviation of the thermometer of a sensor from those of its triad; beyond it, it is not at "
        "its sensor",
    )
    attitude_tolerance_g: Annotated[float, InUnit("g", above=0)] = Field(
        0.05,
        alias="attitude_tolerance",
        description="maximum deviation of a reading from the others of its kind; beyond it the unit was in another "
        "attitude",
    )
    dead_band_g: Annotated[float, InUnit("g", at_least=0)] = Field(
        40e-6,
        alias="dead_band",
        description="dead band ± of the converters of counted accelerometers, with the noise of their input; level "
        "readings below it are left out of K2 and misalignment",
    )
    rate_tolerance: Annotated[Ratio, InUnit("", above=0, at_most=1)] = Field(
        0.1, description="maximum deviation of the table from the commanded rate"
    )
    closure_limit_g: Annotated[float, InUnit("g", above=0)] = Field(
        100e-6,
        alias="closure_limit",
        description="maximum change of the bias of an accelerometer over the run; beyond it every verdict is marginal",
    )
    level_limit_rad: Annotated[float, InUnit("rad", above=0)] = Field(
        50e-6,
        alias="level_limit",
        description="maximum change of the tilt of the table over the run; beyond it every verdict is marginal",
    )


IMU_CALIBRATION = MethodDescription(
    name="imu_calibration",
    title="Temperature calibration of an inertial unit (method M2)",
    target="bench.methods.imu.reduction.run:reduce",
    settings=ImuCalibrationSettings,
    quantities=UNITS,
    counts_at="windows",
    measures=("inertial unit",),
    meaning=MEANING,
    closes=True,
    drawn_by="bench.methods.imu.shown:imu_plots",
    rules="bench.methods.imu.rules:RULES",
    words="bench.methods.imu.words:WORDS",
    spans="bench.methods.imu.shown:visits",
    offline="bench.methods.imu.offline:REDUCTIONS",
)


class ImuStartUpSettings(StrictModel):
    """Settings of the start-up of a compensated inertial unit: limits of its errors, model of their time history."""

    accelerometer_zero_g: Annotated[float, InUnit("g", above=0)] = Field(
        30e-6, alias="accelerometer_zero", description="limit ± of the residual bias of an accelerometer"
    )
    accelerometer_scale: Annotated[Ratio, InUnit("", above=0)] = Field(
        50e-6, description="limit ± of the scale factor error of an accelerometer"
    )
    gyro_zero_dps: Annotated[float, InUnit("°/s", above=0)] = Field(
        5e-5, alias="gyro_zero", description="limit ± of the residual zero of a gyro"
    )
    gyro_scale: Annotated[Ratio, InUnit("", above=0)] = Field(
        50e-6, description="limit ± of the scale factor error of a gyro"
    )
    time_constants_s: Annotated[tuple[PositiveSeconds, ...], Field(min_length=1, max_length=4)] = Field(
        (300.0, 900.0, 2700.0),
        alias="time_constants",
        description="time constants of the fitted exponentials; their range covers the warm-up of the unit",
    )
    misalignment_rad: Annotated[float, InUnit("rad", at_least=0)] = Field(
        1e-3, alias="misalignment", description="maximum misalignment of a gyro, for its share of the earth rate"
    )


IMU_START_UP = MethodDescription(
    name="imu_start_up",
    title="Start-up of a compensated inertial unit (method M2)",
    target="bench.methods.imu.start_up.run:reduce",
    settings=ImuStartUpSettings,
    quantities=START_UP_UNITS,
    counts_at="windows",
    measures=("inertial unit",),
    meaning=START_UP_MEANING,
    drawn_by="bench.methods.imu.start_up.shown:start_up_plots",
    needs_calibration=True,
    words="bench.methods.imu.words:WORDS",
    rules="bench.methods.imu.rules:RULES",
)
