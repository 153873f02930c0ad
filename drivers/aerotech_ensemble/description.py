"""What a bench file says of an indexing head on an Aerotech Ensemble."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drivers.axes import AxisUncertainty, RateRange, SettleOptions
from drivers.corrections import AxisCorrections
from drivers.description import DriverDescription
from drivers.fields import (
    Degrees,
    DegreesPerSecond,
    InUnit,
    Range,
    StrictModel,
    TextLike,
)


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


class EnsembleLimits(StrictModel):
    """What the bench allows the axis; the controller's own limits hold as well."""

    angle: AngleRange
    rate: RateRange


DESCRIPTION = DriverDescription(
    name="aerotech_ensemble",
    title="indexing head or rotary stage on an Aerotech Ensemble",
    capabilities=frozenset({"positioner"}),
    schemes=frozenset({"tcp"}),
    target="drivers.aerotech_ensemble.driver:AerotechEnsemble",
    simulator="simulators.aerotech_ensemble:SimulatedEnsemble",
    options=EnsembleOptions,
    limits=EnsembleLimits,
    uncertainty=AxisUncertainty,
    corrections=AxisCorrections,
    channels={"angle": "°"},
)
