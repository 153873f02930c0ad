"""Bench file keys of a chamber with a Watlow F4 S or D."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drivers.dialects.watlow_f4.wire import EVENT_OUTPUTS
from drivers.kinds.chamber.description import SteppedRampOptions
from drivers.kinds.described import thermal_chamber
from drivers.schema.fields import WholeNumber


class F4Options(SteppedRampOptions):
    """Protocol settings of the controller."""

    unit_id: Annotated[WholeNumber, Field(ge=1, le=247)] = Field(1, description="Modbus address")
    power_event: Annotated[WholeNumber, Field(ge=1, le=EVENT_OUTPUTS)] | None = Field(
        None, description="event output that switches the chamber on, if there is one"
    )


DESCRIPTION = thermal_chamber(
    name="watlow_f4",
    title="thermal chamber with a Watlow F4 S or D, Modbus RTU",
    schemes=frozenset({"serial", "socket"}),
    target="drivers.dialects.watlow_f4.controller:WatlowF4",
    simulator="simulators.instruments.chambers.watlow_f4:SimulatedF4",
    recognition="drivers.dialects.watlow_f4.recognition:RECOGNITION",
    options=F4Options,
)
