"""Mean pulse rate from cumulative counts (equations 1.7).

A mean comes from the first and the last cumulative reading and the device's own clock at both; the readings in between
only decide on its validity.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from bench.metrology.acquisition import UNCHANGED, Array, Counts, Integers

RESOLUTION_COUNTS = 0.408  # 1/sqrt(6): standard deviation of a count between two unsynchronised edges
LEAST_SHARE = 0.5  # share of latches that must have arrived
RATE_MARGIN = 1.05
CLOCK_SLACK = 0.5  # deviation relative to the usual time between two latches
STANDSTILL_PERIODS = 5.0  # mean pulse periods without a pulse: dead band of the converter


class Rate(NamedTuple):
    """A mean net rate in pulse/s over `span_s` of device time; `problems` make it unusable."""

    net_pps: float
    span_s: float
    problems: tuple[str, ...]


class _Clock(NamedTuple):
    """Times between the latches by the device's own clock, and their agreement with the latch numbers."""

    tick: Integers
    sequence: Integers
    steps: Integers  # in ticks
    seconds: Array
    span_s: float
    shortest_s: float
    longest_s: float
    irregular: bool


def mean_rate(counts: Counts) -> Rate:
    """Net rate between the first and the last latch; NaN with fewer than two.

    Problems: too_few_latches, counter_restarted, irregular_clock (device time and latch numbers disagree, as after a
    restart without a boot counter), ambiguous_gap (a counter may have wrapped unnoticed), impossible_rate (more pulses
    than the converter can give, as after a reset), dead_band (no pulse for five times the mean period).
    """
    if len(counts.tick) < 2:
        return Rate(float("nan"), 0.0, ("too_few_latches",))
    return _rate(counts, _clock_of(counts))


def _clock_of(counts: Counts) -> _Clock:
    """Clock of at least two latches."""
    steps = steps_of(counts.tick, counts.tick_bits)
    seconds: Array = np.asarray(steps * counts.tick_period_s, np.float64)
    numbers = counts.sequence[1:] - counts.sequence[:-1]
    return _Clock(
        counts.tick, counts.sequence, steps, seconds, float(seconds.sum()), float(seconds.min()), float(seconds.max()),
        is_irregular(seconds if (numbers == 1).all() else seconds / numbers),
    )  # fmt: skip


class _Pulses(NamedTuple):
    """Pulses between the latches, (N - 1,), their sum, and the most of them, as by `_most`."""

    steps: Integers
    total: int
    most: int


def _pulses_of(cumulative: Integers, bits: int) -> _Pulses:
    """Pulses of a counter that may wrap; of one that did not, the sum is the difference of its ends."""
    steps, total = cumulative[1:] - cumulative[:-1], int(cumulative[-1]) - int(cumulative[0])
    most = _most(steps)
    if most >> min(bits, 63):
        steps = steps_of(cumulative, bits)
        total, most = int(steps.sum()), _most(steps)
    return _Pulses(steps, total, most)


def _most(steps: Integers) -> int:
    """Largest step; a negative one, as an unsigned number, is very large."""
    return int(steps.view(np.uint64).max())


def _rate(counts: Counts, clock: _Clock) -> Rate:
    positive = _pulses_of(counts.positive, counts.counter_bits)
    negative = _pulses_of(counts.negative, counts.counter_bits)
    problems = []
    if len(counts.tick) < LEAST_SHARE * (len(counts.tick) + counts.lost):
        problems.append("too_few_latches")
    if counts.restarts:
        problems.append("counter_restarted")
    if clock.irregular:
        problems.append("irregular_clock")
    if clock.longest_s * counts.max_rate_pps >= 1 << counts.counter_bits:
        problems.append("ambiguous_gap")
    if not all(_possible(pulses, RATE_MARGIN * counts.max_rate_pps, clock) for pulses in (positive, negative)):
        problems.append("impossible_rate")
    net = positive.total - negative.total
    net_pps = counts.shift.of(net / clock.span_s) if clock.span_s else float("nan")
    if _stands_still(counts, clock, (positive, negative), abs(net_pps)):
        problems.append("dead_band")
    return Rate(net_pps, clock.span_s, tuple(problems))


