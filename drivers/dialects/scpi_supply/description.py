"""Bench file keys of a laboratory power supply."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from drivers.description import DriverDescription
from drivers.safe_state import DIALOGUE_S, SafeState
from drivers.schema.fields import InUnit, StrictModel

Answer = Literal["maximum", "over_voltage", "over_current"]


class SupplyOptions(StrictModel):
    """Optional commands that a supply knows beyond the common core; an unknown query gets no answer."""

    answers: tuple[Answer, ...] = Field(
        (),
        description="maximum (VOLT? MAX, CURR? MAX), over_voltage (VOLT:PROT:TRIP?), over_current (CURR:PROT:TRIP?)",
    )
    watchdog: Annotated[float, InUnit("s", at_least=10, at_most=3600)] | None = Field(
        None, description="time without communication after which it switches itself off, in whole seconds"
    )


class VoltageRange(StrictModel):
    """Maximum level: `max`."""

    max: Annotated[float, InUnit("V", above=0)]


class CurrentRange(StrictModel):
    """Maximum current limit: `max`."""

    max: Annotated[float, InUnit("A", above=0)]


class SupplyLimits(StrictModel):
    """Limits that protect the unit on the supply."""

    voltage: VoltageRange
    current: CurrentRange


def safe_state(options: SupplyOptions, _limits: SupplyLimits, _safe: object) -> SafeState:
    """Output off; also without a connection, if its watchdog is used."""
    return SafeState("off", DIALOGUE_S, options.watchdog)


DESCRIPTION = DriverDescription(
    name="scpi_supply",
    title="laboratory power supply with the common core of SCPI",
    capabilities=frozenset({"power_supply"}),
    schemes=frozenset({"serial", "socket", "tcp"}),
    target="drivers.dialects.scpi_supply.driver:ScpiSupply",
    simulator="simulators.instruments.sources.scpi_supply:SimulatedSupply",
    options=SupplyOptions,
    recognition="drivers.dialects.scpi_supply.recognition:RECOGNITION",
    limits=SupplyLimits,
    safe_state=safe_state,
    channels={"voltage": "V", "current": "A"},
)
