"""Bench file keys of a chamber with an ESPEC P300 or SCP-220."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drivers.kinds.chamber.description import SteppedRampOptions
from drivers.kinds.described import thermal_chamber
from drivers.schema.fields import WholeNumber


class P300Options(SteppedRampOptions):
    """Protocol settings and ramp of the controller."""

    address: Annotated[WholeNumber, Field(ge=1, le=16)] | None = Field(
        None, description="address on an RS-485 line; none on RS-232 and TCP"
    )


DESCRIPTION = thermal_chamber(
    name="espec_p300",
    title="thermal chamber with an ESPEC P300 or SCP-220",
    schemes=frozenset({"serial", "socket", "tcp"}),
    target="drivers.dialects.espec_p300.controller:EspecP300",
    simulator="simulators.instruments.chambers.espec_p300:SimulatedP300",
    recognition="drivers.dialects.espec_p300.recognition:RECOGNITION",
    options=P300Options,
)
