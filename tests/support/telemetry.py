"""A simulated unit that sends its output behind a tapped bus, and what drivers for it are made from."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.can.dbc import Dbc
from drivers.description import IdentityPin, Nothing, Setup, make_driver
from drivers.dialects.can_telemetry.description import DESCRIPTION, TelemetryOptions
from drivers.dialects.can_telemetry.driver import CanTelemetry
from drivers.dialects.can_telemetry.wire import sample_formats
from drivers.transport.address import Address
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.can_nodes.can_node import NodeSetup
from simulators.instruments.can_nodes.can_telemetry import ChannelSettings, SimulatedTelemetry
from simulators.units.accelerometer import Decoding
from simulators.units.settings import WorldSettings
from simulators.units.unit_file import TelemetryModel, UnitFile
from simulators.world import World
from tests.support.counters import Bus
from tests.support.laboratory import ROOT, STILL_AIR, place, unit

CHANNELS: dict[str, dict[str, Any]] = {
    name: {
        "value": f"Acc{name.upper()}.Code", "tick": f"Acc{name.upper()}.Tick", "tick_period": "10 µs",
        "sequence": f"Acc{name.upper()}.Sequence", "status": f"Acc{name.upper()}.Status", "invalid_bits": 3,
        "period": period,
    }
    for name, period in (("x", "20 ms"), ("y", "50 ms"))
}  # fmt: skip
CODES_PER_G = 400_000


def options(folder: Path = ROOT / "config", **changes: Any) -> TelemetryOptions:
    """The telemetry of our bench with two channels; `folder` is where its DBC is."""
    raw = {"dbc": "telemetry.dbc", "channels": CHANNELS} | changes
    return TelemetryOptions.model_validate(raw, context={"folder": folder})


DBC = Dbc((ROOT / "config" / "telemetry.dbc").read_text("utf-8"))
FORMS = sample_formats(DBC, options().channels)


def sending_unit(**telemetry: Any) -> UnitFile:
    """A perfect unit with a bias of 0.5 g that sends 400 000 code/g; `telemetry` spoils what it sends."""
    made = unit(accelerometer={"K0": {"at_reference": "0.5 g"}})
    return made.model_copy(update={"telemetry": TelemetryModel.model_validate({"S": "400 code/µA", **telemetry})})


class Bench:
    """Two units that send their outputs, and the bus between them and their drivers."""

    def __init__(self, **telemetry: Any) -> None:
        loop = asyncio.get_running_loop()
        self.faults = FaultPlan(now_s=loop.time)
        made = {"unit": sending_unit(**telemetry), "channel": "", "decoding": Decoding()}
        places = {"a": place(**made), "b": place(**made)}
        settings = WorldSettings(seed=1, gravity_mps2=9.8, chamber=STILL_AIR, places=places)
        self.world = World(settings, loop.time)
        channels = {
            name: ChannelSettings(FORMS[name], period_s, 1e-5, at)
            for name, period_s, at in (("x", 0.02, "a"), ("y", 0.05, "b"))
        }
        setup = NodeSetup("telemetry", self.world, self.faults, options(), readings={"Housekeeping.Sensor": "a"})
        self.node = SimulatedTelemetry(setup, DBC, channels)
        self.world.power("supply", True)
        self.bus = Bus(self.node)

    def driver(self, folder: Path = ROOT / "config", **changes: Any) -> CanTelemetry:
        setup = Setup(
            name="telemetry", address=Address.parse("slcan:///dev/ttyACM0?bitrate=500000"), wires=self.bus,
            options=options(folder, **changes), limits=Nothing(), safe=Nothing(), identity=IdentityPin(serial="ACC-01"),
        )  # fmt: skip
        driver = make_driver(DESCRIPTION, setup)
        assert isinstance(driver, CanTelemetry)
        return driver


def with_bench(use: Callable[[Bench], Awaitable[None]], **telemetry: Any) -> None:
    async def main() -> None:
        await use(Bench(**telemetry))

    run(main(), AS_FAST_AS_POSSIBLE)


def with_driver(use: Callable[[Bench, CanTelemetry], Awaitable[None]], **telemetry: Any) -> None:
    async def main(bench: Bench) -> None:
        async with bench.driver() as driver:
            await use(bench, driver)

    with_bench(main, **telemetry)
