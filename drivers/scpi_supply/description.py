"""What a bench file says of a laboratory power supply."""

from __future__ import annotations

from typing import Annotated

from drivers.description import DriverDescription
from drivers.fields import InUnit, StrictModel


class VoltageRange(StrictModel):
    """The highest level: `max`."""

    max: Annotated[float, InUnit("V", above=0)]


class CurrentRange(StrictModel):
    """The highest current limit: `max`."""

    max: Annotated[float, InUnit("A", above=0)]


class SupplyLimits(StrictModel):
    """What the bench allows the supply, for the sake of the unit on it."""

    voltage: VoltageRange
    current: CurrentRange


DESCRIPTION = DriverDescription(
    name="scpi_supply",
    title="laboratory power supply with the common core of SCPI",
    capabilities=frozenset({"power_supply"}),
    schemes=frozenset({"serial", "socket", "tcp"}),
    target="drivers.scpi_supply.driver:ScpiSupply",
    simulator="simulators.scpi_supply:SimulatedSupply",
    limits=SupplyLimits,
    channels={"voltage": "V", "current": "A"},
)
