"""The kinds of instruments that are swapped: each made twice, with other names, and set going."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from drivers.capabilities import Device
from drivers.description import DriverDescription, IdentityPin, Setup, known_drivers, make_driver
from drivers.transport.address import Address
from drivers.transport.wires import Wires
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.setup import InstrumentSetup, make_instrument
from simulators.physics.thermal import ChamberPhysics
from simulators.units.settings import WorldSettings
from simulators.world import World
from tests.support import chambers
from tests.support.handling import Act, Meddle, ramp
from tests.support.instruments import Instrument, Swap, tried


@dataclass(frozen=True, eq=False)
class Kind:
    """Two instruments of one kind, 0 and 1.

    `act` makes a driver send a command that depends on a number from 0 to 1; `meddle` is a later command of another
    master, different from `act` with 0. `tell_apart` gives the instrument of a number an identity that its wire
    reports; without it, each has a serial number.
    """

    name: str
    driver: str
    address: str
    options: Any
    limits: Any
    act: Act
    meddle: Meddle
    asks: Callable[[bytes], bool]
    tell_apart: Callable[[Any, int], object] | None = None

    @property
    def description(self) -> DriverDescription:
        return known_drivers()[self.driver]

    def instrument(self, number: int) -> Any:
        """The instrument of this number, in a world of its own."""
        now_s = asyncio.get_running_loop().time
        world = World(WorldSettings(1, 9.8, chamber=ChamberPhysics(start_c=20.0)), now_s)
        setup = InstrumentSetup(
            "device", world, FaultPlan(now_s=now_s), self.options,
            serial=str(1001 + number) if self.tell_apart is None else "",
            is_serial_line=Address.parse(self.address).is_serial_line,
        )  # fmt: skip
        instrument = make_instrument(self.description.simulator, setup)
        if self.tell_apart is not None:
            self.tell_apart(instrument, number)
        return instrument

    def driver_on(self, wires: Wires, role: str, address: Address, pin: IdentityPin) -> Device:
        """A driver for such an instrument."""
        setup: Setup[Any, Any, Any] = Setup(
            role, address, wires, self.options, self.limits, self.description.safe(), pin
        )
        return make_driver(self.description, setup)


def _chamber(dialect: chambers.Dialect) -> Kind:
    description = dialect.description

    def tell_apart(instrument: Any, number: int) -> None:
        dialect.prepare(instrument)
        if number:
            dialect.stranger(instrument)

    return Kind(
        str(dialect), dialect.driver, dialect.address, description.options.model_validate(dict(dialect.options)),
        description.limits.model_validate(chambers.LIMITS), ramp,
        lambda instrument, draw: dialect.set_point(instrument, 40.0 + round(10 * draw)), dialect.asks, tell_apart,
    )  # fmt: skip


def _other(driver: str, instrument: Instrument, swap: Swap) -> Kind:
    entry = instrument.entry(driver)
    return Kind(
        driver, driver, str(entry.connection), entry.options, entry.limits, swap.act, swap.meddle, swap.asks, swap.name,
    )  # fmt: skip


_TRIED = tried("swaps")
KINDS = [
    *(_chamber(dialect) for each in _TRIED.values() for dialect in each.dialects),
    *(_other(driver, each, each.swap) for driver, each in _TRIED.items() if each.swap is not None),
]
