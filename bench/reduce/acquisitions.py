"""Acquisitions of a stored run for the methods: conditions from the journal, data from frames and samples."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from bench.config.models import BenchFile
from bench.metrology.acquisition import Acquisition, Codes, Counts, Currents, Motion, Mount, Positions, Turned, Voltages
from bench.metrology.gaps import missed_of
from bench.metrology.missed import Missed
from bench.metrology.outputs import windows_of
from bench.metrology.run_data import PowerCycles, RunData, TemperatureCircuit, UnitUnderTest
from bench.reduce.certificates import bench_record
from bench.reduce.corrections import Corrections, corrections_of
from bench.sequence.plan.dwells import DwellNames, first_visit, loop_values
from bench.store.decoder import Decoder, decoders_of
from bench.store.reader import Event, RunReader, Series
from drivers.can.frame_block import FrameBlock

STOOD = "stood"  # record of an axis that did not need to move
AS_READ = Corrections({}, {}, {}, {}, {})


def run_data(
    reader: RunReader, bench: BenchFile, serials: Mapping[str, str], label: str, *, windows: bool = False
) -> RunData:
    """Acquisitions under a label, of the units in their places; StoreError if the run does not hold them.

    With `windows` they hold the mean rates instead of the counts.
    """
    dropped_s = {event.data["place"]: event.at_s for event in reader.events("unit_dropped")}
    units = tuple(_unit(place, serial, bench, dropped_s.get(place, math.inf)) for place, serial in serials.items())
    thermometers = [name for unit in units for name in unit.thermometers]
    acquired = tuple(acquisitions(reader, bench, thermometers, label, corrections_of(bench), windows=windows))
    return RunData(label, units, acquired, bench_record(bench), span_s=reader.span_s())


def acquisitions(
    reader: RunReader,
    bench: BenchFile,
    thermometers: Iterable[str],
    label: str,
    corrections: Corrections = AS_READ,
    *,
    windows: bool = False,
) -> Iterator[Acquisition]:
    """Acquisitions under a label with these named readings, in order; raises StoreError.

    Raw data except for the given corrections; `windows` replace counts.
    """
    sent = _Sent(decoders_of(bench.devices, reader.folder), corrections, windows)
    acquired = list(_acquired(reader, bench, label))
    spans_s = [_span_s(event) for event, _, _ in acquired]
    temperatures = {
        name: corrections.temperatures(reader.series(name, spans_s)) for name in dict.fromkeys(thermometers)
    }
    samples = reader.samples_by_step()
    completed = {}
    for event, dwell, state in acquired:
        read = {role: each.T for role, each in samples.get(event.step, {}).items()}
        through = {role: Currents(*read.pop(role)) for role in bench.with_capability("ammeter") if role in read}
        without_output = replace(
            _acquisition(event, dwell, state, temperatures),
            angles_deg={role: corrections.angle_deg(role, at_deg) for role, at_deg in state.angles_deg.items()},
            sources_a={role: corrections.current_a(role, read_a) for role, read_a in state.sources_a.items()},
            voltages={role: corrections.voltages(role, Voltages(*each)) for role, each in read.items()},
            currents={role: corrections.measured(role, each) for role, each in through.items()},
        )
        completed[event.step] = partial(sent.during, without_output)
    yield from reader.of_steps(completed)


@dataclass(frozen=True)
class _Sent:
    """Corrected data of frames: counts, positions of encoders, codes, and losses.

    With `windows`, means instead of counts and codes.
    """

    decoders: Mapping[str, Decoder]
    corrections: Corrections
    windows: bool

    def during(self, acquisition: Acquisition, frames: Mapping[str, FrameBlock]) -> Acquisition:
        """An acquisition with the data of its frames."""
        counts: dict[str, Counts] = {}
        positions: dict[str, Positions] = {}
        codes: dict[str, Codes] = {}
        missed: dict[tuple[str, str], Missed] = {}
        for role, decoder in self.decoders.items():
            block = frames.get(role, FrameBlock.empty())
            decoded = decoder.outputs(block)
            missed |= missed_of(role, decoded)
            for channel, each in decoded.items():
                if isinstance(each, Counts):
                    counts[channel] = self.corrections.counts(role, each)
                else:
                    codes[channel] = each
            positions |= decoder.positions(block)
        if not self.windows:
            return replace(acquisition, counts=counts, codes=codes, positions=positions, missed=missed)
        means = windows_of({**counts, **codes}, acquisition.turned)
        return replace(acquisition, windows=means, positions=positions, missed=missed)


def _unit(place: str, serial: str, bench: BenchFile, until_s: float) -> UnitUnderTest:
    entry = bench.places[place]
    at_gyros = entry.gyro_temperature or entry.temperature
    return UnitUnderTest(
        place=place,
        serial=serial,
        channel=entry.channel,
        mount_angle_deg=entry.mount_angle,
        clock_deg=entry.clock,
        temperature=entry.temperature,
        until_s=until_s,
        voltmeter=entry.voltmeter,
        nominal_per_g=bench.nominal_per_g(place),
        channels=entry.channels.model_dump() if entry.channels is not None else {},
        gyro_temperature=at_gyros if entry.channels is not None else "",
        temperatures=entry.at_sensors,
        circuit=_circuit(place, bench),
        converter=entry.converter_temperature or "",
        source=entry.source or "",
        scale_a_per_g=entry.nominal.amperes_per_g if entry.nominal is not None else math.nan,
        arm_m=entry.arm.vector_m if entry.arm is not None else None,
        arm_u_m=entry.arm.U / entry.arm.k if entry.arm is not None else 0.0,
        supply=entry.supply or "",
        telemetry=entry.telemetry,
        sent_unit=bench.output_unit(place),
        channel_units=bench.sent_units(entry),
        ammeter=entry.ammeter or "",
        power_cycles=None if entry.power_cycles is None else PowerCycles(**entry.power_cycles.standard_u),
    )


def _circuit(place: str, bench: BenchFile) -> TemperatureCircuit | None:
    entry, unit = bench.places[place], bench.circuit_unit(place)
    stated = entry.circuit
    if stated is None or unit is None:
        return None
    found = TemperatureCircuit(stated.output, unit, stated.reference or entry.temperature)
    if stated.nominal is None or stated.slope is None or stated.at is None:
        return found
    return replace(found, nominal=stated.nominal.to(unit), at_c=stated.at, slope=stated.slope.to(f"{unit}/°C"))


@dataclass(frozen=True)
class _BenchState:
    """State of the bench during an acquisition, which has the same fields."""

    angles_deg: Mapping[str, float]
    mount: Mount
    set_c: float
    set_from_c: float = math.nan
    input: str = "accelerometer"
    input_channel: str = ""
    sources_a: Mapping[str, float] = field(default_factory=dict)
    motion: Motion | None = None
    on_since_s: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    came_from: Mapping[str, str] = field(default_factory=dict)
    stand: int = 0
    stretch: int = 0

    def after(self, event: Event, bench: BenchFile, begun_s: float) -> _BenchState:
        """State after a step that began at `begun_s`."""
        data, now = event.data, self
        if "angle_deg" in data:
            device = data.get("device", next(iter(bench.axes), ""))
            now = now.moved({device: float(data["angle_deg"])}, {device: data.get("came_from")})
        if "angles_deg" in data:
            now = now.moved(data["angles_deg"], data.get("came_from", {}))
        if "mount" in data:
            now = replace(now, mount=mount_of(bench, data["mount"]))
        if "input" in data:
            now = replace(now, input=data["input"], input_channel=data.get("input_channel", ""))
        return replace(
            now,
            sources_a=sources_on(now.sources_a, data),
            on_since_s=_supplies_on(now.on_since_s, data, (begun_s, event.at_s)),
            set_c=float(data.get("set_point_c", now.set_c)),
        )

    def moved(self, angles_deg: Mapping[str, float], sides: Mapping[str, str | None]) -> _BenchState:
        """State after a move of axes; the side of approach of an axis not in `sides` is unknown."""
        moved = {role: sides.get(role) for role in angles_deg if sides.get(role) != STOOD}
        came_from = {role: side for role, side in {**self.came_from, **moved}.items() if side is not None}
        return replace(
            self, angles_deg={**self.angles_deg, **angles_deg}, came_from=came_from,
            stand=self.stand + bool(moved),
        )  # fmt: skip

    def interrupted(self) -> _BenchState:
        """State when the run goes on after an interruption: everything was off in between."""
        return replace(self, input="accelerometer", sources_a={}, on_since_s={}, stretch=self.stretch + 1)

    def without(self, roles: set[str]) -> _BenchState:
        """State with unknown angles of axes, or an unknown set point of the chamber."""
        angles_deg = {role: math.nan if role in roles else angle for role, angle in self.angles_deg.items()}
        came_from = {role: side for role, side in self.came_from.items() if role not in roles}
        return replace(
            self, angles_deg=angles_deg, came_from=came_from, stand=self.stand + 1,
            set_c=self.set_c if roles <= set(angles_deg) else math.nan,
        )  # fmt: skip

    @property
    def is_known(self) -> bool:
        """True if the angles of all axes are known."""
        return not any(math.isnan(angle) for angle in self.angles_deg.values())


def _supplies_on(
    before_s: Mapping[str, tuple[float, float]], data: Mapping[str, Any], now_s: tuple[float, float]
) -> Mapping[str, tuple[float, float]]:
    """Supplies that are on after outputs have been set, with the times since when."""
    after_s = dict(before_s)
    for found in data.get("outputs", {data.get("role"): data}).values():
        if found.get("output"):
            if found.get("voltage_v") is not None:
                after_s.setdefault(found["role"], now_s)
        elif "output" in found:
            after_s.pop(found["role"], None)
    return after_s


def sources_on(before_a: Mapping[str, float], data: Mapping[str, Any]) -> Mapping[str, float]:
    """Current sources that are on after outputs have been set."""
    after_a = dict(before_a)
    for found in data.get("outputs", {data.get("role"): data}).values():
        if "output" in found and found.get("voltage_v") is None:
            after_a.pop(found["role"], None)
            if found["output"]:
                after_a[found["role"]] = float(found["current_a"])
    return after_a


def mount_of(bench: BenchFile, name: str | None = None) -> Mount:
    """Return a mount of the fixture by its name; without a name the one at the beginning of a run."""
    mount = bench.fixture.mount(name)
    return Mount(name or next(iter(bench.fixture.mounts), ""), mount.angle, mount.roll, mount.clock)


def _acquired(reader: RunReader, bench: BenchFile, label: str) -> Iterator[tuple[Event, str, _BenchState]]:
    """Finished acquisitions under a label, each with its dwell and the state of the bench.

    Of a repeated step only the last execution counts. Acquisitions after an incomplete move are left out: their angle
    is unknown.
    """
    state = _BenchState(dict.fromkeys(bench.axes, 0.0), mount_of(bench), math.nan)
    dwells = DwellNames()
    found: dict[str, tuple[Event, str, _BenchState]] = {}
    begun: dict[str, tuple[float, float]] = {}
    turning: dict[str, Motion] = {}
    for event in reader.events("step_begins", "turning", "step_ended", "step_failed", "step_cut", "run_resumed"):
        if event.kind == "run_resumed":
            state = state.interrupted()
            continue
        if event.kind == "turning":
            turning[first_visit(event.step)] = Motion(**event.data)
            continue
        if event.kind in ("step_failed", "step_cut"):
            unknown = set(event.data.get("unknown", ()))
            if unknown - set(bench.axes):
                dwells.ramped(first_visit(event.step))
            state = state.without(unknown)
            continue
        if event.kind == "step_begins":
            begun[event.step] = event.at_s, state.set_c
            continue
        begun_s, begun_c = begun[event.step]
        state = state.after(event, bench, begun_s)
        if "set_point_c" in event.data:
            dwells.ramped(first_visit(event.step))
        if event.data.get("label") == label and state.is_known:
            step = first_visit(event.step)
            found.pop(step, None)
            motion = next((each for outer, each in turning.items() if step.startswith(f"{outer}/")), None)
            found[step] = (event, dwells.of(step), replace(state, set_from_c=begun_c, motion=motion))
    yield from found.values()


def _turned(event: Event, motion: Motion | None) -> Turned | None:
    """Rotation over whole turns that an acquisition covered; None for any other."""
    course = event.data.get("turned")
    if course is None or motion is None or motion.rate_dps is None:
        return None
    ends = {key: float(course[key]) for key in ("from_s", "from_deg", "to_s", "to_deg")}
    return Turned(axis=str(course["of"]), command_dps=motion.rate_dps, **ends)


def _span_s(event: Event) -> tuple[float, float]:
    return float(event.data["begin_s"]), float(event.data["end_s"])


def _acquisition(event: Event, dwell: str, state: _BenchState, temperatures: Mapping[str, Series]) -> Acquisition:
    """An acquisition without its output data."""
    begin_s, end_s = _span_s(event)
    meanwhile = {name: series.between(begin_s, end_s) for name, series in temperatures.items()}
    return Acquisition(
        step=event.step,
        group=dwell,
        loops=loop_values(event.step),
        begin_s=begin_s,
        end_s=end_s,
        **vars(state),
        turned=_turned(event, state.motion),
        sources_set_a=state.sources_a,
        counts={},
        temperatures_c={name: series.values for name, series in meanwhile.items()},
        temperatures_at_s={name: series.at_s for name, series in meanwhile.items()},
        over_s=event.data.get("over_s"),
        stable=frozenset(event.data["stable"]) if "stable" in event.data else None,
    )
