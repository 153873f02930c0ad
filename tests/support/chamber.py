"""A simulated chamber that a test can tap, silence, cut off and command behind the driver's back."""

import asyncio
from collections.abc import Callable, Coroutine, Sequence
from typing import Any

from bench.loop import AS_FAST_AS_POSSIBLE, BenchLoop, run
from drivers.description import IdentityPin, Setup, make_driver
from drivers.dialects.watlow_f4t.controller import WatlowF4T
from drivers.dialects.watlow_f4t.description import DESCRIPTION, F4TOptions
from drivers.dialects.watlow_f4t.wire import LoopFormat, LoopRegister
from drivers.kinds.chamber.description import ChamberLimits, ChamberSafe
from drivers.transport.address import Address
from drivers.transport.memory import Line
from drivers.transport.wires import RealWires
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.chambers.watlow_f4t import SimulatedF4T
from simulators.physics.thermal import ChamberPhysics
from simulators.serving.serve import InstrumentProtocol
from simulators.units.settings import WorldSettings
from simulators.world import World

ADDRESS = Address.parse("tcp://127.0.0.1:1502")
LIMITS = {"temperature": {"min": "-50 °C", "max": "100 °C"}, "ramp_rate": {"max": "3 °C/min"}}
WRITES = (6, 16)


class Tap(InstrumentProtocol):
    """The simulator's end of a connection, with every request written down, and lost or left unanswered on demand."""

    def __init__(self, chamber: "Chamber") -> None:
        super().__init__(chamber.instrument)
        self.chamber = chamber
        chamber.connections.append(self)

    def data_received(self, data: bytes) -> None:
        self.chamber.requests.append(data)
        if self.chamber.lose(data):
            return
        if self.chamber.leave_unanswered(data):
            self._session.feed(data)
            return
        super().data_received(data)


class Chamber:
    """A simulated chamber at ADDRESS of the running loop, and what drivers for it are made from."""

    def __init__(
        self,
        simulator: type[SimulatedF4T] = SimulatedF4T,
        physics: ChamberPhysics | None = None,
        **settings: Any,
    ) -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, BenchLoop)
        self.now_s = loop.time
        self.faults = FaultPlan(now_s=loop.time)
        self.world = World(WorldSettings(1, 9.8, chamber=physics or ChamberPhysics()), loop.time)
        self.instrument = simulator(self.world, self.faults, **settings)
        self.requests: list[bytes] = []
        self.connections: list[Tap] = []
        self.lose: Callable[[bytes], bool] = lambda _request: False
        self.leave_unanswered: Callable[[bytes], bool] = lambda _request: False
        loop.serve_in_memory(ADDRESS.host, ADDRESS.port, lambda: Tap(self), Line(latency_s=0.002))

    def driver(self, *, limits: object = LIMITS, safe: object = None, pin: object = None, **options: Any) -> WatlowF4T:
        setup = Setup(
            name="chamber", address=ADDRESS, wires=RealWires(), options=F4TOptions.model_validate(options),
            limits=ChamberLimits.model_validate(limits), safe=ChamberSafe.model_validate(safe or {}),
            identity=IdentityPin.model_validate(pin or {}),
        )  # fmt: skip
        driver = make_driver(DESCRIPTION, setup)
        assert isinstance(driver, WatlowF4T)
        return driver

    def look(self) -> tuple[float, float]:
        """Set point in force and air, °C."""
        self.world.look()
        return self.world.thermal.set_point_c, self.world.thermal.air_c

    def writes_to(self, register: int) -> list[bytes]:
        """The data of the writes to a register, in order."""
        return [r[8:] for r in self.requests if r[7] in WRITES and r[8:10] == register.to_bytes(2, "big")]

    def write_behind_its_back(self, register: LoopRegister, words: Sequence[int]) -> None:
        """Change a setting at the front panel."""
        self.instrument.write(register, words)

    def drop_connections(self) -> None:
        for connection in self.connections:
            if connection._transport is not None:  # those before have been lost
                connection._transport.abort()


def with_chamber(use: Callable[[Chamber], Coroutine[Any, Any, None]], **settings: Any) -> None:
    async def main() -> None:
        await use(Chamber(**settings))

    run(main(), AS_FAST_AS_POSSIBLE)


def is_write_to(register: int) -> Callable[[bytes], bool]:
    return lambda request: request[7] in WRITES and request[8:10] == register.to_bytes(2, "big")


def words(value: float) -> tuple[int, ...]:
    return LoopFormat().words(value)
