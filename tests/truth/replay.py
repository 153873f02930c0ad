"""Runs over many seeds at the level of records: what one real run did to the world, done to the worlds of other seeds.

A run through all wires is noted once: every move, ramp and power-on with its time. The same is then done, at the same
times, to a world with other errors and another unit, whose pulses and temperatures become acquisitions straight away,
without engine, wires and drivers. That takes seconds instead of minutes. Units that pulse are replayed, and inertial
units that send codes, not voltages.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from multiprocessing import Pool
from pathlib import Path
from typing import Any, TypeVar
from unittest import mock

import numpy as np

from bench.analysis.acquired import Acquisition, Codes, Counts, Turned
from bench.analysis.outputs import windows_of
from bench.analysis.rundata import RunData, UnitUnderTest
from bench.app.drawn import current_errors, world_settings
from bench.app.laboratory import Laboratory, unit_files
from bench.app.request import RunRequest
from bench.app.truth import truth_of
from bench.config.bench import load_bench
from bench.config.models import BenchFile
from bench.report.findings import evaluate
from bench.report.measured import OnTheWay
from bench.report.rundata import bench_record
from bench.report.stored import open_run
from bench.sequence.methods import known_methods
from bench.sequence.model import SequenceFile
from drivers.can_counter.description import CounterOptions
from drivers.can_telemetry.description import TelemetryOptions
from simulators.current_source import Feed
from simulators.imu import SENSORS
from simulators.unit_file import stream
from simulators.uut import Integrator
from simulators.world import World
from tests.truth.campaign import run_one

STIMULI = ("move", "turn", "swing", "stop", "ramp", "power", "fix_units", "connect")
LATCHES = 20  # worked out together: much shorter than the wander of a bias takes
PAUSE_S = 60.0  # as long at most, while nothing is acquired
TICK_S, BITS = 1e-6, 62
Compared = TypeVar("Compared")


@dataclass(frozen=True)
class Stimulus:
    """Something that an instrument did to the world, at a time of the host."""

    at_s: float
    what: str
    args: tuple[Any, ...]
    named: Mapping[str, Any]


@dataclass(frozen=True)
class Template:
    """What the run in a folder did, what it acquired under each label, and how that is to be reduced."""

    folder: Path
    origin_s: float
    stimuli: Sequence[Stimulus]
    sequence: SequenceFile
    data: Mapping[str, RunData]


def template_of(request: RunRequest) -> Template:
    """Runs a request through all wires, and notes what it does."""
    stimuli: list[Stimulus] = []
    origins_s: list[float] = []
    with _noting(stimuli, origins_s):
        path = run_one(request)
    with open_run(path) as stored:
        labels = dict.fromkeys(label for entry in stored.sequence.results for label in entry.labels)
        data = {label: _without_counts(stored.data(label)) for label in labels}
        return Template(path, origins_s[0], stimuli, stored.sequence, data)


def _without_counts(data: RunData) -> RunData:
    """What another seed counts instead is worked out anew."""
    return replace(data, acquisitions=tuple(replace(each, counts={}) for each in data.acquisitions))


@contextmanager
def _noting(stimuli: list[Stimulus], origins_s: list[float]) -> Iterator[None]:
    def noted(name: str) -> Callable[..., None]:
        honest = getattr(World, name)

        def stimulate(world: World, *args: Any, **named: Any) -> None:
            origins_s.append(world._origin_s)
            stimuli.append(Stimulus(world._host_s(), name, args, named))
            honest(world, *args, **named)

        return stimulate

    with ExitStack() as stack:
        for name in STIMULI:
            stack.enter_context(mock.patch.object(World, name, noted(name)))
        yield


@dataclass(frozen=True)
class Replayed:
    """A run of another seed: its truth, and its results."""

    truth: dict[str, Any]
    results: dict[str, Any]


def replayed(template: Template, bench: BenchFile, seed: int, uut_model: Path | None = None) -> Replayed:
    """The run of the template with everything drawn by another seed; `bench` may also state other uncertainties."""
    player = _Player(template, bench, seed, uut_model)
    data = player.play()
    truth = truth_of(_Stored(template.sequence, data), Laboratory(player.world, {}, {}))
    found = evaluate(template.sequence, data.__getitem__, "completed", OnTheWay())
    return Replayed(*(json.loads(json.dumps(each)) for each in (truth, found.to_json())))  # as files have them


def at_record_level(
    requests: Sequence[RunRequest], compared: Callable[[dict, dict], Compared], processes: int = 2
) -> list[Compared]:
    """What `compared` makes of the truth and of the results of each; the first alone goes through all wires."""
    template = template_of(requests[0])
    bench = load_bench(Path(requests[0].bench)).bench
    with Pool(processes) as pool:
        return pool.starmap(_compared, [(template, bench, each.seed, compared) for each in requests], chunksize=1)


def _compared(template: Template, bench: BenchFile, seed: int, compared: Callable[[dict, dict], Compared]) -> Compared:
    run = replayed(template, bench, seed)
    return compared(run.truth, run.results)


@dataclass
class _SetSource:
    """A current source that gives what it was read back to give; None while its output is off."""

    feeds_a: float | None = None


@dataclass(frozen=True)
class _Stored:
    """As much of a stored run as the truth asks for."""

    sequence: SequenceFile
    data: Mapping[str, RunData]

    def counted_at(self, what: str) -> list[RunData]:
        wanted = [each.labels for each in self.sequence.results if known_methods()[each.method].counts_at == what]
        return [self.data[label] for label in dict.fromkeys(label for labels in wanted for label in labels)]


class _Player:
    """One world under the stimuli of a template."""

    def __init__(self, template: Template, bench: BenchFile, seed: int, uut_model: Path | None) -> None:
        self._template, self._bench, self._host_s = template, bench, template.origin_s
        self.world = World(world_settings(bench, unit_files(bench, uut_model), seed), lambda: self._host_s)
        options = next(e.options for e in bench.devices.values() if isinstance(e.options, CounterOptions))
        self._options, self._period_s = options, options.period
        self._latch_s = options.period / (1 + self.world.settings.device_clock)
        self._counted = {unit.settings.channel: unit for unit in self.world.counted.values() if unit.settings.channel}
        self._sent = {}
        for imu in self.world.imus.values():
            (self._sent if imu.settings.decodings else self._counted).update(imu.channels)
        if self._sent:  # all channels together, in place of latches
            telemetry = next(e.options for e in bench.devices.values() if isinstance(e.options, TelemetryOptions))
            self._period_s = next(iter(telemetry.channels.values())).period
            self._latch_s = self._period_s / (1 + next(iter(self._sent.values())).sent.clock)
            self._noise = {name: stream(seed, "noise", "telemetry", name) for name in self._sent}
        draws = stream(seed, "counter", "start")
        self._integrators = {name: Integrator(float(draws.uniform(0, 1)), 0, 0) for name in self._counted}
        self._origin_s = self._now_s = self.world.now()  # true times of a latch, and up to which all is counted
        self._to_come = list(template.stimuli)
        self._sources = {
            unit.source: _SetSource() for data in template.data.values() for unit in data.units if unit.source
        }
        for role, source in self._sources.items():
            self.world.sources[role] = Feed(source, current_errors(bench, role, seed))

    def play(self) -> dict[str, RunData]:
        """The acquisitions of the template, with what this world gives."""
        every = [(label, each) for label, data in self._template.data.items() for each in data.acquisitions]
        found: dict[str, list[Acquisition]] = {label: [] for label in self._template.data}
        for label, acquisition in sorted(every, key=lambda each: each[1].begin_s):
            self._pass_until(acquisition.begin_s)
            found[label].append(self._acquire(acquisition, self._template.data[label].units))
        record = bench_record(self._bench)
        return {
            label: replace(data, acquisitions=tuple(found[label]), bench=record)
            for label, data in self._template.data.items()
        }

    def _pass_until(self, host_s: float) -> None:
        for stimulus in self._due(host_s):
            self._pause_until(self.world.true_time(stimulus.at_s))
            self._host_s = stimulus.at_s
            self._play(stimulus)
        self._pause_until(self.world.true_time(host_s))

    def _due(self, host_s: float) -> Iterator[Stimulus]:
        while self._to_come and self._to_come[0].at_s <= host_s:
            yield self._to_come.pop(0)

    def _play(self, stimulus: Stimulus) -> None:
        getattr(self.world, stimulus.what)(*stimulus.args, **stimulus.named)

    def _pause_until(self, true_s: float) -> None:
        while true_s - self._now_s > 1e-6:
            step_s = min(PAUSE_S, true_s - self._now_s)
            self._count(np.array([self._now_s, self._now_s + step_s]))

    def _count(self, edges_s: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Works the world out up to the last edge, and counts between the edges."""
        self._host_s = float(self.world.host_time(edges_s[-1]))
        self._now_s = float(edges_s[-1])
        self.world.look()
        found = {}
        for name, unit in self._counted.items():
            pulses = np.array(unit.charge_pulses(edges_s))
            integrator = self._integrators[name]
            found[name] = integrator.count_through_turns(pulses) if unit.swings else integrator.count(pulses)
        for name, unit in self._sent.items():
            codes = unit.mean_codes(edges_s)
            noise = unit.sent.noise_code * self._noise[name].standard_normal(len(codes))
            found[name] = (np.rint(codes + noise), np.empty(0))
        return found

    def _acquire(self, was: Acquisition, units: Sequence[UnitUnderTest]) -> Acquisition:
        ends_s = [self.world.true_time(host_s) for host_s in (was.begin_s, was.end_s)]
        first, last = (math.floor((end_s - self._origin_s) / self._latch_s) for end_s in ends_s)
        at_s = self._origin_s + self._latch_s * np.arange(first + 1, last + 1)
        self._pause_until(float(at_s[0]))
        for role, source in self._sources.items():
            source.feeds_a = was.sources_a.get(role)
        parts = {
            name: [(np.atleast_1d(i.positive), np.atleast_1d(i.negative))] for name, i in self._integrators.items()
        }
        parts |= {name: [] for name in self._sent}
        told: dict[str, list[tuple[float, float]]] = {}
        for block in range(0, len(at_s) - 1, LATCHES):
            edges_s = at_s[block : block + LATCHES + 1]
            for stimulus in self._due(float(self.world.host_time(edges_s[-1]))):  # a ramp begins while it is acquired
                self._play(stimulus)
            for name, part in self._count(edges_s).items():
                parts[name].append(part)
            for name, celsius in self._temperatures(units):
                told.setdefault(name, []).append((self._host_s, celsius))
        counts = {name: self._counts(at_s, each) for name, each in parts.items() if name not in self._sent}
        codes = {name: self._codes(at_s[1:], parts[name]) for name in self._sent}
        thin, turned = bool(was.windows), None if was.turned is None else self._turned(was.turned, at_s)
        return replace(
            was,
            counts={} if thin else counts,
            windows=windows_of(counts | codes, turned) if thin else {},
            turned=turned,
            temperatures_at_s={name: np.array(each)[:, 0] for name, each in told.items()},
            temperatures_c={name: np.array(each)[:, 1] for name, each in told.items()},
        )

    def _counts(self, at_s: np.ndarray, parts: Sequence[tuple[np.ndarray, np.ndarray]]) -> Counts:
        positive, negative = (np.concatenate(each) for each in zip(*parts, strict=True))
        number = np.arange(len(at_s))
        return Counts(
            sequence=number, tick=np.rint(number * (self._period_s / TICK_S)).astype(np.int64), positive=positive,
            negative=negative, host_s=np.asarray(self.world.host_time(at_s)), tick_bits=BITS, counter_bits=BITS,
            tick_period_s=TICK_S, max_rate_pps=self._options.max_rate, lost=0, restarts=0,
        )  # fmt: skip

    def _codes(self, at_s: np.ndarray, parts: Sequence[tuple[np.ndarray, np.ndarray]]) -> Codes:
        number = np.arange(len(at_s))
        return Codes(
            sequence=number, tick=np.rint(number * (self._period_s / TICK_S)).astype(np.int64),
            values=np.concatenate([values for values, _ in parts]), host_s=np.asarray(self.world.host_time(at_s)),
            tick_bits=BITS, tick_period_s=TICK_S, step=1.0, lost=0, dropped=0, invalid=0,
        )  # fmt: skip

    def _turned(self, was: Turned, at_s: np.ndarray) -> Turned:
        """What the encoder told at the first and at the last latch."""
        from_s, to_s = self.world.host_time(at_s[[0, -1]]).tolist()
        from_deg, to_deg = self.world.axis_of(was.axis).encoder_angles_deg(at_s[[0, -1]]).tolist()
        return replace(was, from_s=from_s, from_deg=from_deg, to_s=to_s, to_deg=to_deg)

    def _temperatures(self, units: Sequence[UnitUnderTest]) -> Iterator[tuple[str, float]]:
        now = np.array([self._now_s])
        for unit in units:
            if unit.place in self.world.imus:
                for sensor, name in zip(SENSORS, (unit.temperature, unit.gyro_temperature), strict=True):
                    yield name, float(self.world.imus[unit.place].thermometer_c(sensor, now)[0])
                continue
            yield unit.temperature, float(self.world.counted[unit.place].thermometer_c(now)[0])
            if unit.converter:
                yield unit.converter, float(self.world.units[unit.place].converter_thermometer_c(now)[0])
