"""What descriptions of heads and tables share: settling, maximum rate, certificate."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drivers.schema.fields import Arcseconds, DegreesPerSecond, InUnit, PositiveSeconds, StrictModel

FAR_AWAY_POLL_S = 0.5  # how often a move is looked at while its end is far away


def pause_s(poll_s: float, left_s: float) -> float:
    """How long to wait before a move is looked at again whose end is about `left_s` away; never less than `poll_s`."""
    return max(poll_s, min(left_s / 2, FAR_AWAY_POLL_S))


class SettleOptions(StrictModel):
    """When the axis stands."""

    band: Annotated[float, InUnit("arcsec", above=0)] = Field(description="how far from the target it may be")
    hold: PositiveSeconds = Field(description="how long it must have been no farther away")
    give_up: PositiveSeconds = Field(
        30.0, description="time after the expected end of a motion at which an unfinished motion is an error"
    )


class RateRange(StrictModel):
    """The fastest turning, either way: `max`."""

    max: DegreesPerSecond


class AxisUncertainty(StrictModel):
    """What a certificate states of the axis, expanded."""

    zero: Arcseconds = Field(0.0, description="of the angle 0°")
    harmonics: tuple[Arcseconds, ...] = Field((), description="1, 2, … of the error over a turn")
    repeatability: Arcseconds = Field(0.0, description="of coming to the same angle again from the same side")
    backlash: Arcseconds | None = Field(None, description="between coming to an angle from above and from below")
    wobble: Arcseconds = Field(0.0, description="by how much the axis tilts to and fro once a turn")
