"""Input levels from the acquisitions of a run: for each its data on ramps, and the points at rest around them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from bench.methods.channel.level_names import level_name
from bench.methods.channel.reduction.line import ChannelRecord
from bench.methods.channel.reduction.means import Means, joined, means_of
from bench.methods.channel.reduction.transfer_meter import Metered, believes_meter, metered
from bench.metrology.acquisition import Acquisition, Array, Counts
from bench.metrology.orientation import specific_force_g
from bench.metrology.outputs import mean_output, means_between, measured
from bench.metrology.pulse_counts import mean_rate, shifted_counts
from bench.metrology.run_data import RunData, UnitUnderTest

LEAST_LEVEL_G = 0.1  # of an axis of an inertial unit; below it, it is level, and its channel has no input level
SAME_CLOCK = 0.5  # of the time between two latches: tolerance of device time against arrival times and latch numbers


@dataclass(frozen=True, slots=True)
class InputLevel:
    """Input of a channel: gravity along its input axis, or a current; in g of a nominal unit.

    `current_a` is not-a-number for gravity. `set_g` is the set value of the source if its certificate corrects that:
    it names the level. `source_a` is the corrected current of the source, also if an ammeter is the standard; 0 for
    gravity.
    """

    kind: Literal["gravity", "source"]
    level_g: float
    current_a: float = float("nan")
    set_g: float | None = None
    source_a: float = 0.0

    @property
    def name(self) -> str:
        """Name of the level: up_1g, skew, src_12g."""
        return level_name(self.level_g if self.set_g is None else self.set_g, by_source=self.kind == "source")


@dataclass(frozen=True, slots=True)
class Point:
    """A mean output at rest; `problems` are those of `mean_output`. Temperatures are means, NaN without a reading.

    `single_u` is its standard uncertainty by itself, `quantisation_u` the quantisation uncertainty of codes.
    """

    step: str
    middle_s: float
    span_s: float
    rate: float
    converter_c: float
    problems: tuple[str, ...]
    single_u: float
    quantisation_u: float = 0.0


@dataclass(frozen=True, slots=True)
class LevelData:
    """One input level of one unit: its data on ramps, and the points at rest in run order.

    `steps` are the acquisitions on ramps. `metered` are the readings of an ammeter meanwhile, on the ramps if there are
    any; None for gravity, and without an ammeter.
    """

    level: InputLevel
    record: ChannelRecord | Means
    points: tuple[Point, ...]
    steps: tuple[str, ...]
    metered: Metered | None = None


def levels_of(data: RunData, unit: UnitUnderTest, settings: Mapping[str, Any]) -> dict[str, LevelData]:
    """Input levels of a unit by name, in run order.

    An acquisition in which the chamber's set point moves is a ramp, any other a point. If `settings` make the ammeter
    the standard, a level is the current that it measured, and its points are corrected to this current.
    """
    grouped: dict[str, list[tuple[InputLevel, Acquisition]]] = {}
    for acquisition in data.acquisitions:
        level = input_level(data, unit, acquisition)
        if level is not None:
            grouped.setdefault(level.name, []).append((level, acquisition))
    gate_s = settings["gate_s"]
    levels = {name: _level_data(unit, members, gate_s) for name, members in grouped.items()}
    if not believes_meter(unit, settings):
        return levels
    return {name: _as_metered(level, grouped[name], unit) for name, level in levels.items()}


def _as_metered(level: LevelData, members: list[tuple[InputLevel, Acquisition]], unit: UnitUnderTest) -> LevelData:
    """A level by its ammeter readings, if any; the output at its points is corrected to the current of the ramps."""
    if level.metered is None:
        return level
    fed_a = level.metered.mean_a
    by_step = {acquisition.step: metered([acquisition], unit).mean_a for _, acquisition in members}
    points = tuple(
        replace(point, rate=point.rate * fed_a / by_step[point.step]) if level.level.set_g else point
        for point in level.points
    )
    return replace(
        level, level=replace(level.level, level_g=fed_a / unit.scale_a_per_g, current_a=fed_a), points=points
    )


def input_level(data: RunData, unit: UnitUnderTest, acquisition: Acquisition) -> InputLevel | None:
    """Input of a unit's converter during an acquisition.

    None for a channel of an inertial unit while its axis is level, or while the source feeds another channel.
    """
    if acquisition.input == "source":
        if unit.sensor and acquisition.input_channel != unit.sensor:
            return None
        current_a = acquisition.sources_a.get(unit.source, 0.0)
        set_a = acquisition.sources_set_a.get(unit.source, current_a)
        return InputLevel("source", current_a / unit.scale_a_per_g, current_a, set_a / unit.scale_a_per_g, current_a)
    level_g = float(specific_force_g(acquisition, unit, data.bench)[unit.row])
    return None if unit.sensor and abs(level_g) < LEAST_LEVEL_G else InputLevel("gravity", level_g)


def _level_data(unit: UnitUnderTest, members: list[tuple[InputLevel, Acquisition]], gate_s: float) -> LevelData:
    ramps = [acquisition for _, acquisition in members if is_ramp(acquisition)]
    return LevelData(
        level=members[0][0],
        record=_record(ramps, unit, gate_s),
        points=tuple(_point(acquisition, unit) for _, acquisition in members if not is_ramp(acquisition)),
        steps=tuple(acquisition.step for acquisition in ramps),
        metered=_metered(unit, members),
    )


def _metered(unit: UnitUnderTest, members: list[tuple[InputLevel, Acquisition]]) -> Metered | None:
    if members[0][0].kind != "source" or not unit.ammeter:
        return None
    ramps = [acquisition for _, acquisition in members if is_ramp(acquisition)]
    return metered(ramps or [acquisition for _, acquisition in members], unit)


def is_ramp(acquisition: Acquisition) -> bool:
    """True if the chamber's set point moved during an acquisition."""
    return acquisition.set_c != acquisition.set_from_c and np.isfinite(acquisition.set_from_c)


