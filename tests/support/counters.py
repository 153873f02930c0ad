"""A simulated pulse counter behind a tapped bus, and what drivers for it are made from."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, TypeVar

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.can.frame_block import FrameBlock
from drivers.description import IdentityPin, Nothing, Setup, make_driver
from drivers.dialects.can_counter.description import DESCRIPTION, CounterOptions
from drivers.dialects.can_counter.driver import CanCounter
from drivers.errors import CannotConnect, LinkLost
from drivers.transport.address import Address
from drivers.transport.can import open_slcan
from drivers.transport.frame_link import DURABLE_BLOCK_S, FrameLink
from drivers.transport.memory import Line, join
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.can_nodes.can_node import CanNode
from simulators.instruments.can_nodes.slcan_adapter import SimulatedAdapter
from simulators.units.settings import WorldSettings
from simulators.world import World
from tests.support.laboratory import CHANNELS, LATCH, ROOT, a_counter, place, unit

P = TypeVar("P", bound=asyncio.Protocol)
OPTIONS = {
    "dbc": "if_counter.dbc", "period": "100 ms", "max_rate": "256 kHz",
    "latch": {**LATCH, "tick_period": "1 µs"}, "channels": CHANNELS,
}  # fmt: skip
RATE_PPS = 5000.0


def options(folder: Path = ROOT / "config", **changes: Any) -> CounterOptions:
    """The counter of our bench; `folder` is where its DBC is."""
    return CounterOptions.model_validate(OPTIONS | changes, context={"folder": folder})


class Bus:
    """A Wires to a simulated node, directly or through a serial-line adapter. `alter` makes of the frames what
    the driver gets; `closed` counts how often it has let go."""

    block_s = DURABLE_BLOCK_S

    def __init__(self, node: CanNode) -> None:
        self._node = node
        self._link: FrameLink = node
        self.by_adapter = False
        self.alter: Callable[[FrameBlock], FrameBlock] = lambda block: block
        self.refuses = self.gone = False
        self.opened = self.closed = 0

    async def stream(self, device: str, address: Address, factory: Callable[[], P]) -> P:
        raise CannotConnect(device, f"{address} carries no bytes")

    async def frames(self, device: str, address: Address) -> FrameLink:
        self.opened += 1
        if self.refuses:
            raise CannotConnect(device, f"cannot open {address}")
        if self.by_adapter:

            async def joined(factory: Callable[[], P]) -> P:
                client = factory()
                join(client, SimulatedAdapter(self._node), Line.serial(1_000_000), str(address))
                return client

            self._link = await open_slcan(device, address, joined)
        return self

    def take(self) -> FrameBlock:
        if self.gone:
            raise LinkLost("counter", "the adapter is gone")
        return self.alter(self._link.take())

    def close(self) -> None:
        self.closed += 1
        self._link.close()


class Bench:
    """A unit that fires 5000 pulses a second at a counter, and the bus between it and its drivers."""

    def __init__(self) -> None:
        loop = asyncio.get_running_loop()
        self.faults = FaultPlan(now_s=loop.time)
        half_g = unit(accelerometer={"K0": {"at_reference": "0.5 g"}})
        self.world = World(WorldSettings(seed=1, gravity_mps2=9.8, places={"a": place(unit=half_g)}), loop.time)
        self.counter = a_counter(self.world, self.faults, readings={"Temperatures.Unit": "a"})
        self.world.power("supply", True)
        self.bus = Bus(self.counter)
        self.notes: list[str] = []

    def driver(self, folder: Path = ROOT / "config", **changes: Any) -> CanCounter:
        setup = Setup(
            name="counter", address=Address.parse("slcan:///dev/ttyACM0?bitrate=500000"), wires=self.bus,
            options=options(folder, **changes), limits=Nothing(), safe=Nothing(), identity=IdentityPin(serial="IFC-01"),
            note=self.notes.append,
        )  # fmt: skip
        driver = make_driver(DESCRIPTION, setup)
        assert isinstance(driver, CanCounter)
        return driver


def with_bench(use: Callable[[Bench], Awaitable[None]]) -> None:
    async def main() -> None:
        await use(Bench())

    run(main(), AS_FAST_AS_POSSIBLE)


def with_driver(use: Callable[[Bench, CanCounter], Awaitable[None]]) -> None:
    async def main(bench: Bench) -> None:
        async with bench.driver() as driver:
            await use(bench, driver)

    with_bench(main)


def dbc_file(folder: Path, *edits: tuple[str, str]) -> Path:
    """Our DBC with its text edited, under its own name in `folder`."""
    text = (ROOT / "config" / "if_counter.dbc").read_text("utf-8")
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new)
    path = folder / "if_counter.dbc"
    path.write_text(text, "utf-8")
    return path
