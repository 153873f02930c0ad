"""One world under the stimuli of a run that another world has been through, and what it gives in place of that one.

Pulses, codes, encoders and temperatures become acquisitions straight away, without engine, wires and drivers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.app.can_nodes import thermometers_at
from bench.app.drawn import current_errors, world_settings
from bench.app.laboratory import unit_files
from bench.config.models import BenchFile
from bench.metrology.acquisition import Acquisition, Codes, Counts, Positions, Turned
from bench.metrology.outputs import windows_of
from bench.metrology.run_data import RunData, UnitUnderTest
from bench.reduce.certificates import bench_record
from bench.sequence.document.model import SequenceFile
from campaigns.truth.foreign import Drifts
from drivers.dialects.can_counter.description import CounterOptions
from drivers.dialects.can_telemetry.description import TelemetryOptions
from simulators.physics.integrator import Integrator
from simulators.physics.source_errors import Feed
from simulators.units.unit_file import stream
from simulators.world import World

BLOCK_S = 8.0  # computed at once; temperatures change evenly within it
PAUSE_S = 60.0  # as long at most, while nothing is acquired
LEAD_S = 0.5  # before an acquisition, latch by latch for units that follow a swing: many times what they remember
TICK_S, BITS = 1e-6, 62


@dataclass(frozen=True)
class Stimulus:
    """Something that an instrument did to the world, at a time of the host."""

    at_s: float
    what: str
    args: tuple[Any, ...]
    named: Mapping[str, Any]


@dataclass(frozen=True)
class Template:
    """Actions of the run in a folder, its acquisitions by label, and their reduction."""

    folder: Path
    origin_s: float
    stimuli: Sequence[Stimulus]
    sequence: SequenceFile
    data: Mapping[str, RunData]


@dataclass
class _SetSource:
    """A current source that gives what it was read back to give; None while its output is off."""

    feeds_a: float | None = None


class Player:
    """One world under the stimuli of a template."""

    def __init__(
        self, template: Template, bench: BenchFile, seed: int, uut_model: Path | None, *, drifting: bool = False
    ) -> None:
        self._template, self._bench, self._host_s = template, bench, template.origin_s
        began_s, ended_s = next(iter(template.data.values())).span_s
        settings = world_settings(bench, unit_files(bench, uut_model), seed, ended_s - began_s)
        self.world = World(settings, lambda: self._host_s)
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
        self._drifts = Drifts(self.world) if drifting else None
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
            if self._drifts is not None:
                at_s = np.array([acquisition.begin_s])
                self._drifts.go_to(2 * float(self._template.data[label].run_share(at_s)[0]))
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
        self._lead_to(self.world.true_time(host_s))

    def _due(self, host_s: float) -> Iterator[Stimulus]:
        while self._to_come and self._to_come[0].at_s <= host_s:
            yield self._to_come.pop(0)

    def _play(self, stimulus: Stimulus) -> None:
        getattr(self.world, stimulus.what)(*stimulus.args, **stimulus.named)

    def _pause_until(self, true_s: float) -> None:
        while true_s - self._now_s > 1e-6:
            step_s = min(PAUSE_S, true_s - self._now_s)
            self._count(np.array([self._now_s, self._now_s + step_s]))

    def _lead_to(self, true_s: float) -> None:
        """As a pause, but so that what swings at the end of it is followed."""
        if any(unit.swings for unit in self._counted.values()):
            latches = math.floor(min(LEAD_S, true_s - self._now_s) / self._latch_s)
            self._pause_until(true_s - latches * self._latch_s)
            if latches:
                self._count(true_s - self._latch_s * np.arange(latches, -1, -1))
        self._pause_until(true_s)

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
        block = max(1, round(BLOCK_S / self._latch_s))
        for begin in range(0, len(at_s) - 1, block):
            edges_s = at_s[begin : begin + block + 1]
            for stimulus in self._due(float(self.world.host_time(edges_s[-1]))):  # a ramp begins during an acquisition
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
            positions={name: self._positions(name, each, at_s) for name, each in was.positions.items()},
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

    def _positions(self, role: str, was: Positions, at_s: np.ndarray) -> Positions:
        """Encoder readings of an axis at the latches, with their delay."""
        number = np.arange(len(at_s))
        angle_deg = self.world.axis_of(role).encoder_angles_deg(at_s + self.world.settings.encoder_skew_s)
        return replace(
            was, sequence=number, tick=np.rint(number * (self._period_s / TICK_S)).astype(np.int64),
            position=np.floor(angle_deg / was.resolution_deg).astype(np.int64), tick_bits=BITS, position_bits=BITS,
            tick_period_s=TICK_S, host_s=np.asarray(self.world.host_time(at_s)),
        )  # fmt: skip

    def _turned(self, was: Turned, at_s: np.ndarray) -> Turned:
        """Encoder readings at the first and the last latch."""
        from_s, to_s = self.world.host_time(at_s[[0, -1]]).tolist()
        from_deg, to_deg = self.world.axis_of(was.axis).encoder_angles_deg(at_s[[0, -1]]).tolist()
        return was._replace(from_s=from_s, from_deg=from_deg, to_s=to_s, to_deg=to_deg)

    def _temperatures(self, units: Sequence[UnitUnderTest]) -> Iterator[tuple[str, float]]:
        now = np.array([self._now_s])
        for unit in units:
            if unit.place in self.world.imus:
                for name, at in thermometers_at(self._bench.places[unit.place]).items():
                    yield name, float(self.world.imus[unit.place].thermometer_c(at, now)[0])
            else:
                yield unit.temperature, float(self.world.counted[unit.place].thermometer_c(now)[0])
            if unit.converter:
                with_board = self.world.imus if unit.place in self.world.imus else self.world.units
                yield unit.converter, float(with_board[unit.place].converter_thermometer_c(now)[0])
