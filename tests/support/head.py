"""A simulated indexing head behind a tapped wire, and what drivers for it are made from."""

import asyncio
import struct
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from bench.config.load import load_file
from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.description import DriverDescription, IdentityPin, Nothing, Setup, make_driver
from drivers.dialects.aerotech_ensemble import description as ensemble
from drivers.dialects.framed import description as framed
from drivers.dialects.framed.profile import FrameProfile
from drivers.dialects.framed.wire import NumberFormat
from drivers.dialects.newport_xps import description as xps
from drivers.kinds.head.description import HeadLimits
from drivers.schema.fields import DocumentFile
from drivers.transport.address import Address
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.axes.aerotech_ensemble import SimulatedEnsemble
from simulators.instruments.axes.framed import SimulatedFrames
from simulators.instruments.axes.newport_xps import SimulatedXps
from simulators.units.settings import WorldSettings
from simulators.world import World
from tests.support.lines import TappedWire
from tests.support.runs import ROOT

OPTIONS = {"axis": "X", "rate": "20 °/s", "settle": {"band": "1 arcsec", "hold": "1 s"}}
XPS_OPTIONS = {"group": "HEAD", "rate": "20 °/s", "settle": {"band": "1 arcsec", "hold": "1 s"}}
LIMITS = {"angle": {"min": "-5°", "max": "365°"}, "rate": {"max": "30 °/s"}}


@dataclass(frozen=True)
class Dialect:
    """A driver and its simulator; `move` is what another program sends to have the axis go to an angle.

    `word`, `home` and `angle` are in what is sent to move, to home and to ask for the angle; `target` reads a move.
    """

    description: DriverDescription
    controller: Callable[..., Any]
    options: dict[str, Any]
    move: Callable[[float], bytes]
    word: bytes
    home: bytes
    angle: bytes
    target: Callable[[bytes], str]
    serial: str = "SIM-HEAD-01"


def first_word(rest: bytes) -> str:
    return rest.decode().split()[0].removesuffix(")")


ENSEMBLE = Dialect(
    ensemble.DESCRIPTION, SimulatedEnsemble, OPTIONS, lambda angle: f"ENABLE X\nMOVEABS X {angle} F20\n".encode(),
    b"MOVEABS X ", b"HOME", b"PFBK", first_word,
)  # fmt: skip
XPS = Dialect(
    xps.DESCRIPTION, SimulatedXps, XPS_OPTIONS, lambda angle: f"GroupMoveAbsolute(HEAD.Pos,{angle})".encode(),
    b"GroupMoveAbsolute(HEAD.Pos,", b"GroupHomeSearch", b"GroupPositionCurrentGet", first_word,
)  # fmt: skip
FRAMES = load_file(ROOT / "config/tables/fictional.yaml", FrameProfile)


def framed_move(angle_deg: float) -> bytes:
    """Energise, then goes at 20 °/s and 40 °/s²."""
    reported = struct.pack("<iiI", round(angle_deg * 1e4), 200_000, 40_000)
    numbers = [(NumberFormat(at, "u8"), byte) for at, byte in enumerate(reported, start=3)]
    return FRAMES.format("enable").build([]) + FRAMES.format("move").build(numbers)


FRAMED = Dialect(
    framed.HEAD, partial(SimulatedFrames, profile=FRAMES),
    {"profile": DocumentFile(ROOT / "config/tables/fictional.yaml", FRAMES), "answer_timeout": "2 s",
     "rate": "20 °/s", "settle": {"band": "1 arcsec", "hold": "1 s"}},
    framed_move, bytes.fromhex("AA 55 24"), bytes.fromhex("AA 55 21"), bytes.fromhex("AA 55 10"),
    lambda rest: str(int.from_bytes(rest[:4], "little", signed=True) / 1e4), serial="1001",
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
            limits=HeadLimits.model_validate(limits), safe=Nothing(), identity=IdentityPin(serial=self.dialect.serial),
            note=self.notes.append,
        )  # fmt: skip
        return make_driver(description, setup)

    def call(self, line: str) -> str:
        """Make a call of another program, on a connection of its own; return the answer."""
        answer: bytes = self.controller.session().feed(line.encode())
        return answer.decode()

    def move(self, angle_deg: float) -> None:
        """Another program moves the axis."""
        self.controller.session().feed(self.dialect.move(angle_deg))

    def heard(self) -> int:
        """Number of requests that reached it."""
        return len(self.wire.requests)

    @property
    def angle_deg(self) -> float:
        return self.world.axis.encoder_deg(self.world.now())

    @property
    def moving(self) -> bool:
        return self.world.axis.moving(self.world.now())

    def moves(self) -> list[str]:
        word = self.dialect.word
        return [
            self.dialect.target(line.removeprefix(word)) for line in self.wire.requests if line.startswith(word)
        ]  # fmt: skip


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
