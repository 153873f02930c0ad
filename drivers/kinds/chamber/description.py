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

DIALOGUE_S = 7.0  # the time of any device, and that of reading back the active set point

LONGEST_HOLD_S = 12 * 3600.0

CHANNELS = {"process_value": "°C", "set_point": "°C"}


class FollowOptions(StrictModel):
    """Required progress of the air to its set point; a chamber that does not follow is a fault, and the run ends."""

    band: PositiveCelsius = Field(3.0, description="half width of the band around a constant set point after settling")
    gain: PositiveCelsius = Field(1.0, description="minimum approach in every `over` while outside the band")
    over: Annotated[float, InUnit("s", at_least=60, at_most=7200)] = Field(
        600.0, description="time in which it must approach by `gain`"
    )
    settle: PositiveSeconds = Field(
        3600.0, description="the longest settling time after the set point has become constant, or after a disturbance"
    )


class ChamberOptions(StrictModel):
    """Protocol settings of any controller, and abilities of its chamber."""

    poll: Annotated[float, InUnit("s", above=0, at_most=30)] = Field(
        1.0, description="poll interval near the end of a ramp"
    )
    answer_timeout: PositiveSeconds = Field(3.0, description="timeout of an answer")
    follow: FollowOptions = FollowOptions()


class SteppedRampOptions(ChamberOptions):
    """Additional options of controllers that the driver ramps by a series of set points."""

    step: Annotated[float, InUnit("s", at_least=10, at_most=120)] = Field(
        15.0, description="time between set points during a ramp; frequent writes wear out the controller's memory"
    )


class TemperatureRange(Range):
    """From `min` to `max`, inclusive."""

    min: Celsius
    max: Celsius


class RampRateRange(StrictModel):
    """Maximum ramp rate: `max`."""

    max: CelsiusPerMinute


class ChamberLimits(StrictModel):
    """Limits of the chamber on this bench; the controller's own limits apply as well."""

    temperature: TemperatureRange
    ramp_rate: RampRateRange


class ChamberSafe(StrictModel):
    """Set point when the bench is made safe."""

    temperature: Celsius = Field(25.0, description="the set point")
    hold: Annotated[float, InUnit("s", at_least=0, at_most=LONGEST_HOLD_S)] = Field(
        0.0,
        description="how long it stays as it is before, after a run that failed or was lost, so that another goes on "
        "without a new soak; its guardian ends this",
    )


def safe_state(options: ChamberOptions, _limits: ChamberLimits, safe: ChamberSafe) -> SafeState:
    """Set point in the controller, read back, with one answer as late as `answer_timeout`; the air arrives later."""
    return SafeState(f"set point {safe.temperature:g} °C", DIALOGUE_S + options.answer_timeout, hold_s=safe.hold)
