"""A simulated laboratory made by hand: a perfect unit, spoilt on purpose, in a world whose clock the test turns."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from drivers.can.dbc import Dbc
from drivers.can.options import PositionOptions
from drivers.dialects.can_counter.options import ChannelOptions, CounterOptions, LatchOptions
from drivers.dialects.can_counter.wire import CounterFormat, counter_format
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.can_nodes.can_counter import SimulatedCounter
from simulators.instruments.can_nodes.can_node import NodeSetup
from simulators.physics.thermal import ChamberPhysics
from simulators.units.settings import PlaceSettings, WorldSettings
from simulators.units.unit_file import UnitFile
from simulators.world import World

ROOT = Path(__file__).parents[2]
DBC = Dbc((ROOT / "config" / "if_counter.dbc").read_text("utf-8"))
LATCH = {"tick": "Latch.Tick", "sequence": "Latch.Sequence", "boot_count": "Latch.BootCount"}
CHANNELS = {
    name: {key: f"Axis{name.upper()}.{key.capitalize()}" for key in ("positive", "negative", "sequence")}
    for name in "xyz"
}
ARCSEC_DEG = 1 / 3600
STILL_AIR = ChamberPhysics(limit_cycle_c=0.0)


def unit(**changes: Mapping[str, Any]) -> UnitFile:
    """A perfect unit of 1 mA/g and 10 kHz/mA at 20 °C; `changes` go into its sections."""
    accelerometer = {"K0": {"at_reference": "0 g"}, "K1": {"at_reference": "1 mA/g"}}
    converter = {"S": "10 kHz/mA", "full_scale": "25 mA", "max_rate": "256 kHz"}
    return UnitFile.model_validate({
        "schema": "itb-uut/1",
        "title": "made by hand",
        "accelerometer": accelerometer | dict(changes.get("accelerometer", {})),
        "converter": converter | dict(changes.get("converter", {})),
        "thermal": changes.get("thermal", {}),
    })  # fmt: skip


def place(channel: str = "x", **changes: Any) -> PlaceSettings:
    """A perfect unit in its place."""
    return PlaceSettings(**({"unit": unit(), "channel": channel, "supply": "supply"} | changes))


def counter_form(*, boot_count: bool = True) -> CounterFormat:
    """The frames of our DBC."""
    return format_in(DBC, LATCH if boot_count else {**LATCH, "boot_count": None}, CHANNELS)


def format_in(
    dbc: Dbc, latch: Mapping[str, Any], channels: Mapping[str, Any], positions: Mapping[str, Any] | None = None
) -> CounterFormat:
    """The frames with these names; a tick is 1 µs unless the latch has another."""
    return counter_format(
        dbc, LatchOptions.model_validate({"tick_period": "1 µs", **latch}),
        {name: ChannelOptions.model_validate(each) for name, each in channels.items()},
        {name: PositionOptions.model_validate({"resolution": "1 arcsec", **each})
         for name, each in (positions or {}).items()},
    )  # fmt: skip


def a_counter(
    world: World, faults: FaultPlan, *, dbc: Dbc = DBC, form: CounterFormat | None = None, period_s: float = 0.1,
    readings: Mapping[str, str] | None = None, positions: Mapping[str, PositionOptions] | None = None,
) -> SimulatedCounter:  # fmt: skip
    """A counter that sends the frames of our DBC."""
    options = CounterOptions.model_construct(period=period_s, positions=dict(positions or {}))
    setup = NodeSetup("counter", world, faults, options, readings=readings or {})
    return SimulatedCounter(setup, dbc, form or counter_form())


class Laboratory:
    """A world with a clock of its own: `host_s` is what the host's clock shows."""

    def __init__(self, *places: PlaceSettings, **settings: Any) -> None:
        self.host_s = 0.0
        named = dict(zip("abcdef", places, strict=False))
        defaults = {"seed": 1, "gravity_mps2": 9.8, "chamber": STILL_AIR, "thermometer_noise_c": 0.0, "places": named}
        self.world = World(WorldSettings(**(defaults | settings)), lambda: self.host_s)

    def wait(self, duration_s: float) -> float:
        """Let time pass, and works the world out; the true time then."""
        self.host_s += duration_s
        return self.world.look()

    def counter(self, *, period_s: float = 0.1, faults: FaultPlan | None = None) -> SimulatedCounter:
        """A counter whose temperatures are those of the place a."""
        readings = {"Temperatures.Unit": "a"} if "a" in self.world.units else {}
        faults = faults or FaultPlan(now_s=self.world.now)
        return a_counter(self.world, faults, period_s=period_s, readings=readings)

    def rate_pps(self, place_name: str = "a", gate_s: float = 100.0) -> float:
        """The mean rate over a gate, as charge: without the steps of counting."""
        begin = self.world.now()
        return float(self.world.units[place_name].charge_pulses(np.array([begin, self.wait(gate_s)]))[0] / gate_s)
