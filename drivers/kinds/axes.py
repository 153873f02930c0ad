"""Common parts of descriptions of heads and tables: settling, maximum rate, certificate."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drivers.schema.fields import Arcseconds, DegreesPerSecond, InUnit, PositiveSeconds, StrictModel


class SettleOptions(StrictModel):
    """Settling criterion of an axis."""

    band: Annotated[float, InUnit("arcsec", above=0)] = Field(description="how far from the target it may be")
    hold: PositiveSeconds = Field(description="how long it must have been no farther away")
    give_up: PositiveSeconds = Field(
        30.0, description="time after the expected end of a motion at which an unfinished motion is an error"
    )


class RateRange(StrictModel):
    """Maximum rate in either direction: `max`."""

    max: DegreesPerSecond


class AxisUncertainty(StrictModel):
    """Expanded uncertainty of the axis, from its certificate."""

    zero: Arcseconds = Field(0.0, description="of the angle 0°")
    harmonics: tuple[Arcseconds, ...] = Field((), description="1, 2, … of the error over a turn")
    repeatability: Arcseconds = Field(0.0, description="of coming to the same angle again from the same side")
    backlash: Arcseconds | None = Field(None, description="between coming to an angle from above and from below")
    wobble: Arcseconds = Field(0.0, description="by how much the axis tilts to and fro once a turn")
