"""What a bench file says of an indexing head on an Aerotech Ensemble."""

from __future__ import annotations

from typing import Annotated

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
    """When the axis stands: within `band` of the target for `hold`; not there `give_up` after it should: NotSettled."""

    band: Annotated[float, InUnit("arcsec", above=0)]
    hold: PositiveSeconds
    give_up: PositiveSeconds = 30.0


class EnsembleOptions(StrictModel):
    """How the axis is moved.

    `approach_distance` is where an approach from one side begins. `acceleration` is the controller's own setting; from
    it and `rate` follows how long a move may take. `poll` is how often an axis that has nearly arrived is looked at.
    """

    axis: Annotated[str, TextLike("[A-Za-z][A-Za-z0-9_]{0,15}", "the name of an axis such as X")] = "X"
    rate: DegreesPerSecond
    settle: SettleOptions
    approach_distance: Annotated[float, InUnit("°", above=0, at_most=30)] = 2.0
    acceleration: Annotated[float, InUnit("°/s²", above=0)] = 40.0
    poll: Annotated[float, InUnit("s", above=0, at_most=5)] = 0.1


class AngleRange(Range):
    """From `min` to `max`, both allowed; not taken modulo a turn, since cables are not."""

    min: Degrees
    max: Degrees


class RateRange(StrictModel):
    """The fastest move."""

    max: DegreesPerSecond


class EnsembleLimits(StrictModel):
    """What the bench allows the axis; the controller's own limits hold as well."""

    angle: AngleRange
    rate: RateRange


class EnsembleUncertainty(StrictModel):
    """What a certificate states of the axis, expanded: `harmonics` 1, 2, … of the error over a turn."""

    zero: Arcseconds = 0.0
    harmonics: tuple[Arcseconds, ...] = ()
    repeatability: Arcseconds = 0.0


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
