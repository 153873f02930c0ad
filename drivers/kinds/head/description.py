"""Bench file keys of an indexing head, whatever controller it has."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drivers.kinds.axes import RateRange, SettleOptions
from drivers.safe_state import SafeState, at_rest
from drivers.schema.fields import Degrees, DegreesPerSecond, InUnit, Range, StrictModel
from drivers.timing.busy import BUSY_S


class HeadOptions(StrictModel):
    """How the axis is moved; from `rate` and `acceleration` follows how long a move may take."""

    rate: DegreesPerSecond = Field(description="of every move")
    settle: SettleOptions
    approach_distance: Annotated[float, InUnit("°", above=0, at_most=30)] = Field(
        2.0, description="how far from its target an approach from one side begins"
    )
    acceleration: Annotated[float, InUnit("°/s²", above=0)] = Field(40.0, description="the controller's own setting")
    poll: Annotated[float, InUnit("s", above=0, at_most=5)] = Field(
        0.1, description="how often an axis that has nearly arrived is looked at"
    )


class AngleRange(Range):
    """From `min` to `max`, both allowed; not taken modulo a turn, since cables are not."""

    min: Degrees
    max: Degrees


class HeadLimits(StrictModel):
    """What the bench allows the axis; the controller's own limits hold as well."""

    angle: AngleRange
    rate: RateRange


def busy_s(options: HeadOptions, limits: HeadLimits) -> float:
    """The longest move, with an approach from one side, where the controller answers at its end; and a dialogue."""
    way_deg = limits.angle.max - limits.angle.min + 2 * options.approach_distance
    settle = options.settle
    return BUSY_S + way_deg / options.rate + 2 * options.rate / options.acceleration + settle.hold + settle.give_up


def safe_state(options: HeadOptions, limits: HeadLimits, _safe: object) -> SafeState:
    """At rest, from the fastest rate that the bench file allows."""
    return at_rest(limits.rate.max, options.acceleration)
