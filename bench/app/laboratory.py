"""Creation of the simulated laboratory behind the wires of a bench file."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from bench.app.can_nodes import node_setup
from bench.app.drawn import (
    AnyUnitFile,
    ammeter_input,
    columns,
    current_errors,
    encoder_skew_s,
    voltmeter_settings,
    world_settings,
)
from bench.config.devices import DeviceEntry
from bench.config.document import read_document
from bench.config.load import load
from bench.config.models import BenchFile
from bench.errors import InputError
from bench.loop import BenchLoop
from bench.memory import keep_freed_memory
from bench.reduce.corrections import corrections_of
from drivers.description import DriverDescription
from drivers.installed import loaded
from drivers.transport.address import Address
from drivers.transport.frame_link import FrameLink
from drivers.transport.memory import Line, join
from drivers.transport.wires import RealWires
from simulators.faults.instrument_faults import LINE_FAULTS, FaultPlan
from simulators.faults.line_faults import FaultyLine, LineFault
from simulators.instruments.axes.operator_head import HandTurnedHead
from simulators.instruments.can_nodes.can_node import CanNode, NodeSetup, make_node
from simulators.instruments.meters.keysight_3458a import Simulated3458A
from simulators.instruments.meters.meter_inputs import VoltsOnLoad
from simulators.instruments.setup import InstrumentSetup, NotSimulated, make_instrument
from simulators.physics.source_errors import CurrentSource, Feed
from simulators.physics.voltmeter import VoltmeterSettings
from simulators.serving.serve import Instrument, protocol_factory
from simulators.units.gyro_file import GyroFile
from simulators.units.imu_file import ImuFile
from simulators.units.settings import WorldSettings
from simulators.units.unit_file import UnitFile
from simulators.world import World

P = TypeVar("P", bound=asyncio.Protocol)
TCP = Line(latency_s=0.002)
SERIAL_LATENCY_S = 0.004


@dataclass(frozen=True)
class Laboratory:
    """Simulated world, instruments by role, sources of CAN frames, and drawn errors of voltmeters.

    `by_hand` are heads that people turn, without wires. `lines` are faulty lines, by role.
    """

    world: World
    instruments: dict[str, Instrument]
    nodes: Mapping[str, CanNode]
    voltmeters: Mapping[str, VoltmeterSettings] = field(default_factory=dict)
    by_hand: Mapping[str, HandTurnedHead] = field(default_factory=dict)
    lines: Mapping[str, FaultyLine] = field(default_factory=dict)

    def end_of_line(self, role: str) -> Callable[[], asyncio.Protocol]:
        """Return the instrument at the end of a wire, behind its faulty line if there is one."""
        factory = protocol_factory(self.instruments[role])
        return self.lines[role].server(factory) if role in self.lines else factory

    def leave_frames(self, longest_s: float) -> None:
        """Set the time for which frames may stay with the nodes; longer is faster, but delays their content."""
        for node in self.nodes.values():
            node.longest_block_s = longest_s


def unit_files(
    bench: BenchFile, override: Path | None, places: Collection[str] | None = None
) -> dict[str, AnyUnitFile]:
    """Return the truth of the unit in each place. Raises InputError.

    `override` applies to the units in `places`, None for all.
    """
    overridden = {} if override is None else dict.fromkeys(bench.places if places is None else places, override)
    files = {**bench.simulation.units, **overridden}
    missing = [name for name in bench.places if name not in files]
    if missing:
        raise InputError(f"no simulated unit for place '{missing[0]}': add it to simulation.units of the bench file")
    return {
        name: _unit_file(files[name], is_inertial=place.channels is not None) for name, place in bench.places.items()
    }


def _unit_file(path: Path, *, is_inertial: bool) -> AnyUnitFile:
    """Return an inertial unit, or a unit with an accelerometer or gyro, as in the file."""
    document = read_document(path)
    if is_inertial:
        return load(document, ImuFile)
    has_gyro = isinstance(document.value, dict) and "gyro" in document.value
    return load(document, GyroFile) if has_gyro else load(document, UnitFile)


def check_unit_file(path: Path) -> None:
    """Read the truth of a simulated unit. Raises InputError."""
    content = read_document(path).value
    _unit_file(path, is_inertial=isinstance(content, dict) and "gyros" in content)


def _without_power(settings: WorldSettings, places: Collection[str]) -> WorldSettings:
    """Return the settings with only the units in `places` connected to their supplies."""
    return replace(
        settings,
        places={name: at if name in places else replace(at, supply="") for name, at in settings.places.items()},
        imus={name: at if name in places else replace(at, supply="") for name, at in settings.imus.items()},
    )


def make_laboratory(
    bench: BenchFile,
    units: Mapping[str, AnyUnitFile],
    seed: int,
    host_s: Callable[[], float],
    places: Collection[str] | None = None,
    run_s: float = 0.0,
) -> Laboratory:
    """Return the simulated laboratory of one run with the units in `places` (None: all); the others have no power.

    Drift within a run is spread over `run_s`. The units are in the first chamber of the file, on the axes of its
    fixture. Each further chamber or head has its own air, or its own axis.
    """
    keep_freed_memory()
    around_all = world_settings(bench, units, seed, run_s)
    world = World(around_all if places is None else _without_power(around_all, places), host_s)
    instruments: dict[str, Instrument] = {}
    nodes: dict[str, CanNode] = {}
    voltmeters: dict[str, VoltmeterSettings] = {}
    by_hand: dict[str, HandTurnedHead] = {}
    beside = _separate(bench)
    for role, entry in bench.devices.items():
        faults = FaultPlan(now_s=world.now)
        around = World(replace(world.settings, places={}, imus={}), host_s) if role in beside else world
        if entry.description.frames is not None:
            setup = node_setup(bench, role, world, faults, units, encoder_skew_s(bench, role, seed))
            nodes[role] = _node(role, entry, setup)
        elif entry.connection.is_person:
            by_hand[role] = HandTurnedHead(around, faults, role if role in around.axes else None)
        elif entry.driver == "keysight_3458a":
            voltmeters[role] = voltmeter_settings(bench, role, seed)
            _check_current(voltmeters[role].place, units)
            on_load = VoltsOnLoad(world, voltmeters[role], role)
            instruments[role] = Simulated3458A(world, faults, on_load, name=role)
        elif entry.driver == "keysight_3458a_ammeter":
            in_series = ammeter_input(bench, role, world, seed)
            instruments[role] = Simulated3458A(world, faults, in_series, name=role)
        else:
            instruments[role] = made = _instrument(role, entry, around, faults)
            if isinstance(made, CurrentSource):
                table = columns(corrections_of(bench).currents.get(role))
                world.sources[role] = Feed(made, current_errors(bench, role, seed), table)
                made.load_ohm += bench.burden_ohm(role)
    return Laboratory(world, instruments, nodes, voltmeters, by_hand, _bad_lines(bench, instruments, seed))


def _bad_lines(bench: BenchFile, instruments: Mapping[str, Instrument], seed: int) -> dict[str, FaultyLine]:
    """Return a line for each instrument whose answers have a fault in the bench file."""
    faulty = {fault.device for fault in bench.simulation.faults if fault.kind in LINE_FAULTS}
    return {role: FaultyLine(seed, partial(_line_fault, instruments, role)) for role in instruments if role in faulty}


def _line_fault(instruments: Mapping[str, Instrument], role: str, _number: int) -> LineFault | None:
    return instruments[role].faults.on_the_line()


_MADE_HERE: Mapping[str, type] = {
    "keysight_3458a": Simulated3458A, "keysight_3458a_ammeter": Simulated3458A, "operator_head": HandTurnedHead,
}  # fmt: skip


def simulator_of(driver: DriverDescription) -> type | None:
    """Return the class of the simulator of a driver, or None."""
    made: type | None = loaded(driver.simulator) if driver.simulator else _MADE_HERE.get(driver.name)
    return made


def _separate(bench: BenchFile) -> set[str]:
    """Return the chambers without units, and the heads that carry none."""
    heads = set(bench.with_capability("positioner", "rate_table")) - bench.axes.keys()
    return heads.union(bench.with_capability("thermal_chamber")[1:])


def _check_current(place: str, units: Mapping[str, AnyUnitFile]) -> None:
    """Raise InputError for a gyro on a voltmeter whose file has no `current`."""
    unit = units.get(place)
    if isinstance(unit, GyroFile) and unit.current is None:
        raise InputError(f"the simulated gyro of place '{place}' has no analogue output: its file needs 'current'")


def _target(role: str, entry: DeviceEntry) -> str:
    """Return the simulator of a driver. Raises InputError if there is none."""
    if not entry.description.simulator:
        raise InputError(f"there is no simulator for '{entry.driver}'; '{role}' needs a real connection")
    return entry.description.simulator


def _node(role: str, entry: DeviceEntry, setup: NodeSetup) -> CanNode:
    """Return the simulator of a device that sends frames. Raises InputError if it does not support this bench."""
    try:
        return make_node(_target(role, entry), setup)
    except NotSimulated as problem:
        raise InputError(str(problem)) from None


def _instrument(role: str, entry: DeviceEntry, world: World, faults: FaultPlan) -> Instrument:
    """Return the simulator of a dialect, with identity and settings from the bench file."""
    setup = InstrumentSetup(
        role, world, faults, entry.options, model=entry.identity.model or "", serial=entry.identity.serial or "",
        is_serial_line=entry.connection.is_serial_line, axis=role if role in world.axes else None,
    )  # fmt: skip
    return make_instrument(_target(role, entry), setup)


class BenchWires:
    """Wires of a bench: simulated ones are joined to the laboratory in memory, others are real.

    `bad` are faulty lines, by role.
    """

    def __init__(
        self, bench: BenchFile, laboratory: Laboratory | None, bad: Mapping[str, FaultyLine] | None = None
    ) -> None:
        self._laboratory, self._real, self._bad = laboratory, RealWires(), bad or {}
        loop = asyncio.get_running_loop()
        for role, entry in bench.devices.items():
            address = entry.connection
            if laboratory is not None and address.simulated and address.scheme == "tcp" and isinstance(loop, BenchLoop):
                loop.serve_in_memory(address.host, address.port, self._instrument(laboratory, role), TCP)

    async def stream(self, device: str, address: Address, factory: Callable[[], P]) -> P:
        """Connect `factory()` to a TCP connection or a serial line."""
        if self._laboratory is None or not address.simulated or address.scheme == "tcp":
            return await self._real.stream(device, address, factory)
        line = Line.serial(address.option("baud", 9600), SERIAL_LATENCY_S)
        protocol = factory()
        join(protocol, self._instrument(self._laboratory, device)(), line, str(address))
        return protocol

    async def frames(self, device: str, address: Address) -> FrameLink:
        """Open a CAN channel."""
        if self._laboratory is not None and address.simulated:
            return self._laboratory.nodes[device]
        return await self._real.frames(device, address)

    def _instrument(self, laboratory: Laboratory, role: str) -> Callable[[], asyncio.Protocol]:
        """Return the far end of a simulated wire, behind a faulty line if there is one."""
        factory = laboratory.end_of_line(role)
        return self._bad[role].server(factory) if role in self._bad else factory
