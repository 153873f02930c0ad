"""From a bench file to the simulated laboratory behind its wires.

The laboratory's own errors are drawn by the seed: what a certificate bounds with sd = U / k of the certificate, the
rest as the bench file's `simulation:` says. Each draw has a stream of its own.
"""

from __future__ import annotations

import asyncio
import cmath
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from bench.analysis.rundata import AxisRecord, BenchRecord
from bench.config.devices import DeviceEntry
from bench.config.document import read_document
from bench.config.fixture import Mount
from bench.config.load import load
from bench.config.models import BenchFile
from bench.config.places import PlaceEntry
from bench.config.simulation import SourceSimulation, TableSimulation
from bench.errors import InputError
from bench.loop import BenchLoop
from bench.report.corrections import Table as CorrectionTable
from bench.report.corrections import corrections_of
from bench.report.rundata import HOUR_S, bench_record
from drivers.can_counter import wire as counter_wire
from drivers.can_counter.description import CounterOptions
from drivers.can_options import text_of
from drivers.can_telemetry import wire as telemetry_wire
from drivers.can_telemetry.description import TelemetryOptions
from drivers.dbc import Dbc
from drivers.transport.address import Address
from drivers.transport.frames import FrameLink
from drivers.transport.memory import Line, join
from drivers.transport.wires import RealWires
from simulators import attitude
from simulators.acutronic_acl import SimulatedAcutrol
from simulators.aerotech_ensemble import SimulatedEnsemble
from simulators.attitude import SOUTH, Fixture, Vector, tilted
from simulators.can_counter import CounterSettings, SimulatedCounter
from simulators.can_node import CanNode
from simulators.can_telemetry import ChannelSettings, SimulatedTelemetry, TelemetrySettings
from simulators.carried import NOWHERE, TableErrors
from simulators.corrections import Table
from simulators.current_source import CurrentErrors, Feed
from simulators.faults import FaultPlan
from simulators.fluke_5700a import SimulatedFluke
from simulators.gyro_unit import GyroFile
from simulators.imu import SENSORS, ImuPlace
from simulators.imu_file import ImuFile
from simulators.keithley_6220 import SimulatedKeithley
from simulators.keysight_3458a import Simulated3458A, VoltmeterSettings
from simulators.motion import AxisErrors
from simulators.scpi_supply import SimulatedSupply
from simulators.serve import Instrument, protocol_factory
from simulators.settings import PlaceSettings, WorldSettings
from simulators.table import Loop, Ripple
from simulators.thermal import ChamberPhysics
from simulators.unit_file import UnitFile, stream
from simulators.uut import Decoding
from simulators.watlow_f4t import SimulatedF4T
from simulators.world import World

P = TypeVar("P", bound=asyncio.Protocol)
TCP = Line(latency_s=0.002)
SERIAL_LATENCY_S = 0.004
ARCSEC_PER_DEG = 3600


@dataclass(frozen=True)
class Laboratory:
    """A world, the instruments in it by role, what sends CAN frames, and the voltmeters' errors as drawn."""

    world: World
    instruments: Mapping[str, Instrument]
    nodes: Mapping[str, CanNode]
    voltmeters: Mapping[str, VoltmeterSettings] = field(default_factory=dict)


AnyUnitFile = UnitFile | GyroFile | ImuFile


def unit_files(bench: BenchFile, override: Path | None) -> dict[str, AnyUnitFile]:
    """The truth of the unit in each place; `override` takes the place of all of them. InputError."""
    missing = [name for name in bench.places if name not in bench.simulation.units and override is None]
    if missing:
        raise InputError(f"no simulated unit for place '{missing[0]}': add it to simulation.units of the bench file")
    return {
        name: _unit_file(override or bench.simulation.units[name], is_inertial=place.channels is not None)
        for name, place in bench.places.items()
    }


def _unit_file(path: Path, *, is_inertial: bool) -> AnyUnitFile:
    """An inertial unit, or a unit with an accelerometer, or with a gyro where the file has one."""
    document = read_document(path)
    if is_inertial:
        return load(document, ImuFile)
    has_gyro = isinstance(document.value, dict) and "gyro" in document.value
    return load(document, GyroFile) if has_gyro else load(document, UnitFile)


