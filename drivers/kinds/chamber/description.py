"""Bench file keys of every thermal chamber."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drivers.safe_state import SafeState
from drivers.schema.fields import (
    Celsius,
    CelsiusPerMinute,
    InUnit,
    PositiveCelsius,
    PositiveSeconds,
    Range,
    StrictModel,
)

DIALOGUE_S = 7.0  # as of any device, and to read back what the controller follows

LONGEST_HOLD_S = 12 * 3600.0

CHANNELS = {"process_value": "°C", "set_point": "°C"}


class FollowOptions(StrictModel):
    """How the air of a chamber in order follows its set point; what does not is a fault, and the run ends."""

    band: PositiveCelsius = Field(3.0, description="how near to a set point at rest it stays once it has settled")
    gain: PositiveCelsius = Field(
        1.0, description="by how much it must approach in every `over` while it is outside the band"
    )
    over: Annotated[float, InUnit("s", at_least=60, at_most=7200)] = Field(
        600.0, description="the time in which it must approach by `gain`"
    )
    settle: PositiveSeconds = Field(
        3600.0, description="the longest settling time after the set point has become constant, or after a disturbance"
    )


class ChamberOptions(StrictModel):
    """How any controller is spoken to, and what its chamber is able to do."""

    poll: Annotated[float, InUnit("s", above=0, at_most=30)] = Field(
        1.0, description="how often a ramp that has nearly arrived is looked at"
    )
    answer_timeout: PositiveSeconds = Field(3.0, description="how long an answer may take")
    follow: FollowOptions = FollowOptions()


class StairOptions(ChamberOptions):
    """As well, for controllers that the driver ramps by many set points, one after the other."""

    step: Annotated[float, InUnit("s", at_least=10, at_most=120)] = Field(
        15.0, description="time between set points during a ramp; frequent writes wear out the controller's memory"
    )


class TemperatureRange(Range):
    """From `min` to `max`, both allowed."""

    min: Celsius
    max: Celsius


class RampRateRange(StrictModel):
    """The fastest ramp: `max`."""

    max: CelsiusPerMinute


class ChamberLimits(StrictModel):
    """What the bench allows the chamber; the controller's own limits hold as well."""

    temperature: TemperatureRange
    ramp_rate: RampRateRange


class ChamberSafe(StrictModel):
    """Where the set point goes when the bench is made safe."""

    temperature: Celsius = Field(25.0, description="the set point")
    hold: Annotated[float, InUnit("s", at_least=0, at_most=LONGEST_HOLD_S)] = Field(
        0.0,
        description="how long it stays as it is before, after a run that failed or was lost, so that another goes on "
        "without a new soak; its guardian ends this",
    )


def safe_state(options: ChamberOptions, _limits: ChamberLimits, safe: ChamberSafe) -> SafeState:
    """The set point in the controller, read back, with one answer as late as `answer_timeout`; not the air at it."""
    return SafeState(f"set point {safe.temperature:g} °C", DIALOGUE_S + options.answer_timeout, hold_s=safe.hold)
