"""Bench file keys of a chamber with a Watlow F4T."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drivers.kinds.chamber.description import ChamberOptions
from drivers.kinds.chamber.words import WordOrder
from drivers.kinds.described import thermal_chamber
from drivers.schema.fields import Flag, WholeNumber


class F4TOptions(ChamberOptions):
    """Protocol settings of the controller."""

    unit_id: Annotated[WholeNumber, Field(ge=1, le=247)] = Field(1, description="Modbus address")
    loop: Annotated[WholeNumber, Field(ge=1, le=4)] = Field(1, description="the control loop of the chamber")
    word_order: WordOrder = Field("low_first", description="word order, as set in the controller")
    block_reads: Flag = Field(
        True, description="false for a controller or gateway that refuses requests over several values"
    )


DESCRIPTION = thermal_chamber(
    name="watlow_f4t",
    title="thermal chamber with a Watlow F4T, Modbus TCP or RTU",
    schemes=frozenset({"tcp", "serial", "socket"}),
    target="drivers.dialects.watlow_f4t.controller:WatlowF4T",
    simulator="simulators.instruments.chambers.watlow_f4t:SimulatedF4T",
    recognition="drivers.dialects.watlow_f4t.recognition:RECOGNITION",
    options=F4TOptions,
)