def make_laboratory(
    bench: BenchFile, units: Mapping[str, AnyUnitFile], seed: int, host_s: Callable[[], float]
) -> Laboratory:
    """The laboratory of one run."""
    world = World(world_settings(bench, units, seed), host_s)
    instruments: dict[str, Instrument] = {}
    nodes: dict[str, CanNode] = {}
    voltmeters: dict[str, VoltmeterSettings] = {}
    for role, entry in bench.devices.items():
        faults = FaultPlan({f.kind: f.at for f in bench.simulation.faults if f.device == role}, world.now)
        if isinstance(entry.options, CounterOptions):
            nodes[role] = SimulatedCounter(world, _counter_settings(bench, role, entry.options), faults)
        elif isinstance(entry.options, TelemetryOptions):
            nodes[role] = SimulatedTelemetry(world, _telemetry_settings(bench, role, entry.options, units), faults)
        elif entry.driver == "keysight_3458a":
            voltmeters[role] = _voltmeter_settings(bench, role, seed)
            instruments[role] = Simulated3458A(world, faults, voltmeters[role], name=role)
        else:
            instruments[role] = made = _instrument(role, entry, world, faults)
            if isinstance(made, (SimulatedFluke, SimulatedKeithley)):
                table = _columns(corrections_of(bench).currents.get(role))
                world.sources[role] = Feed(made, _current_errors(bench, role, seed), table)
    return Laboratory(world, instruments, nodes, voltmeters)


def world_settings(bench: BenchFile, units: Mapping[str, AnyUnitFile], seed: int) -> WorldSettings:
    """The laboratory's errors as drawn for one run."""
    stated, simulation, corrections = bench_record(bench), bench.simulation, corrections_of(bench)
    table = simulation.table

    def draw(sd: float, *path: str) -> float:
        return float(sd * stream(seed, "bench", *path).standard_normal())

    def thermometer(reading: str) -> tuple[float, float, Table]:
        offset_u, gain_u = stated.thermometers_u.get(reading, (0.0, 0.0))
        table = _columns(corrections.thermometers.get(reading))
        return draw(offset_u, reading, "offset"), draw(gain_u, reading, "gain"), table

    def place(name: str, unit: UnitFile | GyroFile, entry: PlaceEntry) -> PlaceSettings:
        offset_c, gain, table = thermometer(entry.temperature)
        converter_offset_c, converter_gain, converter_table = thermometer(entry.converter_temperature or "")
        return PlaceSettings(
            unit=unit,
            channel=entry.channel,
            supply=entry.supply,
            mount_angle_deg=entry.mount_angle,
            thermometer_offset_c=offset_c,
            thermometer_gain=gain,
            thermometer_table=table,
            faults={fault.kind: fault.at for fault in simulation.faults if fault.unit == name},
            load_ohm=next((each.load for role, each in simulation.voltmeters.items() if role == entry.voltmeter), None),
            converter_offset_c=converter_offset_c,
            converter_gain=converter_gain,
            converter_table=converter_table,
            source=entry.source or "",
            arm_m=_arm_m(name, entry, draw),
            decoding=_decoding(bench, entry),
        )

    def imu(name: str, unit: ImuFile, entry: PlaceEntry) -> ImuPlace:
        readings = (entry.temperature, entry.gyro_temperature or entry.temperature)
        return ImuPlace(
            unit=unit,
            channels=entry.channels.model_dump() if entry.channels is not None else {},
            supply=entry.supply,
            mount_angle_deg=entry.mount_angle,
            thermometers={sensor: thermometer(reading) for sensor, reading in zip(SENSORS, readings, strict=True)},
            faults={fault.kind: fault.at for fault in simulation.faults if fault.unit == name},
        )

    def axis(role: str, path: tuple[str, ...]) -> AxisErrors:
        known = stated.axes.get(role, AxisRecord())
        harmonics = enumerate(known.harmonics_u_deg, start=1)
        amplitudes = [
            [draw(u, "head", *path, str(order), shape) for shape in ("cosine", "sine")] for order, u in harmonics
        ]
        return AxisErrors(
            zero_deg=draw(known.zero_u_deg, "head", *path, "zero"),
            cosines=tuple(cosine for cosine, _ in amplitudes),
            sines=tuple(sine for _, sine in amplitudes),
            backlash_deg=simulation.head.backlash / ARCSEC_PER_DEG,
            repeatability_deg=known.repeatability_u_deg,
            table=_columns(corrections.axes.get(role)),
        )

    fixture = Fixture(tuple(bench.axes.values()) or (SOUTH,), bench.fixture.x, bench.fixture.z)
    entries = [(name, units[name], entry) for name, entry in bench.places.items()]
    return WorldSettings(
        seed=seed,
        gravity_mps2=stated.gravity_mps2 + draw(stated.gravity_u_mps2, "gravity"),
        host_clock=draw(simulation.host_clock, "host clock"),
        device_clock=draw(stated.time_base_u, "counter", "time base") - next(iter(corrections.clocks.values()), 0.0),
        encoder_skew_s=draw(stated.encoder_skew_u_s, "counter", "encoder skew"),
        axes={role: axis(role, () if number == 0 else (role,)) for number, role in enumerate(bench.axes or ["head"])},
        axis_acceleration_dps2=simulation.head.acceleration,
        mount=simulated_mount(bench.fixture.mount()),
        level_deg=stated.level_deg + draw(stated.level_u_deg, "level"),
        latitude_deg=bench.site.latitude,
        table=TableErrors() if table is None else _table_errors(table, stated, seed, draw),
        fixture=fixture,
        built=_built(fixture, stated, draw),
        chamber=ChamberPhysics(
            start_c=simulation.chamber.start,
            natural_period_s=simulation.chamber.natural_period,
            damping=simulation.chamber.damping,
            limit_cycle_c=simulation.chamber.limit_cycle,
            limit_cycle_period_s=simulation.chamber.limit_cycle_period,
        ),
        remount_deg=simulation.remount / 3600,
        thermometer_lag_s=simulation.thermometer.lag,
        thermometer_noise_c=simulation.thermometer.noise,
        places={name: place(name, unit, entry) for name, unit, entry in entries if not isinstance(unit, ImuFile)},
        imus={name: imu(name, unit, entry) for name, unit, entry in entries if isinstance(unit, ImuFile)},
    )


