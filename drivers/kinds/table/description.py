"""Bench file keys of a rate table with any controller."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from drivers.kinds.axes import RateRange, SettleOptions
from drivers.safe_state import SafeState, at_rest
from drivers.schema.fields import Degrees, DegreesPerSecond, Hertz, InUnit, Range, StrictModel
from drivers.schema.wording import telling
from drivers.timing.busy import BUSY_S

TURN_DEG = 360.0
DegreesPerSecondSquared = Annotated[float, InUnit("°/s²", above=0)]


class TableOptions(StrictModel):
    """Motion settings of the axis."""

    rate: DegreesPerSecond = Field(description="of all moves")
    acceleration: DegreesPerSecondSquared = Field(
        description="of moves, of stops, and of changes of rate without another value"
    )
    settle: SettleOptions
    rate_band: DegreesPerSecond = Field(
        0.01, description="maximum deviation from the commanded rate, and maximum rate at rest"
    )
    approach_distance: Annotated[float, InUnit("°", above=0, at_most=30)] = Field(
        2.0, description="distance from the target at which an approach from one side begins"
    )
    poll: Annotated[float, InUnit("s", above=0, at_most=5)] = Field(0.1, description="poll interval of a motion")
    encoder_resolution: Annotated[float, InUnit("arcsec", above=0)] | None = Field(
        None, description="one count of the encoder; a sine must span enough of them"
    )
    inertia: Annotated[float, InUnit("kg·m²", above=0)] | None = Field(
        None, description="of table and load; with limits.torque it bounds the acceleration of a sine"
    )


class AngleRange(Range):
    """From `min` to `max`, inclusive; less than a turn apart, because the controller reports angles within one."""

    min: Degrees
    max: Degrees

    @model_validator(mode="after")
    def _within_a_turn(self) -> Self:
        if self.max - self.min >= 360:
            raise telling("min and max are a turn or more apart; leave limits.angle out for an axis without ends")
        return self


class AccelerationRange(StrictModel):
    """Maximum rate of change of the rate: `max`."""

    max: DegreesPerSecondSquared


class FrequencyRange(StrictModel):
    """Maximum frequency of a sine: `max`."""

    max: Hertz


class TorqueRange(StrictModel):
    """Maximum torque demanded of the motor: `max`."""

    max: Annotated[float, InUnit("N·m", above=0)]


class TableLimits(StrictModel):
    """Limits of the axis on this bench; the controller's own limits apply as well."""

    angle: AngleRange | None = Field(None, description="without it the axis has no ends")
    rate: RateRange
    acceleration: AccelerationRange
    frequency: FrequencyRange
    torque: TorqueRange | None = Field(
        None, description="maximum torque of a sine, computed from options.inertia by the check"
    )


def busy_s(options: TableOptions, limits: TableLimits) -> float:
    """Duration of the longest move or change of rate; plus a dialogue."""
    way_deg = TURN_DEG if limits.angle is None else limits.angle.max - limits.angle.min
    motion_s = (way_deg + 2 * options.approach_distance) / options.rate + 2 * limits.rate.max / options.acceleration
    return BUSY_S + motion_s + options.settle.hold + options.settle.give_up


def safe_state(options: TableOptions, limits: TableLimits, _safe: object) -> SafeState:
    """At rest, from the maximum rate of the bench file."""
    return at_rest(limits.rate.max, options.acceleration)
