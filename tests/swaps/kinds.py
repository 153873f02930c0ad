"""The kinds of instruments that are swapped: each made twice, with other names, and set going."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from drivers.capabilities import Device
from drivers.description import IdentityPin, Setup, known_drivers, make_driver
from drivers.transport.address import Address
from drivers.transport.wires import Wires
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.axes.acutronic_acl import SimulatedAcutrol
from simulators.instruments.axes.aerotech_ensemble import SimulatedEnsemble
from simulators.instruments.axes.newport_xps import SimulatedXps
from simulators.instruments.setup import InstrumentSetup, make_instrument
from simulators.instruments.sources.fluke_5700a import SimulatedFluke
from simulators.instruments.sources.keithley_6220 import SimulatedKeithley
from simulators.instruments.sources.scpi_supply import SimulatedSupply
from simulators.instruments.sources.yokogawa_gs200 import SimulatedGS200
from simulators.physics.thermal import ChamberPhysics
from simulators.units.settings import WorldSettings
from simulators.world import World
from tests.support import chambers
from tests.support.chambers import DIALECTS
from tests.support.chambers_ascii import ASCII_DIALECTS
from tests.support.chambers_modbus import MODBUS_DIALECTS
from tests.support.head import LIMITS as HEAD_LIMITS
from tests.support.head import OPTIONS as ENSEMBLE_OPTIONS
from tests.support.head import XPS_OPTIONS
from tests.support.source import GS200_OPTIONS
from tests.support.source import LIMITS as SOURCE_LIMITS
from tests.support.supply import LIMITS as SUPPLY_LIMITS
from tests.support.table import LIMITS as TABLE_LIMITS
from tests.support.table import OPTIONS as TABLE_OPTIONS

Act = Callable[[Any, float], Awaitable[object]]
Meddle = Callable[[Any, float], None]
_READ_ONLY = re.compile(
    rb"GETPARM|PFBK|AXISSTATUS|AXISFAULT|\w+(?:Get|Read)\("  # heads
    rb"|(?:10012|11002|11004|11007|11009|11023|11066|11070|14003|17002|17007|17009|19210|99997)\xb6"  # SIMSERV
)


@dataclass(frozen=True, eq=False)
class Kind:
    """One kind of instrument; `make` is given a world and the number of the instrument, 0 or 1.

    `act` makes a driver tell it something, which depends on a number from 0 to 1; `meddle` is what somebody else tells
    the instrument afterwards, which `act` with 0 did not.
    """

    name: str
    driver: str
    address: str
    make: Callable[[World, FaultPlan, int], Any]
    act: Act
    meddle: Meddle
    asks: Callable[[bytes], bool]
    options: Mapping[str, object] = field(default_factory=dict)
    limits: Mapping[str, object] = field(default_factory=dict)

    def instrument(self, number: int) -> Any:
        """The instrument of this number, in a world of its own."""
        now_s = asyncio.get_running_loop().time
        world = World(WorldSettings(1, 9.8, chamber=ChamberPhysics(start_c=20.0)), now_s)
        return self.make(world, FaultPlan(now_s=now_s), number)

    def driver_on(self, wires: Wires, role: str, address: Address, pin: IdentityPin) -> Device:
        """A driver for such an instrument."""
        description = known_drivers()[self.driver]
        setup: Setup[Any, Any, Any] = Setup(
            role, address, wires, description.options.model_validate(dict(self.options)),
            description.limits.model_validate(dict(self.limits)), description.safe(), pin,
        )  # fmt: skip
        return make_driver(description, setup)


# What is a question, judged by the bytes


def scpi_asks(request: bytes) -> bool:
    return all(b"?" in part for part in re.split(rb"[;\r\n]", request) if part.strip())


def _modbus_asks(at: int) -> Callable[[bytes], bool]:
    return lambda request: request[at] not in (6, 16)


def _cts_asks(request: bytes) -> bool:
    return chr(request[2] & 0x7F).isupper()


def _listed(request: bytes) -> bool:
    return _READ_ONLY.match(request) is not None


def _chamber_asks(dialect: chambers.Dialect) -> Callable[[bytes], bool]:
    if dialect.driver in ("espec_p300", "cts", "simserv"):
        return {"espec_p300": scpi_asks, "cts": _cts_asks, "simserv": _listed}[dialect.driver]
    return _modbus_asks(7 if dialect.address.startswith("tcp") else 1)


# What they are told


async def ramp(driver: Any, draw: float) -> None:
    await driver.ramp_to(25.0 + round(10 * draw), 1.0)


async def _current(driver: Any, draw: float) -> None:
    await driver.set(1e-3 * (1 + round(5 * draw)), limit=10.0, output=True)


async def _voltage(driver: Any, draw: float) -> None:
    await driver.set(5.0 + round(5 * draw), limit=0.1, output=True)


async def _turn(driver: Any, draw: float) -> None:
    await driver.rotate_at(10.0 + round(20 * draw), acceleration_dps2=20.0)


async def _move(driver: Any, draw: float) -> None:
    await driver.move_to(90.0 + round(90 * draw), approach="direct", settle_s=0.5)


def _said(*messages: str) -> Meddle:
    """Messages on a connection of somebody's own, with a number from 2 to 6 in them."""

    def say(instrument: Any, draw: float) -> None:
        session = instrument.session()
        for message in messages:
            session.feed(message.format(2 + round(4 * draw, 2)).encode())

    return say