def _built(fixture: Fixture, stated: BenchRecord, draw: Callable[..., float]) -> Fixture:
    """A table with several axes as it was put up: turned about the vertical, tilted eastwards, its axes not square."""
    if len(fixture.axes) < 2:
        return fixture
    base_deg = (draw(stated.level_u_deg, "level", "east"), 0.0, draw(stated.azimuth_u_deg, "azimuth"))
    apart = [
        (draw(stated.orthogonality_u_deg, "orthogonality", str(number), "first"),
         draw(stated.orthogonality_u_deg, "orthogonality", str(number), "second"))
        for number in range(1, len(fixture.axes))
    ]  # fmt: skip
    return tilted(fixture, base_deg, apart)


def _columns(table: CorrectionTable | None) -> Table:
    """A table of corrections as the simulated world knows it."""
    return (tuple(table.at.tolist()), tuple(table.add.tolist())) if table is not None else ((), ())


def _arm_m(place: str, entry: PlaceEntry, draw: Callable[..., float]) -> Vector:
    """Where the sensor truly is: as the bench file says, with the errors that it admits."""
    if entry.arm is None:
        return NOWHERE
    u_m = entry.arm.U / entry.arm.k
    x_m, y_m, z_m = (at_m + draw(u_m, place, "arm", axis) for at_m, axis in zip(entry.arm.vector_m, "xyz", strict=True))
    return x_m, y_m, z_m


def _table_errors(table: TableSimulation, stated: BenchRecord, seed: int, draw: Callable[..., float]) -> TableErrors:
    """What the table does that it is not told; a base that is level within u about one axis is so about the other."""
    phases = stream(seed, "bench", "table", "ripple").uniform(0, 2 * math.pi, 3)
    wobble = complex(*(draw(stated.head.wobble_u_deg, "table", "wobble", shape) for shape in ("cosine", "sine")))
    return TableErrors(
        loop=Loop(table.loop, table.damping, math.degrees(table.torque / table.inertia)),
        ripple=Ripple(table.ripple, (1, 2, 2 * table.pole_pairs), tuple(phases.tolist())),
        rate=draw(table.rate, "table", "rate"),
        across_deg=draw(stated.level_u_deg, "level", "across"),
        wobble_deg=abs(wobble),
        wobble_phase_rad=-cmath.phase(wobble),
    )


