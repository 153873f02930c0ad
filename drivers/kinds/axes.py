"""Common parts of descriptions of heads and tables: settling, maximum rate, certificate."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drivers.schema.fields import Arcseconds, DegreesPerSecond, InUnit, PositiveSeconds, StrictModel


class SettleOptions(StrictModel):
    """Settling criterion of an axis."""

    band: Annotated[float, InUnit("arcsec", above=0)] = Field(description="half width of the band around the target")
    hold: PositiveSeconds = Field(description="time that it must stay in the band")
    give_up: PositiveSeconds = Field(
        30.0, description="time after the expected end of a motion at which an unfinished motion is an error"
    )


class RateRange(StrictModel):
    """Maximum rate in either direction: `max`."""

    max: DegreesPerSecond


class AxisUncertainty(StrictModel):
    """Expanded uncertainty of the axis, from its certificate."""

    zero: Arcseconds = Field(0.0, description="uncertainty of the angle 0°")
    harmonics: tuple[Arcseconds, ...] = Field((), description="harmonics 1, 2, … of the error over a turn")
    repeatability: Arcseconds = Field(0.0, description="repeatability of an angle from the same side")
    backlash: Arcseconds | None = Field(None, description="difference of an angle approached from above and from below")
    wobble: Arcseconds = Field(0.0, description="amplitude of the axis tilt, once per turn")