def _record(ramps: Sequence[Acquisition], unit: UnitUnderTest, gate_s: float) -> ChannelRecord | Means:
    if unit.is_counted:
        return ChannelRecord.joined([read_out(acquisition, unit, gate_s) for acquisition in ramps])
    return joined([read_means(acquisition, unit, gate_s) for acquisition in ramps])


def read_means(acquisition: Acquisition, unit: UnitUnderTest, gate_s: float) -> Means:
    """Mean volts or codes over every `gate_s`, with the means of both temperatures."""
    found = measured(acquisition, unit)
    if isinstance(found, Counts):
        raise TypeError("counts are read out")
    edges_s = np.arange(acquisition.begin_s + gate_s / 2, acquisition.end_s - gate_s / 2, gate_s)
    converter_c, accelerometer_c = (
        _means_between(acquisition, reading, edges_s) for reading in (unit.converter, unit.temperature)
    )
    return means_of(found, edges_s, converter_c, accelerometer_c)


def read_out(acquisition: Acquisition, unit: UnitUnderTest, gate_s: float) -> ChannelRecord:
    """Counters and temperatures every `gate_s`, each temperature the mean over the gate around its read-out.

    The times are those of the device's clock, shifted to that of the host at the arrival of the first latch.
    """
    counts = acquisition.counts[unit.channel]
    due_s = np.arange(acquisition.begin_s + gate_s / 2, acquisition.end_s - gate_s / 2, gate_s)
    latches = np.searchsorted(counts.host_s, due_s)
    latches = np.unique(latches[latches < len(counts.host_s)])
    at_s, device_s = counts.host_s[latches], _device_s(counts)
    positive, negative = shifted_counts(counts, device_s)
    return ChannelRecord(
        time_s=device_s[latches],
        positive=positive[latches].astype(np.float64),
        negative=negative[latches].astype(np.float64),
        converter_c=_means_around(acquisition, unit.converter, at_s, gate_s),
        accelerometer_c=_means_around(acquisition, unit.temperature, at_s, gate_s),
    )


def _device_s(counts: Counts) -> Array:
    """Device time of every latch (n,); after a restart of the device, continued by the host's clock.

    At a restart the device time agrees neither with the latch numbers nor with the arrival times. Arrival times alone
    prove none: a serial adapter delivers several latches at once, every 16 ms.
    """
    if len(counts.host_s) < 2:
        return counts.host_s
    host_s, numbers = np.diff(counts.host_s), np.diff(counts.sequence)
    steps_s = np.diff(counts.tick) % (1 << counts.tick_bits) * counts.tick_period_s
    usual_s = float(np.median(steps_s))
    unlike_host = np.abs(steps_s - host_s) > SAME_CLOCK * np.maximum(host_s, usual_s)
    unlike_numbers = np.abs(steps_s - numbers * usual_s) > SAME_CLOCK * usual_s
    elapsed_s = np.cumsum(np.where(unlike_host & unlike_numbers, host_s, steps_s))
    return np.concatenate(([0.0], elapsed_s)) + float(counts.host_s[0])


def _means_around(acquisition: Acquisition, reading: str, at_s: Array, gate_s: float) -> Array:
    if len(at_s) < 2:
        return np.full(len(at_s), np.nan)
    edges_s = np.concatenate(([at_s[0] - gate_s / 2], (at_s[1:] + at_s[:-1]) / 2, [at_s[-1] + gate_s / 2]))
    return _means_between(acquisition, reading, edges_s)


def _means_between(acquisition: Acquisition, reading: str, edges_s: Array) -> Array:
    if reading not in acquisition.temperatures_c:
        return np.full(max(len(edges_s) - 1, 0), np.nan)
    return means_between(acquisition.temperatures_at_s[reading], acquisition.temperatures_c[reading], edges_s)


def _point(acquisition: Acquisition, unit: UnitUnderTest) -> Point:
    found, output = measured(acquisition, unit), mean_output(acquisition, unit)
    span_s = mean_rate(found).span_s if isinstance(found, Counts) else acquisition.end_s - acquisition.begin_s
    temperatures_c = acquisition.temperatures_c.get(unit.converter, np.zeros(0))
    return Point(
        step=acquisition.step,
        middle_s=(acquisition.begin_s + acquisition.end_s) / 2,
        span_s=span_s,
        rate=output.value,
        converter_c=float(np.nanmean(temperatures_c)) if np.isfinite(temperatures_c).any() else float("nan"),
        problems=output.problems,
        single_u=output.single_u,
        quantisation_u=output.quantisation_u,
    )