def simulated_mount(mount: Mount) -> attitude.Mount:
    """A mount as the simulated world knows it."""
    return attitude.Mount(mount.angle, mount.roll, mount.clock)


def _counter_settings(bench: BenchFile, role: str, options: CounterOptions) -> CounterSettings:
    dbc = Dbc(text_of(options.dbc))
    channels = {name: channel.model_dump() for name, channel in options.channels.items()}
    readings: dict[str, str] = {}
    imu_readings: dict[str, tuple[str, str]] = {}
    for name, place in bench.places.items():
        at = (place.temperature, place.gyro_temperature or place.temperature)
        shown = [bench.readings[each] for each in at]
        if place.channels is None and shown[0].device == role:
            readings[shown[0].channel] = name
        elif place.channels is not None:
            imu_readings |= {
                each.channel: (name, sensor) for each, sensor in zip(shown, SENSORS, strict=True) if each.device == role
            }
    positions = {name: encoder.model_dump() for name, encoder in options.positions.items()}
    latch = options.latch
    form = counter_wire.counter_format(dbc, latch.model_dump(), latch.tick_period, channels, positions)
    boards = {
        bench.readings[place.converter_temperature].channel: name
        for name, place in bench.places.items()
        if place.converter_temperature and bench.readings[place.converter_temperature].device == role
    }
    encoders = {name: ARCSEC_PER_DEG / encoder.resolution for name, encoder in options.positions.items()}
    return CounterSettings(role, dbc, form, options.period, readings, boards, imu_readings, encoders)


def _telemetry_formats(options: TelemetryOptions) -> tuple[Dbc, Mapping[str, telemetry_wire.SampleFormat]]:
    dbc = Dbc(text_of(options.dbc))
    channels = {name: sample.model_dump() for name, sample in options.channels.items()}
    return dbc, telemetry_wire.sample_formats(dbc, channels)


def _decoding(bench: BenchFile, entry: PlaceEntry) -> Decoding | None:
    """What becomes of the codes of a unit that sends its output; None of any other."""
    for device in bench.devices.values():
        if isinstance(device.options, TelemetryOptions) and entry.telemetry in device.options.channels:
            form = _telemetry_formats(device.options)[1][entry.telemetry]
            return Decoding(form.value.signal.scale, form.value.signal.offset) if form.decoded else Decoding()
    return None


def _telemetry_settings(
    bench: BenchFile, role: str, options: TelemetryOptions, units: Mapping[str, AnyUnitFile]
) -> TelemetrySettings:
    """The channels of a telemetry that have a unit; InputError when its truth says nothing of codes."""
    dbc, forms = _telemetry_formats(options)
    places = {entry.telemetry: name for name, entry in bench.places.items() if entry.telemetry in forms}
    for name in places.values():
        unit = units[name]
        if not isinstance(unit, UnitFile) or unit.telemetry is None:
            raise InputError(f"the simulated unit of place '{name}' sends no codes: its file needs 'telemetry'")
    messages = [forms[channel].value.message.name for channel in places if channel is not None]
    if len(set(messages)) < len(messages):
        raise InputError(f"'{role}' has several channels in one message, which simulated units do not send")
    return TelemetrySettings(
        name=role,
        dbc=dbc,
        channels={
            channel: ChannelSettings(forms[channel], sample.period, sample.tick_period, places[channel])
            for channel, sample in options.channels.items()
            if channel in places
        },
        readings={
            bench.readings[entry.temperature].channel: name
            for name, entry in bench.places.items()
            if bench.readings[entry.temperature].device == role
        },
    )


