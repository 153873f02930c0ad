"""The methods for inertial units as a sequence sees them (method M2)."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from bench.sequence.methods import MethodDescription
from drivers.fields import InUnit, Ratio, StrictModel

MEANING = (
    "Each accelerometer is measured together with its converter. K0, in units of local g, contains K2 and the "
    "converter's zero, for it is the mean over attitudes in which the axis points up and down; K1 contains K3. D0 is "
    "the mean over the same attitudes, in which earth rate and g-sensitivity along the axis cancel. Misalignments are "
    "those against the axes of the table, and contain how the unit sits in its fixture."
)


class ImuCalibrationSettings(StrictModel):
    """Settings of the calibration of an inertial unit."""

    attitude_tolerance_g: Annotated[float, InUnit("g", above=0)] = Field(
        0.05,
        alias="attitude_tolerance",
        description="how far a reading may be from the others of its kind; beyond it the unit stood otherwise",
    )
    rate_tolerance: Annotated[Ratio, InUnit("", above=0, at_most=1)] = Field(
        0.1, description="how far from the rate that was asked for the table may have turned"
    )


IMU_CALIBRATION = MethodDescription(
    name="imu_calibration",
    title="Temperature calibration of an inertial unit (method M2)",
    target="bench.analysis.imu_run:reduce",
    settings=ImuCalibrationSettings,
    quantities={
        "K0": "g",
        "K1": "pulse/s/g",
        "K1_si": "pulse/s/(m/s²)",
        "K2": "g/g²",
        "misalignment": "rad",
        "D0": "°/s",
        "KG": "pulse/°",
        "gyro_misalignment": "rad",
        "g_sensitivity": "°/s/g",
        **{
            f"{quantity}/{what}": unit
            for quantity, unit in {"K0": "g", "K1": "1", "D0": "°/s", "KG": "1"}.items()
            for what in ("change", "interpolation", "repeatability")
        },
    },
    counts_at="windows",
    measures="inertial unit",
    meaning=MEANING,
    drawn_by="bench.report.imu_plots:imu_plots",
)
