"""Samples of an acquisition on a rate table: what the pulses of a unit and the table's encoder say at the same latches.

Pulses and encoder are latched together, so that both have one clock: the counter's. A sample is the mean over the
interval before its time, and what both did in that interval is known without a model of either.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from bench.analysis.acquired import Acquisition, Array, Integers, Motion, Positions
from bench.analysis.counts import RESOLUTION_COUNTS, mean_rate
from bench.analysis.fit import LinearFit, NotDetermined, least_squares
from bench.analysis.rundata import UnitUnderTest
from bench.analysis.steady_turning import Steady
from bench.analysis.table_blocks import Block

LEAST_LATCHES = 20
PARTS = 40  # of a block, whose rates tell how certain that of the block is
HARMONICS = 4  # of the angle, that parts of a turn differ by
PARTS_DOF = PARTS - 3 - 2 * HARMONICS
BETWEEN_PARTS = 1.5  # variance of a rate over a part, over that of a rate between the means of two
SATURATED = 0.01  # of the samples
AT_CLIP = (1 - 2e-3, 1 + 1e-2)  # of the clip level, which is not known well; beyond is a glitch
TURN_DEG = 360.0


@dataclass(frozen=True, slots=True)
class TableSamples:
    """Latches of one acquisition, (n,) by time since the first, and what is cumulative at each.

    `temperature_c` is the mean of the thermometer at the unit, not-a-number where it said nothing. `pulses` are net,
    `angle_deg` is that of the encoder over whole turns; `interval_s` is the time between two latches, `problems` make
    the acquisition unusable. `at_turns` is how much farther off they are where they
    turn round than those of a counter without play.
    """

    step: str
    motion: Motion | None
    temperature_c: float
    time_s: Array
    pulses: Array
    angle_deg: Array
    latch: Integers
    interval_s: float
    resolution_deg: float
    problems: tuple[str, ...]
    at_turns: float = 1.0

    def block(self, per_pulse: float) -> Block:
        """Sample by sample: time, the encoder's angle then, and the mean output before; a pulse is so much of it.

        What follows a lost latch is left out, since it is a mean over another interval.
        """
        whole = np.diff(self.latch) == 1
        output = np.diff(self.pulses) / np.diff(self.time_s) * per_pulse
        return Block(self.time_s[1:][whole], self.angle_deg[1:][whole], output[whole], int(np.ptp(self.latch)))

    def summed(self, per_pulse: float) -> Block:
        """Latch by latch: time, angle, and what the output has summed up to; a lost latch is no loss."""
        scheduled = int(np.ptp(self.latch)) + 1
        return Block(self.time_s, self.angle_deg, self.pulses * per_pulse, scheduled, per_pulse, self.at_turns)


def table_samples(acquisition: Acquisition, unit: UnitUnderTest) -> TableSamples:
    """The samples of a unit in one acquisition.

    Problems are those of `mean_rate` but a dead band, which a swing goes through, and no_encoder.
    """
    counts, motion = acquisition.counts[unit.channel], acquisition.motion
    warm_c = acquisition.temperatures_c[unit.temperature]
    encoder = acquisition.positions.get(motion.device if motion else next(iter(acquisition.positions), ""))
    problems = [problem for problem in mean_rate(counts).problems if problem != "dead_band"]
    if encoder is None:
        nothing = np.empty(0, np.int64)
        encoder = Positions(nothing, nothing, nothing, 32, 32, counts.tick_period_s, 0.0)
        problems.append("no_encoder")
    latch, of_counts, of_encoder = np.intersect1d(
        counts.sequence, encoder.sequence, assume_unique=True, return_indices=True
    )
    if len(latch) < LEAST_LATCHES and "too_few_latches" not in problems:
        problems.append("too_few_latches")
    time_s = np.asarray(_since_first(counts.tick[of_counts], counts.tick_bits) * counts.tick_period_s, np.float64)
    positive = _since_first(counts.positive[of_counts], counts.counter_bits)
    negative = _since_first(counts.negative[of_counts], counts.counter_bits)
    turned = _since_first(encoder.position[of_encoder], encoder.position_bits, either_way=True)
    return TableSamples(
        step=acquisition.step,
        motion=motion,
        temperature_c=float(np.mean(warm_c)) if len(warm_c) else np.nan,
        time_s=time_s,
        pulses=np.asarray(positive - negative, np.float64),
        angle_deg=np.asarray(turned * encoder.resolution_deg, np.float64),
        latch=latch,
        interval_s=float(np.median(np.diff(time_s) / np.diff(latch))) if len(latch) > 1 else np.nan,
        resolution_deg=encoder.resolution_deg,
        problems=tuple(problems),
    )


def _since_first(cumulative: Integers, bits: int, *, either_way: bool = False) -> Integers:
    """What a counter that wraps has gone since the first row; one that goes either way goes the shorter."""
    steps = np.diff(cumulative) % (1 << bits)
    if either_way:
        half = 1 << (bits - 1)
        steps = (steps + half) % (1 << bits) - half
    return np.concatenate(([0], np.cumsum(steps)))[: len(cumulative)]


def steady(samples: TableSamples, per_pulse: float, clip: float | None = None) -> Steady:
    """Mean output and table rate over whole turns, or over all of it where there is none (methods.md 1.7).

    Both are between the same two latches, so that an unevenness of the table is the same in both.
    """
    last = _whole_turns(samples.angle_deg)
    span_s = float(samples.time_s[last])
    output = samples.block(per_pulse).output
    return Steady(
        output=float(samples.pulses[last]) / span_s * per_pulse,
        u_output=_u_mean_pps(samples, last) * abs(per_pulse),
        rate_dps=float(samples.angle_deg[last]) / span_s,
        u_rate_dps=RESOLUTION_COUNTS * samples.resolution_deg / span_s,
        saturated=clip is not None and _share_at(clip, output) > SATURATED,
    )


def _u_mean_pps(samples: TableSamples, last: int) -> float:
    """Of the mean up to a latch: the steps of counting at both ends, and what its parts scatter by.

    What the parts owe to the table, which turns a little unevenly and takes the sensor through gravity, is no scatter.
    """
    edges = np.linspace(0, last, PARTS + 1).astype(np.int64)
    fit = _fitted(_between_parts(samples.pulses, samples, edges), _owed_to_the_table(samples, edges))
    scatter_pps = fit.residual_sd * np.sqrt(BETWEEN_PARTS / PARTS)
    return float(np.hypot(scatter_pps, RESOLUTION_COUNTS / samples.time_s[last]))


def _between_parts(cumulative: Array, samples: TableSamples, edges: Integers) -> Array:
    """The rate of something cumulative (n,) from the mean over each part to that over the next.

    The steps of counting average out in the means. Of white noise such a rate has 2/3 of the variance that the rate
    over a part has.
    """
    centre_s, centre = (
        np.add.reduceat(values[: edges[-1]], edges[:-1]) / np.diff(edges) for values in (samples.time_s, cumulative)
    )
    return np.asarray(np.diff(centre) / np.diff(centre_s))


def _owed_to_the_table(samples: TableSamples, edges: Integers) -> Iterator[list[Array]]:
    """Of the same parts: the table's rate, and harmonics of the angle, from many to none."""
    angle = np.radians(samples.angle_deg)
    table_dps = _between_parts(samples.angle_deg, samples, edges)
    waves = [
        _between_parts(np.cumsum(wave(order * angle)), samples, edges)
        for order in range(1, HARMONICS + 1)
        for wave in (np.cos, np.sin)
    ]
    for order in range(HARMONICS, -1, -1):
        yield [np.ones_like(table_dps), table_dps - np.mean(table_dps), *waves[: 2 * order]]
    yield [np.ones_like(table_dps)]


