"""Bench file keys of a CTS chamber."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from drivers.dialects.cts.wire import ADDRESSES, RampChannel
from drivers.kinds.chamber.description import ChamberOptions
from drivers.kinds.described import thermal_chamber
from drivers.schema.fields import Flag, WholeNumber


class CtsOptions(ChamberOptions):
    """Protocol settings of the chamber. Its line is 19200 baud with odd parity: `?baud=19200&parity=O`."""

    address: Annotated[WholeNumber, Field(ge=ADDRESSES[0], le=ADDRESSES[-1])] = Field(
        1, description="address of the chamber; 1 is 81 hexadecimal on the wire"
    )
    ramp_channel: RampChannel = Field(1, description="number of the temperature channel in ramp commands")
    versions: Flag = Field(True, description="false for a chamber that does not report versions")


DESCRIPTION = thermal_chamber(
    name="cts",
    title="thermal chamber of CTS, ASCII protocol",
    schemes=frozenset({"serial", "socket"}),
    target="drivers.dialects.cts.controller:Cts",
    simulator="simulators.instruments.chambers.cts:SimulatedCts",
    recognition="drivers.dialects.cts.recognition:RECOGNITION",
    options=CtsOptions,
)