def _chamber(dialect: chambers.Dialect) -> Kind:
    def make(world: World, faults: FaultPlan, number: int) -> Any:
        description = known_drivers()[dialect.driver]
        options = description.options.model_validate(dict(dialect.options))
        serial = Address.parse(dialect.address).is_serial_line
        setup = InstrumentSetup("chamber", world, faults, options, is_serial_line=serial)
        instrument = make_instrument(description.simulator, setup)
        dialect.prepare(instrument)
        if number:
            dialect.stranger(instrument)
        return instrument

    return Kind(
        str(dialect), dialect.driver, dialect.address, make, ramp,
        lambda instrument, draw: dialect.set_point(instrument, 40.0 + round(10 * draw)), _chamber_asks(dialect),
        dialect.options, chambers.LIMITS,
    )  # fmt: skip


def _xps(world: World, faults: FaultPlan, number: int) -> SimulatedXps:
    controller = SimulatedXps(world, faults)
    controller.firmware = controller.firmware.replace("V1", f"V{number + 1}") + f" {number}"
    return controller


KINDS = [
    *map(_chamber, [*DIALECTS, *ASCII_DIALECTS, *MODBUS_DIALECTS]),
    Kind(
        "keithley_6220", "keithley_6220", "serial:///dev/ttyUSB0?baud=19200",
        lambda world, faults, n: SimulatedKeithley(world, faults, serial=f"K-{n}"), _current,
        _said(":SOUR:CURR {}E-3\r\n"), scpi_asks, {"range": "20 mA", "compliance": "10 V"}, SOURCE_LIMITS,
    ),
    Kind(
        "yokogawa_gs200", "yokogawa_gs200", "tcp://127.0.0.1:7655",
        lambda world, faults, n: SimulatedGS200(world, faults, serial=f"Y-{n}"), _current,
        _said(":SOUR:LEV {}E-3\n"), scpi_asks, GS200_OPTIONS, SOURCE_LIMITS,
    ),
    Kind(
        "fluke_5700a", "fluke_5700a", "tcp://127.0.0.1:4000",
        lambda world, faults, n: SimulatedFluke(world, faults, serial=f"F-{n}"), _current,
        _said("OUT {}E-3 A, 0 HZ\r\n"), scpi_asks, {"range": "22 mA", "compliance": "10 V"}, SOURCE_LIMITS,
    ),
    Kind(
        "scpi_supply", "scpi_supply", "tcp://127.0.0.1:5025",
        lambda world, faults, n: SimulatedSupply(world, faults, serial=f"S-{n}"), _voltage,
        _said("VOLT {}1\n"), scpi_asks, {}, SUPPLY_LIMITS,
    ),
    Kind(
        "acutronic_acl", "acutronic_acl", "tcp://127.0.0.1:9878",
        lambda world, faults, n: SimulatedAcutrol(world, faults, serial=f"{1000 + n}"), _turn,
        _said(":DEM:RATE 1,{}\n"), scpi_asks, TABLE_OPTIONS, TABLE_LIMITS,
    ),
    Kind(
        "aerotech_ensemble", "aerotech_ensemble", "tcp://127.0.0.1:8000",
        lambda world, faults, n: SimulatedEnsemble(world, faults, counts_per_unit=1_000_000 + n), _move,
        _said("MOVEABS X {} F20\n"), _listed, ENSEMBLE_OPTIONS, HEAD_LIMITS,
    ),
    Kind(
        "newport_xps", "newport_xps", "tcp://127.0.0.1:5001", _xps, _move, _said("GroupMoveAbsolute(HEAD.Pos,{})"),
        _listed, XPS_OPTIONS, HEAD_LIMITS,
    ),
]  # fmt: skip
