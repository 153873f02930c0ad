"""Deviation of outputs from what the bench file lets expect of a unit at rest, for curves.

The expectation is the nominal change of the output for 1 g, times the part of gravity along the sensor's axis at the
angles to which the axes of the table were moved: S·K1·g_x, or of an inertial unit one such product for each
accelerometer. While the current source is plugged into a converter, it is S·I instead. There is none while the table
moves, before its first move, of gyros, and of units without nominal data in the bench file.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from bench.config.bench import load_kept_bench
from bench.config.models import BenchFile
from bench.metrology.orientation import turned_axes
from bench.reduce.acquisitions import mount_of, sources_on
from bench.store.reader import Event
from bench.store.runs import BENCH_COPY
from bench.store.tail import Bucket, Tail

DEVIATION = ".deviation"  # added to the name of a channel


@dataclass(frozen=True, slots=True)
class Stimulus:
    """Stimulus of the units: angles of the axes moved so far, mount, and currents of sources that are on, in A.

    `moving` are the axes whose angles are not known; `input` is what feeds the converters, of inertial units that of
    the channel `input_channel`.
    """

    angles_deg: Mapping[str, float] = field(default_factory=dict)
    moving: frozenset[str] = frozenset()
    mount: str | None = None
    input: str = "accelerometer"
    input_channel: str = ""
    sources_a: Mapping[str, float] = field(default_factory=dict)

    def after(self, event: Event, axes: Sequence[str]) -> Stimulus:
        """Return the stimulus after an entry of the journal."""
        data = event.data
        match event.kind:
            case "run_resumed":  # everything was off in between, and a person may have turned the table
                return replace(self, moving=frozenset(axes), input="accelerometer", sources_a={})
            case "step_begins":
                begun = axes if "attitude" in data else [axis for axis in axes if axis == data.get("device")]
                return replace(self, moving=self.moving.union(begun))
            case "step_ended":
                return self._after_step(data, axes)
            case _:
                return self

    def _after_step(self, data: Mapping[str, Any], axes: Sequence[str]) -> Stimulus:
        moved = data.get("angles_deg", {data.get("device"): data["angle_deg"]} if "angle_deg" in data else {})
        return replace(
            self, angles_deg={**self.angles_deg, **moved},
            moving=self.moving.difference(axes if "angles_deg" in data else moved),
            mount=data.get("mount", self.mount), input=data.get("input", self.input),
            input_channel=data.get("input_channel", "") if "input" in data else self.input_channel,
            sources_a=sources_on(self.sources_a, data),
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Expectation:
    """Expected output of a sensor of the unit in a place, in `unit`.

    `per_g` is the change of its output for 1 g, `per_a` for 1 A of the source of the place. `row` is that of its axis
    in the orientation of the unit: the input axis, or x, y and z. `channel` is that of an inertial unit.
    """

    bench: BenchFile
    place: str
    unit: str
    per_g: float
    per_a: float | None = None
    row: int = 0
    channel: str = ""

    def at(self, acts: Stimulus) -> float | None:
        """Return the expected output; None if it is not known."""
        entry, fixture = self.bench.places[self.place], self.bench.fixture
        if entry.source is not None and acts.input == "source":
            fed = acts.input_channel in ("", self.channel)
            return None if self.per_a is None else self.per_a * fed * acts.sources_a.get(entry.source, 0.0)
        if acts.moving or (self.bench.axes and not acts.angles_deg):
            return None
        turns = [(points, acts.angles_deg.get(role, 0.0)) for role, points in self.bench.axes.items()]
        axes = turned_axes(
            turns, fixture.x, fixture.z, mount_of(self.bench, acts.mount), (entry.mount_angle, entry.clock)
        )
        return self.per_g * float(axes[self.row, 2])


@lru_cache(maxsize=32)  # the copy of the bench file in a run does not change
def bench_of(run: Path) -> BenchFile:
    """Return the bench of a run. Raises InputError."""
    return load_kept_bench(run / BENCH_COPY)


@lru_cache(maxsize=32)
def expectations(run: Path) -> Mapping[str, Expectation]:
    """Return the expectation of each channel, as DEVICE.CHANNEL, of the bench of a run. Raises InputError."""
    return dict(_expectations(bench_of(run)))


def _expectations(bench: BenchFile) -> Iterator[tuple[str, Expectation]]:
    devices = bench.devices.items()
    names = {channel: f"{role}.{channel}" for role, entry in devices for channel in entry.outputs}
    names |= {role: f"{role}.voltage" for role in bench.with_capability("voltmeter")}
    for place, entry in bench.places.items():
        per_g, nominal = bench.nominal_per_g(place), entry.nominal
        if per_g is None or nominal is None:
            continue
        per_a = None if nominal.K1 is None else per_g / nominal.K1
        sensors = entry.accelerometers or {"": entry.channel or entry.telemetry or entry.voltmeter or ""}
        for row, (sensor, channel) in enumerate(sensors.items()):
            if channel in names:
                yield names[channel], Expectation(bench, place, bench.output_unit(place), per_g, per_a, row, sensor)


def course(tail: Tail, bench: BenchFile) -> list[tuple[float, Stimulus]]:
    """Return the stimulus of the units of a bench from each instant on, by the journal; the first is from -∞ on."""
    axes = list(bench.axes)
    named = [*axes, *bench.with_capability("current_source"), "mount", "input", "attitude", "angles_deg"]
    events = tail.steps_with([f'"{name}"' for name in named]) + tail.of_kinds(["run_resumed"], 1000)
    acts = Stimulus()
    found = [(-math.inf, acts)]
    for event in sorted(events, key=lambda each: each.seq):
        acts = acts.after(event, axes)
        found.append((event.at_s, acts))
    return found


def deviation(
    acts: Sequence[tuple[float, Stimulus]], expected: Expectation, outputs: Iterable[Bucket], width_s: float
) -> list[Bucket]:
    """Return outputs minus their expectation; left out are intervals without one, or in which it changes."""
    begins, values = [at_s for at_s, _ in acts], [expected.at(each) for _, each in acts]
    found = []
    for each in outputs:
        first, last = bisect_right(begins, each.at_s) - 1, bisect_right(begins, each.at_s + width_s) - 1
        value = values[last]
        if value is not None and all(other == value for other in values[first:last]):
            found.append(Bucket(each.at_s, each.low - value, each.high - value, each.mean - value))
    return found
