"""Bench file keys of an indexing head on an Aerotech Ensemble."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drivers.kinds.described import indexing_head
from drivers.kinds.head.description import HeadOptions
from drivers.schema.fields import TextLike


class EnsembleOptions(HeadOptions):
    """Motion settings of the axis; the time limit of a move follows from `rate` and `acceleration`."""

    axis: Annotated[str, TextLike("[A-Za-z][A-Za-z0-9_]{0,15}", "the name of an axis such as X")] = Field(
        "X", description="name of the axis at the controller"
    )


DESCRIPTION = indexing_head(
    name="aerotech_ensemble",
    title="indexing head or rotary stage on an Aerotech Ensemble",
    schemes=frozenset({"serial", "socket", "tcp"}),
    target="drivers.dialects.aerotech_ensemble.axis:AerotechEnsemble",
    simulator="simulators.instruments.axes.aerotech_ensemble:SimulatedEnsemble",
    recognition="drivers.dialects.aerotech_ensemble.recognition:RECOGNITION",
    options=EnsembleOptions,
)
