"""Bench file keys of an indexing head with any controller."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drivers.kinds.axes import RateRange, SettleOptions
from drivers.safe_state import SafeState, at_rest
from drivers.schema.fields import Degrees, DegreesPerSecond, InUnit, Range, StrictModel
from drivers.timing.busy import BUSY_S


class HeadOptions(StrictModel):
    """Motion settings of the axis; the time limit of a move follows from `rate` and `acceleration`."""

    rate: DegreesPerSecond = Field(description="of all moves")
    settle: SettleOptions
    approach_distance: Annotated[float, InUnit("°", above=0, at_most=30)] = Field(
        2.0, description="distance from the target at which an approach from one side begins"
    )
    acceleration: Annotated[float, InUnit("°/s²", above=0)] = Field(40.0, description="the controller's own setting")
    poll: Annotated[float, InUnit("s", above=0, at_most=5)] = Field(
        0.1, description="poll interval near the end of a move"
    )


class AngleRange(Range):
    """From `min` to `max`, inclusive; not modulo a turn, because cables wind up."""

    min: Degrees
    max: Degrees


class HeadLimits(StrictModel):
    """Limits of the axis on this bench; the controller's own limits apply as well."""

    angle: AngleRange
    rate: RateRange


def busy_s(options: HeadOptions, limits: HeadLimits) -> float:
    """Duration of the longest move, with an approach from one side, answered at its end; plus a dialogue."""
    way_deg = limits.angle.max - limits.angle.min + 2 * options.approach_distance
    settle = options.settle
    return BUSY_S + way_deg / options.rate + 2 * options.rate / options.acceleration + settle.hold + settle.give_up


def safe_state(options: HeadOptions, limits: HeadLimits, _safe: object) -> SafeState:
    """At rest, from the maximum rate of the bench file."""
    return at_rest(limits.rate.max, options.acceleration)
