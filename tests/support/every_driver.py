"""Each installed driver with the simulator of its instrument, on a bench that has it or in the place of another one."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from functools import cache
from typing import Any

from bench.app.drawn import AnyUnitFile
from bench.app.laboratory import BenchWires, Laboratory, make_laboratory, unit_files
from bench.config.models import BenchFile
from drivers.capabilities import Device
from drivers.description import IdentityPin, Setup, ignore_note, known_drivers, make_driver
from simulators.faults.instrument_faults import FaultPlan
from simulators.faults.line_faults import FaultyLine
from tests.support.instruments import bench_named, tried

Call = Callable[[Any], Awaitable[object]]


EVERY = tried("contract")


def bench_of(driver: str) -> BenchFile:
    """The bench with the instrument of this driver in it, and no other."""
    instrument = EVERY[driver]
    bench = bench_named(instrument.bench)
    if instrument.beside:
        place = bench.places["a"].model_copy(update={"ammeter": instrument.role})
        bench = bench.model_copy(update={"places": {"a": place}})
    return bench.model_copy(update={"devices": {instrument.role: instrument.entry(driver)}})


@cache
def _units(name: str) -> Mapping[str, AnyUnitFile]:
    return unit_files(bench_named(name), None)


class Opened:
    """A simulated instrument that nobody has spoken to yet, and drivers of it, on a `bad` line if one is given."""

    def __init__(self, driver: str, bad: FaultyLine | None = None) -> None:
        member, bench = EVERY[driver], bench_of(driver)
        self.role, self.entry = member.role, bench.devices[member.role]
        units = _units(member.bench)
        self.laboratory: Laboratory = make_laboratory(bench, units, 1, asyncio.get_running_loop().time)
        for place in bench.places.values():  # units that send their output do it while they have power
            self.laboratory.world.power(place.supply, True)
        self._wires = BenchWires(bench, self.laboratory, {} if bad is None else {self.role: bad})

    @property
    def faults(self) -> FaultPlan:
        """Those of the instrument."""
        node = self.laboratory.nodes.get(self.role)
        return node.faults if node is not None else self.laboratory.instruments[self.role].faults

    def driver(self, note: Callable[[str], object] = ignore_note, /, **pin: str) -> Device:
        """Its driver, not yet connected, with this identity stated; `note` receives its notes."""
        entry = self.entry
        setup = Setup(
            self.role, entry.connection, self._wires, entry.options, entry.limits, entry.safe,
            IdentityPin.model_validate(pin), note,
        )  # fmt: skip
        return make_driver(entry.description, setup)


async def _first_block(device: Any) -> None:
    async with device.acquire() as blocks:
        async for _block in blocks:
            return


_OF_ALL: dict[str, Call] = {"identify": lambda d: d.identify(), "poll": lambda d: d.poll()}
_HOLDING: dict[str, Call] = {"angle": lambda d: d.angle(), "stop": lambda d: d.stop()}
_FRAMES: dict[str, Call] = {"acquire": _first_block, "wait_for_data": lambda d: d.wait_for_data()}
_METER: dict[str, Call] = {"measure": lambda d: d.measure(1, nplc=1)}
CALLS: Mapping[str, Mapping[str, Call]] = {
    "positioner": {"move_to": lambda d: d.move_to(20.0, approach="direct", settle_s=1.0), **_HOLDING},
    "rate_table": {
        "rotate_at": lambda d: d.rotate_at(5.0, acceleration_dps2=None), "oscillate": lambda d: d.oscillate(0.5, 1.0),
        "rate": lambda d: d.rate(), **_HOLDING,
    },
    "thermal_chamber": {
        "ramp_to": lambda d: d.ramp_to(30.0, 1.0), "hold": lambda d: d.hold(), "state": lambda d: d.state()
    },
    "power_supply": {
        "set": lambda d: d.set(5.0, limit=0.1, output=True), "off": lambda d: d.set(0.0, limit=0.0, output=False),
        "read": lambda d: d.read(),
    },
    "current_source": {
        "set": lambda d: d.set(1e-3, limit=10.0, output=True), "off": lambda d: d.set(0.0, limit=0.0, output=False),
        "read": lambda d: d.read(),
    },
    "pulse_counter": _FRAMES, "telemetry": _FRAMES, "voltmeter": _METER, "ammeter": _METER, "thermometer": {},
}  # fmt: skip


def calls_of(driver: str) -> dict[str, Call]:
    """Whatever a sequence may ask of a driver, by name."""
    capabilities = known_drivers()[driver].capabilities
    return _OF_ALL | {name: call for each in sorted(capabilities) for name, call in CALLS[each].items()}
