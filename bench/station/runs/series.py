"""Series of a run for curves: readings and outputs of units, thinned to lowest, highest and mean of short intervals.

An oscillation faster than the intervals stays visible as a band between lowest and highest, and is never aliased.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from functools import lru_cache
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.errors import BenchError, InputError
from bench.metrology.acquisition import Counts, Positions
from bench.metrology.pulse_counts import steps_of
from bench.station.runs.deviation import DEVIATION, bench_of, course, deviation, expectations
from bench.store.blocks import unpack_all
from bench.store.decoder import Decoder, decoders_of
from bench.store.tail import Bucket, Tail, TailBlock

PULSE_RATE = "pulse/s"
MOST_BLOCKS = 600  # decoded for one answer
LEAST_WIDTH_S = 0.1
POINTS = 600
TURN_DEG = 360.0
FINE_S = 1.0  # intervals in which an output is compared with its expectation
Array = NDArray[np.float64]


class Thinned(NamedTuple):
    """Series of a channel: intervals of `width_s`, in order."""

    unit: str
    width_s: float
    buckets: list[Bucket]


def width_of(span_s: float, points: int) -> float:
    """Return the width of intervals for a number of points: 1, 2 or 5 times a power of ten."""
    least = max(span_s / points, LEAST_WIDTH_S)
    power = 10.0 ** math.floor(math.log10(least))
    return next(width for width in (power, 2 * power, 5 * power, 10 * power) if width >= least * 0.999)


def thinned(run: Path, channels: Iterable[str], since_s: float, width_s: float) -> dict[str, Thinned]:
    """Return the series of channels of a run from an instant, in bench time. Raises InputError and StoreError.

    Channels are those of readings, DEVICE.CHANNEL for the output of a unit, a pulse rate where it is counted, and
    DEVICE.CHANNEL.deviation for its deviation from the expectation.
    """
    with Tail(run) as tail:
        recorded, wanted = tail.channels(), list(channels)
        sent = {name.removesuffix(DEVIATION) for name in wanted} - (recorded.keys() - encoders_in(run))
        blocks = tail.blocks(since_s, MOST_BLOCKS) if sent else []
        outputs = _outputs(run, sent, blocks, math.floor(since_s / width_s) * width_s)

        def buckets(name: str, width_s: float) -> list[Bucket]:
            read = tail.envelope(name, since_s, width_s) if name in recorded else []
            return with_latched(read, buckets_of(*outputs[name], width_s)) if name in outputs else read

        units = {name: units_of(run)[name] for name in outputs if name not in recorded} | recorded
        found = {name: Thinned(units[name], width_s, buckets(name, width_s)) for name in wanted if name in units}
        acts, fine_s = None, min(width_s, FINE_S)
        for name in (each for each in wanted if each.endswith(DEVIATION)):
            base = name.removesuffix(DEVIATION)
            expected = expectations(run).get(base) if base in units else None
            if expected is not None:
                acts = acts or course(tail, expected.bench)
                away = deviation(acts, expected, buckets(base, fine_s), fine_s)
                found[name] = Thinned(expected.unit, width_s, joined(away, width_s))
    return found


def with_latched(read: list[Bucket], latched: list[Bucket]) -> list[Bucket]:
    """Return intervals of readings, wider where latched values have lower or higher ones; their means are then used.

    Polled readings of an axis that oscillates are too few to meet its ends. Latched angles are moved by whole turns to
    the readings; intervals in which an axis turns half a turn or more are left as they are read.
    """
    found = {each.at_s: each for each in read}
    moved_deg = 0.0
    for each in latched:
        beside = found.get(each.at_s)
        if read and each.high - each.low >= TURN_DEG / 2:
            continue
        if beside is not None:
            moved_deg = TURN_DEG * round((beside.mean - each.mean) / TURN_DEG)
        each = Bucket(each.at_s, each.low + moved_deg, each.high + moved_deg, each.mean + moved_deg)
        found[each.at_s] = (
            each
            if beside is None
            else Bucket(each.at_s, min(each.low, beside.low), max(each.high, beside.high), each.mean)
        )
    return [found[at_s] for at_s in sorted(found)]


def slope_and_range(run: Path, channel: str, over_s: float) -> tuple[float, float] | None:
    """Return slope per s and range of a reading over its newest `over_s`; None with too few readings."""
    with Tail(run) as tail:
        _, last_s = tail.span_s()
        buckets = tail.envelope(channel, max(0.0, last_s - over_s), 1.0)
    if len(buckets) < 3:
        return None
    at_s, mean = np.array([each.at_s for each in buckets]), np.array([each.mean for each in buckets])
    slope = float(np.polyfit(at_s - at_s[0], mean, 1)[0])
    return slope, max(each.high for each in buckets) - min(each.low for each in buckets)


def within_since_s(run: Path, channel: str, begun_s: float, most: float) -> float | None:
    """Return the bench time since when a reading has stayed within a range of `most`; None without readings."""
    with Tail(run) as tail:
        _, last_s = tail.span_s()
        buckets = tail.envelope(channel, begun_s, width_of(max(last_s - begun_s, 1.0), POINTS))
    since_s, low, high = None, math.inf, -math.inf
    for each in reversed(buckets):
        low, high = min(low, each.low), max(high, each.high)
        if high - low > most:
            break
        since_s = max(each.at_s, begun_s)
    return since_s


def _outputs(
    run: Path, channels: Collection[str], blocks: list[TailBlock], from_s: float
) -> dict[str, tuple[Array, Array]]:
    """Return instants and outputs of channels, or latched angles of axes, from an instant on."""
    if not channels:
        return {}
    collected: dict[str, list[tuple[Array, Array]]] = {}
    decoders = decoders_in(run)
    for (stream, _), group in groupby(blocks, key=lambda block: (block.stream, block.step)):
        if stream in decoders:
            for name, (at_s, values) in _outputs_in(stream, decoders[stream], list(group)):
                new = (at_s >= from_s) & np.isfinite(values)
                collected.setdefault(name, []).append((at_s[new], values[new]))
    return {name: _joined(parts) for name, parts in collected.items() if name in channels}


def _joined(parts: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    return np.concatenate([at_s for at_s, _ in parts]), np.concatenate([values for _, values in parts])


@lru_cache(maxsize=16)  # the copy of the bench file in a run does not change
def decoders_in(run: Path) -> Mapping[str, Decoder]:
    """Return the decoders of the devices of a run that send frames, by role. Raises InputError."""
    try:
        return decoders_of(bench_of(run).devices, run)
    except BenchError as problem:
        raise InputError(f"the frames of this run cannot be decoded ({problem})") from None


@lru_cache(maxsize=16)
def units_of(run: Path) -> Mapping[str, str]:
    """Return the units of the outputs that devices of a run send, by DEVICE.CHANNEL. Raises InputError."""
    return bench_of(run).output_units


@lru_cache(maxsize=16)
def encoders_in(run: Path) -> frozenset[str]:
    """Return the readings of axes of a run whose encoders are latched, as DEVICE.angle. Raises InputError."""
    return frozenset(angle_of(axis) for entry in bench_of(run).devices.values() for axis in entry.encoders)


def angle_of(axis: str) -> str:
    """Return the name of the reading of the angle of an axis."""
    return f"{axis}.angle"


def _outputs_in(stream: str, decoder: Decoder, blocks: list[TailBlock]) -> Iterator[tuple[str, tuple[Array, Array]]]:
    """Yield instants and values of consecutive blocks: pulse rates between latches, samples, and angles."""
    block = unpack_all([each.packed for each in blocks])
    for channel, output in decoder.outputs(block).items():
        if not isinstance(output, Counts):
            yield f"{stream}.{channel}", (output.host_s, output.values)
        elif len(output.tick) > 1:
            yield f"{stream}.{channel}", (output.host_s[1:], rates_of(output))
    for axis, position in decoder.positions(block).items():
        yield angle_of(axis), (position.host_s, angles_deg(position))


def angles_deg(found: Positions) -> Array:
    """Return the latched angles of an axis, (N,), the first of them within half a range of the encoder from 0."""
    half = 1 << (found.position_bits - 1)
    moved = np.mod(np.diff(found.position) + half, 2 * half) - half if len(found.position) else np.empty(0)
    first = np.mod(found.position[:1] + half, 2 * half) - half  # a small negative angle is no large one
    return np.concatenate([first, first + np.cumsum(moved)]) * found.resolution_deg


def rates_of(counts: Counts) -> Array:
    """Return the net pulse rate between consecutive latches, (N - 1,) in pulse/s."""
    pulses = steps_of(counts.positive, counts.counter_bits) - steps_of(counts.negative, counts.counter_bits)
    took_s = steps_of(counts.tick, counts.tick_bits) * counts.tick_period_s
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(pulses / took_s, np.float64)


def buckets_of(at_s: Array, values: Array, width_s: float) -> list[Bucket]:
    """Return lowest, highest and mean of values in order of time, in intervals that begin at multiples of a width."""
    numbers = np.floor(at_s / width_s).astype(np.int64)
    starts = np.flatnonzero(np.diff(numbers, prepend=numbers[:1] - 1))
    if not len(starts):
        return []
    low, high = np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)
    mean = np.add.reduceat(values, starts) / np.diff(starts, append=len(values))
    columns = (numbers[starts] * width_s, low, high, mean)
    return [Bucket(*row) for row in zip(*(column.tolist() for column in columns), strict=True)]


def joined(buckets: Iterable[Bucket], width_s: float) -> list[Bucket]:
    """Return intervals joined to wider ones; the mean is that of their means."""
    found = []
    for number, group in groupby(buckets, key=lambda each: math.floor(each.at_s / width_s + 1e-9)):
        parts = list(group)
        mean = math.fsum(each.mean for each in parts) / len(parts)
        low, high = min(each.low for each in parts), max(each.high for each in parts)
        found.append(Bucket(number * width_s, low, high, mean))
    return found
