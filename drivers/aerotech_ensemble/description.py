"""What a bench file says of an indexing head on an Aerotech Ensemble."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drivers.description import DriverDescription
from drivers.fields import (
    Arcseconds,
    Degrees,
    DegreesPerSecond,
    InUnit,
    PositiveSeconds,
    Range,
    StrictModel,
    TextLike,
)


class SettleOptions(StrictModel):
    """When the axis stands."""

    band: Annotated[float, InUnit("arcsec", above=0)] = Field(description="how far from the target it may be")
    hold: PositiveSeconds = Field(description="how long it must have been no farther away")
    give_up: PositiveSeconds = Field(30.0, description="so long after it should stand, it is an error that it does not")


class EnsembleOptions(StrictModel):
    """How the axis is moved; from `rate` and `acceleration` follows how long a move may take."""

    axis: Annotated[str, TextLike("[A-Za-z][A-Za-z0-9_]{0,15}", "the name of an axis such as X")] = Field(
        "X", description="as the controller calls it"
    )
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


class RateRange(StrictModel):
    """The fastest move: `max`."""

    max: DegreesPerSecond


class EnsembleLimits(StrictModel):
    """What the bench allows the axis; the controller's own limits hold as well."""

    angle: AngleRange
    rate: RateRange


class EnsembleUncertainty(StrictModel):
    """What a certificate states of the axis, expanded."""

    zero: Arcseconds = Field(0.0, description="of the angle 0°")
    harmonics: tuple[Arcseconds, ...] = Field((), description="1, 2, … of the error over a turn")
    repeatability: Arcseconds = Field(0.0, description="of coming to the same angle again")


DESCRIPTION = DriverDescription(
    name="aerotech_ensemble",
    title="indexing head or rotary stage on an Aerotech Ensemble",
    capabilities=frozenset({"positioner"}),
    schemes=frozenset({"tcp"}),
    target="drivers.aerotech_ensemble.driver:AerotechEnsemble",
    options=EnsembleOptions,
    limits=EnsembleLimits,
    uncertainty=EnsembleUncertainty,
    channels={"angle": "°"},
)