def mean_rates(channels: Mapping[str, Counts]) -> dict[str, Rate]:
    """Net rate of each channel, as by `mean_rate`.

    Channels of one counter have one clock, which is checked once if none has lost a latch.
    """
    rates: dict[str, Rate] = {}
    clock: _Clock | None = None
    for channel, counts in channels.items():
        if len(counts.tick) < 2:
            rates[channel] = mean_rate(counts)
            continue
        if clock is None or counts.tick is not clock.tick or counts.sequence is not clock.sequence:
            clock = _clock_of(counts)
        rates[channel] = _rate(counts, clock)
    return rates


def steps_of(cumulative: Integers, bits: int) -> Integers:
    """Differences of a counter that wraps."""
    steps = cumulative[1:] - cumulative[:-1]
    if bits < 64:  # these types wrap by themselves; a difference of half the range or more is negative
        steps &= (1 << bits) - 1
    return steps


def since_first(cumulative: Integers, bits: int, *, either_way: bool = False) -> Integers:
    """Change of a counter that wraps since the first row; in either direction, by the shorter way."""
    steps = steps_of(cumulative, bits)
    if either_way:
        half = 1 << (bits - 1)
        steps = (steps + half) % (1 << bits) - half
    return np.concatenate(([0], np.cumsum(steps)))[: len(cumulative)]


def shifted_counts(counts: Counts, time_s: Array) -> tuple[Integers, Integers]:
    """Positive and negative counts with the shift of the channel applied, in whole pulses that wrap.

    `time_s` (n,) are the times of the latches. The shift is added to the pulses of the sign of the shifted net rate, so
    that no counter decreases.
    """
    if counts.shift == UNCHANGED or len(time_s) < 2:
        return counts.positive, counts.negative
    steps = steps_of(counts.positive, counts.counter_bits) - steps_of(counts.negative, counts.counter_bits)
    added = counts.shift.more * np.diff(time_s) + (counts.shift.times - 1) * steps
    is_positive = steps + added >= 0
    shares = np.where(is_positive, added, 0.0), np.where(is_positive, 0.0, -added)
    more, less = (np.concatenate(([0], np.round(np.cumsum(share)).astype(np.int64))) for share in shares)
    size = 1 << counts.counter_bits
    return (counts.positive + more) % size, (counts.negative + less) % size


def is_irregular(latch_s: Array) -> bool:
    """True if some times between latches are far from the usual, or none passes."""
    if latch_s.max() - latch_s.min() < CLOCK_SLACK * latch_s.min():  # quick check that none can be irregular
        return False
    usual_s = np.median(latch_s)
    return bool((np.abs(latch_s - usual_s) >= CLOCK_SLACK * usual_s).any())


def _possible(pulses: _Pulses, most_pps: float, clock: _Clock) -> bool:
    """True if a converter can have given so many pulses between the latches, none of them negative."""
    if pulses.most <= most_pps * clock.shortest_s + 1:  # the usual case, quickly checked
        return True
    return not (pulses.steps.view(np.uint64) > most_pps * clock.seconds + 1).any()


def _fires_often(counts: Counts, latches: float) -> bool:
    """True if every row of so many latches contains pulses, quickly checked by the counters at the ends of halves."""
    part = int(min(latches, len(counts.tick) - 1) // 2)
    if part < 1:
        return False
    positive, negative = (steps_of(each[::part], counts.counter_bits) for each in (counts.positive, counts.negative))
    return bool((positive | negative).all())


def _stands_still(counts: Counts, clock: _Clock, both: tuple[_Pulses, _Pulses], rate_pps: float) -> bool:
    """True if no pulse arrived for much longer than the mean rate suggests, and for at least three latches."""
    moves = rate_pps != 0 and clock.longest_s > 0
    if _fires_often(counts, STANDSTILL_PERIODS / rate_pps / clock.longest_s if moves else 0.0):
        return False
    pulses = both[0].steps + both[1].steps
    if pulses.all():
        return False
    fired = np.concatenate(([-1], np.flatnonzero(pulses != 0), [len(pulses)]))
    begins, ends = fired[:-1] + 1, fired[1:]  # of the intervals without a pulse, most of which are empty
    at = np.concatenate(([0], np.cumsum(clock.steps)))  # in ticks: sums of integers are much faster
    silent = at[ends] - at[begins]
    longest = int(np.argmax(silent))
    if ends[longest] - begins[longest] < 3:
        return False
    return rate_pps == 0 or float(silent[longest] * counts.tick_period_s) > STANDSTILL_PERIODS / rate_pps
