"""Counters of 8 to 64 bits, most of which no frame of classical CAN holds in pairs, given to what unwraps them."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from itertools import pairwise

import numpy as np

from bench.metrology.acquisition import Counts
from bench.metrology.pulse_counts import mean_rate
from campaigns.can_faults.campaign import EXACT, Tally

TICK_BITS, PERIOD_TICKS = 32, 10_000


def play_wide(cases: Iterable[int], seed: int) -> Tally:
    """An acquisition of each: at any rate from any start with any gaps, every other one with a reset in it."""
    tally = Tally()
    for number in cases:
        draws = np.random.default_rng([seed, number])
        outcome, problem = _one(draws, with_reset=bool(number % 2))
        tally.outcomes[outcome] += 1
        tally.cases += 1
        if problem:
            tally.unexpected.append(f"{problem} (wide counter, seed {seed}, number {number})")
    return tally


def _one(draws: np.random.Generator, *, with_reset: bool) -> tuple[str, str]:
    bits, latches = int(draws.integers(8, 65)), int(draws.integers(10, 60))
    period_s = PERIOD_TICKS * 1e-6
    pulses = min(2.0**bits, 1e9) * draws.uniform(0.001, 0.999)  # in a period at the most
    each = max(int(pulses * draws.uniform(0.02, 1.0)), 1)
    start = int(draws.integers(0, 1 << 62)) << 2 | int(draws.integers(4))
    reset = int(draws.integers(1, latches)) if with_reset else latches
    kept = np.flatnonzero(draws.random(latches) > draws.choice([0.0, 0.1, 0.6]))
    counted = [start + each * latch if latch < reset else each * (latch - reset) for latch in kept.tolist()]
    found = mean_rate(_counts(kept, counted, bits, pulses / period_s, latches))
    steps = [(after - before) % (1 << bits) for before, after in pairwise(counted)]
    waits = np.diff(kept).tolist()
    reasons = len(kept) < 2 or 2 * len(kept) < kept[-1] - kept[0] + 1
    reasons = reasons or max(waits) * pulses >= (1 << bits) * (1 - 1e-9)
    reasons = reasons or any(step > 1.05 * pulses * wait + 1 for step, wait in zip(steps, waits, strict=True))
    if found.problems:
        return "told", "" if reasons else f"{', '.join(found.problems)} was told of {bits} bits without a reason"
    if reasons:
        return "wrong", f"nothing was told of {bits} bits"
    if with_reset and kept[0] < reset <= kept[-1]:
        return "unseeable", ""  # each of its steps could have been counted
    true_pps = Fraction(each) / Fraction(PERIOD_TICKS, 1_000_000)
    exact = abs(found.net_pps / float(true_pps) - 1) <= EXACT
    return "true", "" if exact else f"{found.net_pps} Hz of {bits} bits, {float(true_pps)} Hz is true"


def _counts(kept: np.ndarray, counted: list[int], bits: int, max_rate_pps: float, latches: int) -> Counts:
    wrapped = np.array([count % (1 << bits) for count in counted], np.uint64).view(np.int64)
    ticks = (kept.astype(np.int64) * PERIOD_TICKS + (1 << TICK_BITS) - 50_000) % (1 << TICK_BITS)
    return Counts(
        kept.astype(np.int64), ticks, wrapped, np.zeros(len(kept), np.int64), kept * 0.01, TICK_BITS, bits, 1e-6,
        max_rate_pps, int(kept[-1] - kept[0]) + 1 - len(kept) if len(kept) else 0, 0,
    )  # fmt: skip