def _current_errors(bench: BenchFile, role: str, seed: int) -> CurrentErrors:
    """A source's errors, drawn from its certificate, or else as the bench file's `simulation:` says."""
    certified, own = bench_record(bench).sources.get(role), bench.simulation.sources.get(role, SourceSimulation())

    def draw(error: str, certified_u: float, otherwise: float) -> float:
        return float((certified_u or otherwise) * stream(seed, "bench", role, error).standard_normal())

    return CurrentErrors(
        gain=draw("gain", certified.gain_u if certified else 0.0, own.gain),
        offset_a=draw("offset", certified.offset_u_a if certified else 0.0, own.offset),
        drift_per_h=draw("drift", certified.drift_u_per_s * HOUR_S if certified else 0.0, own.drift),
        fresh=own.fresh,
        warm_up_s=own.warm_up,
    )


def _voltmeter_settings(bench: BenchFile, role: str, seed: int) -> VoltmeterSettings:
    """What a voltmeter is connected to, and its errors as drawn from its certificate; InputError."""
    connected, certificate = bench.simulation.voltmeters.get(role), bench.devices[role].calibration
    if connected is None:
        raise InputError(f"nothing is connected to '{role}': add it to simulation.voltmeters of the bench file")

    def draw(error: str) -> float:
        """What is left of an error once the certificate has corrected it, less that correction."""
        if certificate is None:
            return 0.0
        sd, corrected = getattr(certificate.U, error) / certificate.k, getattr(certificate.corrections, error)
        return float(sd * stream(seed, "bench", role, error).standard_normal() - corrected)

    return VoltmeterSettings(connected.place, connected.load, draw("gain"), draw("offset"), connected.noise)


def _instrument(role: str, entry: DeviceEntry, world: World, faults: FaultPlan) -> Instrument:
    """The simulator of a dialect, with the identity and settings that the bench file states."""
    options: Any = entry.options  # validated by the driver's own model
    pin = entry.identity
    driven = role if role in world.axes else None
    match entry.driver:
        case "watlow_f4t":
            return SimulatedF4T(
                world, faults, unit_id=options.unit_id, loop=options.loop, word_order=options.word_order
            )
        case "acutronic_acl":
            return SimulatedAcutrol(world, faults, axis=options.axis, byte_order=options.byte_order, role=driven)
        case "aerotech_ensemble":
            return SimulatedEnsemble(world, faults, axis=options.axis, role=driven)
        case "scpi_supply":
            return SimulatedSupply(
                world, faults, name=role, model=pin.model or "SIM-PSU", serial=pin.serial or "SIM-PSU-01"
            )
        case "keithley_6220":
            return SimulatedKeithley(world, faults, serial=pin.serial or "SIM-6220-01", terminator=options.terminator)
        case "fluke_5700a":
            return SimulatedFluke(
                world, faults, model=pin.model or "5720A", serial=pin.serial or "SIM-5720A-01",
                compliance_v=options.compliance, terminator=options.terminator,
            )  # fmt: skip
        case _:
            raise InputError(f"there is no simulator for '{entry.driver}'; '{role}' needs a real connection")


class BenchWires:
    """Joins what the bench file marks as simulated to the laboratory, in memory; everything else to real wires."""

    def __init__(self, bench: BenchFile, laboratory: Laboratory | None) -> None:
        self._laboratory, self._real = laboratory, RealWires()
        loop = asyncio.get_running_loop()
        for role, entry in bench.devices.items():
            address = entry.connection
            if laboratory is not None and address.simulated and address.scheme == "tcp" and isinstance(loop, BenchLoop):
                factory = protocol_factory(laboratory.instruments[role])
                loop.serve_in_memory(address.host, address.port, factory, TCP)

    async def stream(self, device: str, address: Address, factory: Callable[[], P]) -> P:
        """Joins `factory()` to a TCP connection or a serial line."""
        if self._laboratory is None or not address.simulated or address.scheme == "tcp":
            return await self._real.stream(device, address, factory)
        line = Line.serial(address.option("baud", 9600), SERIAL_LATENCY_S)
        protocol = factory()
        join(protocol, protocol_factory(self._laboratory.instruments[device])(), line, str(address))
        return protocol

    async def frames(self, device: str, address: Address) -> FrameLink:
        """An open CAN channel."""
        if self._laboratory is not None and address.simulated:
            return self._laboratory.nodes[device]
        return await self._real.frames(device, address)
