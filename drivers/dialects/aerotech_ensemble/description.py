"""Bench file keys of an indexing head on an Aerotech Ensemble."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drivers.certificates.corrections import AxisCorrections
from drivers.description import DriverDescription
from drivers.kinds.axes import AxisUncertainty
from drivers.kinds.head.description import HeadLimits, HeadOptions, busy_s, safe_state
from drivers.schema.fields import TextLike


class EnsembleOptions(HeadOptions):
    """Motion settings of the axis; the time limit of a move follows from `rate` and `acceleration`."""

    axis: Annotated[str, TextLike("[A-Za-z][A-Za-z0-9_]{0,15}", "the name of an axis such as X")] = Field(
        "X", description="name of the axis at the controller"
    )


DESCRIPTION = DriverDescription(
    name="aerotech_ensemble",
    title="indexing head or rotary stage on an Aerotech Ensemble",
    capabilities=frozenset({"positioner"}),
    schemes=frozenset({"serial", "socket", "tcp"}),
    target="drivers.dialects.aerotech_ensemble.axis:AerotechEnsemble",
    simulator="simulators.instruments.axes.aerotech_ensemble:SimulatedEnsemble",
    recognition="drivers.dialects.aerotech_ensemble.recognition:RECOGNITION",
    options=EnsembleOptions,
    limits=HeadLimits,
    safe_state=safe_state,
    busy_s=busy_s,
    uncertainty=AxisUncertainty,
    corrections=AxisCorrections,
    channels={"angle": "°"},
)
