"""A rate table that sends frames by itself, described as briefly as can be, and one behind a tapped wire."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.description import DriverDescription, IdentityPin, Nothing, Setup, make_driver
from drivers.dialects.framed.description import TABLE
from drivers.dialects.framed.profile import FrameProfile
from drivers.schema.fields import DocumentFile
from drivers.transport.address import Address
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.axes.framed import SimulatedFrames
from simulators.units.settings import WorldSettings
from simulators.world import World
from tests.support.handling import framed
from tests.support.head import FRAMES
from tests.support.lines import TappedWire
from tests.support.table import LIMITS, Turned

FICTIONAL = FRAMES
PLAIN_FILE: dict[str, Any] = {
    "schema": "itb-table/1", "maker": "Nobody", "model": "Plain", "source": "made up", "byte_order": "big",
    "header": "FA", "trailer": "0D", "checksum": {"kind": "sum8", "from": 1}, "cyclic": {"period": "50 ms"},
    "reaction": "30 ms", "angle_wraps": True,
    "status": {
        "length": 12, "counter": {"at": 1}, "angle": {"at": 2, "type": "i32", "scale": "0.36 arcsec"},
        "rate": {"at": 6, "type": "i16", "scale": "0.01 °/s"},
        "states": {"moving": {"at": 8, "bit": 0}, "emergency_stop": {"at": 8, "bit": 7}},
        "faults": [{"at": 9, "bit": 1, "means": "encoder"}],
    },
    "commands": {
        "stop": {"length": 5, "constants": [{"at": 1, "bytes": "01"}]},
        "move": {
            "length": 10, "constants": [{"at": 1, "bytes": "02"}],
            "angle": {"at": 2, "type": "i32", "scale": "0.36 arcsec"},
            "rate": {"at": 6, "type": "i16", "scale": "0.01 °/s"},
        },
        "rate": {
            "length": 6, "constants": [{"at": 1, "bytes": "03"}],
            "rate": {"at": 2, "type": "i16", "scale": "0.01 °/s"},
        },
    },
}  # fmt: skip
PLAIN = FrameProfile.model_validate(PLAIN_FILE)
OPTIONS = {
    "rate": "100 °/s", "acceleration": "200 °/s²", "settle": {"band": "1 arcsec", "hold": "1 s"},
}  # fmt: skip
HEAD_OPTIONS = {"rate": "20 °/s", "settle": {"band": "1 arcsec", "hold": "1 s"}}
HEAD_LIMITS = {"angle": {"min": "-5°", "max": "365°"}, "rate": {"max": "30 °/s"}}


class Framed(Turned):
    """A simulated controller behind a tapped wire, and what drivers for it are made from."""

    def __init__(
        self, profile: FrameProfile = FICTIONAL, description: DriverDescription = TABLE, **settings: Any
    ) -> None:
        self.profile, self.description = profile, description
        loop = asyncio.get_running_loop()
        self.faults = FaultPlan(now_s=loop.time)
        self.world = World(WorldSettings(seed=1, gravity_mps2=9.8), loop.time)
        self.controller = SimulatedFrames(self.world, self.faults, profile, **settings)
        self.wire = TappedWire(self.controller)
        self.notes: list[str] = []

    def driver(self, pin: IdentityPin | None = None, address: str = "tcp://127.0.0.1:9000", **options: Any) -> Any:
        is_table = self.description is TABLE
        given = {"profile": DocumentFile(None, self.profile)} | (OPTIONS if is_table else HEAD_OPTIONS) | options
        limits = self.description.limits.model_validate(LIMITS if is_table else HEAD_LIMITS)
        setup = Setup(
            name="table", address=Address.parse(address), wires=self.wire,
            options=self.description.options.model_validate(given), limits=limits, safe=Nothing(),
            identity=pin or IdentityPin(), note=self.notes.append,
        )  # fmt: skip
        return make_driver(self.description, setup)

    def sent(self, name: str) -> int:
        """Number of times a frame was sent to the controller."""
        form = self.profile.format(name)
        return sum(form.fits(request, 0) for request in self.wire.requests)

    def is_a(self, name: str) -> Callable[[bytes], bool]:
        form = self.profile.format(name)
        return lambda request: form.fits(request, 0)

    def elsewhere(self, name: str, **values: float) -> None:
        """Somebody else commands the controller, over another interface."""
        framed(self.controller, name, **values)


def with_framed(use: Callable[[Framed], Awaitable[None]], *given: Any, **settings: Any) -> None:
    async def main() -> None:
        await use(Framed(*given, **settings))

    run(main(), AS_FAST_AS_POSSIBLE)


def with_driver(use: Callable[[Framed, Any], Awaitable[None]], *given: Any, **settings: Any) -> None:
    async def main(framed: Framed) -> None:
        async with framed.driver() as driver:
            await use(framed, driver)

    with_framed(main, *given, **settings)