def _fitted(values: Array, designs: Iterable[list[Array]]) -> LinearFit:
    """The fit of the first design whose coefficients the values (n,) determine."""
    for columns in designs:
        with suppress(NotDetermined):
            return least_squares(np.column_stack(columns), values)
    raise ValueError("a mean is always determined")


def harmonics_u_dps(samples: TableSamples, harmonics_u_deg: tuple[float, ...]) -> float:
    """What the errors of the encoder over a turn do to the rate of `steady`: nothing over whole turns, all but that.

    Harmonic n differs between angles θ apart by up to 2 sin(nθ/2) of its amplitude.
    """
    last = _whole_turns(samples.angle_deg)
    turned = np.radians(samples.angle_deg[last])
    parts = [2 * np.sin(order * turned / 2) * u for order, u in enumerate(harmonics_u_deg, start=1)]
    return float(np.linalg.norm(parts) / samples.time_s[last])


def _whole_turns(angle_deg: Array) -> int:
    """The latch nearest to the most whole turns after the first; the last where there is no whole turn."""
    turned = np.abs(angle_deg - angle_deg[0])
    turns = np.floor(turned[-1] / TURN_DEG)
    return int(np.argmin(np.abs(turned - turns * TURN_DEG))) if turns else len(angle_deg) - 1


def _share_at(clip: float, output: Array) -> float:
    low, high = AT_CLIP
    return float(np.mean((np.abs(output) >= low * clip) & (np.abs(output) <= high * clip)))


def mean_c(temperatures_c: Sequence[float]) -> float | None:
    """The mean of those that are known; None without one."""
    known = [each for each in temperatures_c if np.isfinite(each)]
    return float(np.mean(known)) if known else None
