"""Each installed driver with the simulator of its instrument, on a bench that has it or in the place of another one."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from bench.app.drawn import AnyUnitFile
from bench.app.laboratory import BenchWires, Laboratory, make_laboratory, unit_files
from bench.config.bench import load_bench
from bench.config.models import BenchFile
from campaigns.line_faults.cases import CASES
from drivers.capabilities import Device
from drivers.description import IdentityPin, Nothing, Setup, known_drivers, make_driver, unheard
from drivers.transport.address import Address
from simulators.faults.instrument_faults import FaultPlan
from simulators.faults.line_faults import BadLine
from tests.support.runs import ROOT

Call = Callable[[Any], Awaitable[object]]


@dataclass(frozen=True)
class Member:
    """One driver: what it is in the place of, and which of "maker", "model", "serial", "firmware" its wire tells.

    `patience_s` is how long it waits for an answer; 0 where nothing is asked.
    """

    bench: str
    role: str
    tells: str
    patience_s: float = 2.0
    connection: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    beside: bool = False  # an instrument that the bench does not have, in the cable of its source

    def bench_of(self, driver: str) -> BenchFile:
        """The bench with the instrument of this driver in it, and nothing stated of who that is."""
        bench = _bench(self.bench)
        if self.beside:
            place = bench.places["a"].model_copy(update={"ammeter": self.role})
            bench = bench.model_copy(update={"places": {"a": place}})
        entry = bench.devices[self.role if not self.beside else "source"]
        if self.beside:
            entry = entry.model_copy(update={"limits": Nothing(), "safe": Nothing(), "calibration": None})
        update: dict[str, Any] = {"driver": driver, "identity": IdentityPin()}
        if self.connection:
            options = known_drivers()[driver].options.model_validate(dict(self.options))
            update |= {"connection": Address.parse(self.connection), "options": options}
        entry = entry.model_copy(update=update)
        return bench.model_copy(update={"devices": {self.role: entry}})


@cache
def _units(name: str) -> Mapping[str, AnyUnitFile]:
    return unit_files(_bench(name), None)


@cache
def _bench(name: str) -> BenchFile:
    return load_bench(ROOT / "config" / f"{name}.yaml").bench


def _line_case(name: str) -> dict[str, Any]:
    case = CASES[name]
    return {"bench": case.bench, "role": case.role, "connection": case.connection, "options": case.options}


EVERY = {
    "acutronic_acl": Member("gyro", "table", "maker model firmware", patience_s=1.0),
    "aerotech_ensemble": Member("simulated", "head", ""),
    "agilent_34970a": Member(
        "simulated", "supply", "maker model firmware", connection="sim+tcp://127.0.0.1:5025",
        options={"channels": {"unit": {"channel": 101, "sensor": "frtd"}}},
    ),
    "binder": Member(**_line_case("binder"), tells="", patience_s=1.0),
    "can_counter": Member("simulated", "counter", "", patience_s=0.0),
    "can_telemetry": Member("channel_telemetry", "telemetry", "", patience_s=0.0),
    "cts": Member(**_line_case("cts"), tells="firmware", patience_s=3.0),
    "espec_p300": Member(**_line_case("espec_p300"), tells="model firmware", patience_s=3.0),
    "fluke_5700a": Member("channel", "source", "maker model serial firmware", patience_s=5.0),
    "framed_head": Member(
        "simulated", "head", "serial", patience_s=0.5, connection="sim+serial:///dev/ttyS0?baud=115200",
        options=dict(CASES["framed_table, TCP"].options),
    ),
    "framed_table": Member(**_line_case("framed_table, TCP"), tells="serial", patience_s=0.5),
    "keithley_6220": Member("simulated", "source", "maker model serial firmware"),
    "keysight_3458a": Member("channel_volts", "dvm", "maker model firmware"),
    "keysight_3458a_ammeter": Member(
        "channel", "dmm", "maker model firmware", connection="sim+tcp://127.0.0.1:1235",
        options={"range": "10 mA"}, beside=True,
    ),
    "modbus_chamber": Member(**_line_case("modbus_chamber, TCP"), tells="", patience_s=3.0),
    "newport_xps": Member("indexing_telemetry", "head", "model firmware"),
    "scpi_supply": Member("simulated", "supply", "maker model serial firmware"),
    "simserv": Member(**_line_case("simserv"), tells="model serial", patience_s=3.0),
    "watlow_f4": Member(**_line_case("watlow_f4"), tells="firmware", patience_s=3.0),
    "watlow_f4t": Member("simulated", "chamber", "", patience_s=3.0),
    "yokogawa_gs200": Member(
        "simulated", "source", "maker model serial firmware", connection="sim+tcp://127.0.0.1:7655",
        options={"range": "10 mA", "compliance": "10 V"},
    ),
}  # fmt: skip


class Opened:
    """A simulated instrument that nobody has spoken to yet, and drivers of it, on a `bad` line if one is given."""

    def __init__(self, driver: str, bad: BadLine | None = None) -> None:
        member = EVERY[driver]
        bench = member.bench_of(driver)
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

    def driver(self, note: Callable[[str], object] = unheard, /, **pin: str) -> Device:
        """A driver of it, not yet connected, with this identity stated; `note` is told what it does on its own."""
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
_FRAMES: dict[str, Call] = {"acquire": _first_block, "news": lambda d: d.news()}
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
