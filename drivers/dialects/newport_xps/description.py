"""Bench file keys of an indexing head on a Newport XPS."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drivers.kinds.described import indexing_head
from drivers.kinds.head.description import HeadOptions
from drivers.schema.fields import InUnit, TextLike

Name = Annotated[str, TextLike("[A-Za-z][A-Za-z0-9_-]{0,31}", "a name such as HEAD")]


class XpsOptions(HeadOptions):
    """Motion settings of the axis; `rate` and `acceleration` are set in the controller before a move."""

    group: Name = Field(description="of the axis, as in the controller's system.ini; of a single axis or a spindle")
    positioner: Name = Field("Pos", description="of the group, as in system.ini")
    acceleration: Annotated[float, InUnit("°/s²", above=0)] = Field(40.0, description="of all moves")


DESCRIPTION = indexing_head(
    name="newport_xps",
    title="indexing head or rotary stage on a Newport XPS",
    schemes=frozenset({"tcp"}),
    target="drivers.dialects.newport_xps.axis:NewportXps",
    simulator="simulators.instruments.axes.newport_xps:SimulatedXps",
    recognition="drivers.dialects.newport_xps.recognition:RECOGNITION",
    options=XpsOptions,
)
