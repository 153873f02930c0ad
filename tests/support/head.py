"""A simulated indexing head behind a tapped wire, and what drivers for it are made from."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.aerotech_ensemble import description as ensemble
from drivers.description import DriverDescription, IdentityPin, Nothing, Setup, make_driver
from drivers.head.description import HeadLimits
from drivers.newport_xps import description as xps
from drivers.transport.address import Address
from simulators.aerotech_ensemble import SimulatedEnsemble
from simulators.faults import FaultPlan
from simulators.newport_xps import SimulatedXps
from simulators.settings import WorldSettings
from simulators.world import World
from tests.support.lines import TappedWire

OPTIONS = {"axis": "X", "rate": "20 °/s", "settle": {"band": "1 arcsec", "hold": "1 s"}}
XPS_OPTIONS = {"group": "HEAD", "rate": "20 °/s", "settle": {"band": "1 arcsec", "hold": "1 s"}}
LIMITS = {"angle": {"min": "-5°", "max": "365°"}, "rate": {"max": "30 °/s"}}


@dataclass(frozen=True)
class Dialect:
    """A driver and its simulator; `move` is how another program sends the axis to an angle.

    `word`, `home` and `angle` are in what is sent to move, to home and to ask for the angle.
    """

    description: DriverDescription
    controller: Callable[..., Any]
    options: dict[str, Any]
    move: str
    word: bytes
    home: bytes
    angle: bytes


ENSEMBLE = Dialect(
    ensemble.DESCRIPTION, SimulatedEnsemble, OPTIONS, "ENABLE X\nMOVEABS X {} F20\n", b"MOVEABS X ", b"HOME", b"PFBK"
)
XPS = Dialect(
    xps.DESCRIPTION, SimulatedXps, XPS_OPTIONS, "GroupMoveAbsolute(HEAD.Pos,{})", b"GroupMoveAbsolute(HEAD.Pos,",
    b"GroupHomeSearch", b"GroupPositionCurrentGet",
)  # fmt: skip


class Head:
    """A simulated head behind a tapped wire, and what drivers for it are made from."""

    def __init__(self, dialect: Dialect = ENSEMBLE, **settings: Any) -> None:
        loop = asyncio.get_running_loop()
        self.dialect = dialect
        self.faults = FaultPlan(now_s=loop.time)
        self.world = World(WorldSettings(seed=1, gravity_mps2=9.8), loop.time)
        self.controller = dialect.controller(self.world, self.faults, **settings)
        self.wire = TappedWire(self.controller)
        self.address = "tcp://127.0.0.1:8000"
        self.notes: list[str] = []

    def driver(self, **options: Any) -> Any:
        description = self.dialect.description
        limits = {**LIMITS, "rate": options.pop("limit")} if "limit" in options else LIMITS
        setup = Setup(
            name="head", address=Address.parse(self.address), wires=self.wire,
            options=description.options.model_validate(self.dialect.options | options),
            limits=HeadLimits.model_validate(limits), safe=Nothing(), identity=IdentityPin(serial="SIM-HEAD-01"),
            note=self.notes.append,
        )  # fmt: skip
        return make_driver(description, setup)

    def call(self, line: str) -> str:
        """What another program says to the controller, on a connection of its own; the answer."""
        answer: bytes = self.controller.session().feed(line.encode())
        return answer.decode()

    def move(self, angle_deg: float) -> None:
        """Another program moves the axis."""
        self.call(self.dialect.move.format(angle_deg))

    def heard(self) -> int:
        """How many requests have reached it."""
        return len(self.wire.requests)

    @property
    def angle_deg(self) -> float:
        return self.world.axis.encoder_deg(self.world.now())

    @property
    def moving(self) -> bool:
        return self.world.axis.moving(self.world.now())

    def moves(self) -> list[str]:
        word = self.dialect.word
        moves = [line.removeprefix(word).decode() for line in self.wire.requests if line.startswith(word)]
        return [move.split()[0].removesuffix(")") for move in moves]


def with_head(use: Callable[[Head], Awaitable[None]], dialect: Dialect = ENSEMBLE, **settings: Any) -> None:
    async def main() -> None:
        await use(Head(dialect, **settings))

    run(main(), AS_FAST_AS_POSSIBLE)


def with_driver(use: Callable[[Head, Any], Awaitable[None]], dialect: Dialect = ENSEMBLE, **settings: Any) -> None:
    async def main(head: Head) -> None:
        async with head.driver() as driver:
            await use(head, driver)

    with_head(main, dialect, **settings)


def now_s() -> float:
    return asyncio.get_running_loop().time()
