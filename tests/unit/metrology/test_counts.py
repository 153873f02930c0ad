import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.metrology.acquisition import Counts, Turned
from bench.metrology.outputs import windows_of
from bench.metrology.pulse_counts import RESOLUTION_COUNTS, mean_rate

MAX_PPS = 256_000.0
PERIOD_S = 0.1
TURNED = Turned("outer", 60.0, 0.0, 0.0, 60.0, 3600.0)


def counted(
    rate_pps: float, latches: int = 101, *, phase: float = 0.0, keep: np.ndarray | None = None, **changes: Any
) -> Counts:
    """A steady rate at latches of 0.1 s, as 24-bit counters and a 32-bit clock of 1 µs give it; `keep` are those
    latches that came."""
    number = np.arange(latches)
    pulses = np.floor(phase + np.abs(rate_pps) * PERIOD_S * number).astype(np.int64)
    still = np.zeros_like(pulses)
    kept = np.ones(latches, dtype=bool) if keep is None else keep
    values: dict[str, Any] = {
        "sequence": number[kept],
        "tick": (4_294_000_000 + 100_000 * number[kept]) % 2**32,
        "positive": (16_770_000 + (pulses if rate_pps > 0 else still)[kept]) % 2**24,
        "negative": (7 + (pulses if rate_pps < 0 else still)[kept]) % 2**24,
        "host_s": 0.1 * number[kept],
        "tick_bits": 32,
        "counter_bits": 24,
        "tick_period_s": 1e-6,
        "max_rate_pps": MAX_PPS,
        "lost": int(np.count_nonzero(~kept)),
        "restarts": 0,
    }
    return Counts(**(values | changes))


def problems(counts: Counts) -> tuple[str, ...]:
    return mean_rate(counts).problems


# A mean


def test_a_mean_is_from_the_first_to_the_last_latch_across_every_wrap() -> None:
    counts = counted(11_300.0)
    assert counts.tick.min() < counts.tick[0], "the clock goes round"
    assert counts.positive.min() < counts.positive[0], "and so does the counter"
    rate = mean_rate(counts)
    assert rate.span_s == pytest.approx(10.0)
    assert rate.net_pps == pytest.approx(11_300.0)
    assert rate.problems == ()


@pytest.mark.parametrize("portion_s", [0.016, 0.25])
def test_a_span_by_the_clock_of_the_host_does_not_depend_on_its_last_arrival(
    portion_s: float,
) -> None:
    """An adapter hands over what it has every 16 ms, a busy server now and then; the counter is 50 ppm fast."""
    number = np.arange(6000)
    latched_s = 0.01 * number * (1 - 50e-6)
    handed_over_s = np.ceil((latched_s + 0.005) / portion_s) * portion_s
    found = counted(
        11_300.0, 6000, tick=(4_294_000_000 + 10_000 * number) % 2**32, host_s=3600.0 + handed_over_s,
        positive=(16_770_000 + 113 * number) % 2**24,
    )  # fmt: skip
    window = windows_of({"x": found}, TURNED)["x"]
    assert window.span_s == pytest.approx(59.99)
    assert window.host_span_s / window.span_s - 1 == pytest.approx(-50e-6, abs=25e-6 * portion_s / 0.016)


@pytest.mark.parametrize("latches", [2, 3, 5, 31, 40, 302, 6001])
def test_clocks_of_any_number_of_latches_are_compared_exactly(latches: int) -> None:
    host_s = 3600.0 + PERIOD_S * np.arange(latches) * (1 + 80e-6)
    window = windows_of({"x": counted(11_300.0, latches, host_s=host_s)}, TURNED)["x"]
    assert window.host_span_s / window.span_s - 1 == pytest.approx(80e-6, abs=1e-9)


def test_nor_on_latches_that_waited_while_the_computer_was_busy() -> None:
    number = np.arange(600)
    handed_over_s = np.where(number > 570, 60.0, 0.1 * number)  # the last 3 s at once
    window = windows_of({"x": counted(11_300.0, 600, host_s=handed_over_s)}, TURNED)["x"]
    assert window.host_span_s == pytest.approx(window.span_s, rel=1e-9)


@pytest.mark.parametrize("still", [slice(None), slice(0, 95), slice(5, 101), slice(50, 60)])
def test_a_clock_that_stands_still_is_told_and_compared_with_none(still: slice) -> None:
    tick = 100_000 * np.arange(101)
    tick[still] = tick[still][0]
    window = windows_of({"x": counted(1000.0, tick=tick)}, TURNED)["x"]
    assert window.problems
    assert not math.isinf(window.host_span_s)


def test_negative_pulses_count_against_positive_ones() -> None:
    assert mean_rate(counted(-11_300.0)).net_pps == pytest.approx(-11_300.0)
    both = dataclasses.replace(counted(500.0), negative=counted(-200.0).negative)
    assert mean_rate(both).net_pps == pytest.approx(300.0)


def test_the_clock_is_the_devices_own() -> None:
    slow = dataclasses.replace(counted(11_300.0), tick_period_s=1.001e-6)
    assert mean_rate(slow).net_pps == pytest.approx(11_300.0 / 1.001)


@given(
    rate_pps=st.floats(-MAX_PPS, MAX_PPS),
    starts=st.tuples(st.integers(0, 2**32 - 1), st.integers(0, 2**24 - 1), st.integers(0, 2**24 - 1)),
    bits=st.sampled_from([16, 20, 24, 32]),
    phase=st.floats(0, 0.999),
)
def test_wherever_counters_start_and_however_wide_they_are(
    rate_pps: float, starts: tuple[int, int, int], bits: int, phase: float
) -> None:
    """16 bits at 256 kHz and 0.1 s are unambiguous too."""
    plain = counted(rate_pps, phase=phase)
    tick0, positive0, negative0 = starts
    counts = dataclasses.replace(
        plain,
        tick=(plain.tick + tick0) % 2**32,
        positive=((plain.positive - plain.positive[0]) % 2**24 + positive0) % 2**bits,
        negative=((plain.negative - plain.negative[0]) % 2**24 + negative0) % 2**bits,
        counter_bits=bits,
    )
    rate = mean_rate(counts)
    assert abs(rate.net_pps - rate_pps) <= 1 / 10.0 + 1e-9
    assert set(rate.problems) <= {"dead_band"}
    assert not rate.problems or abs(rate_pps) < 10


# How well it is known (equations 1.7)


def test_the_error_is_below_a_count_and_its_standard_deviation_is_0_408_counts() -> None:
    draws = np.random.default_rng(3)
    count, gate_s = 20_000, 10.0
    rates, phases = draws.uniform(1000, 20_000, count), draws.uniform(0, 1, count)
    errors = np.array([
        mean_rate(counted(rate, phase=phase)).net_pps - rate for rate, phase in zip(rates[:2000], phases, strict=False)
    ])  # fmt: skip
    assert np.abs(errors).max() <= 1 / gate_s
    assert errors.std() * gate_s == pytest.approx(0.408, rel=0.05)
    ends = np.floor(phases + rates * gate_s) - np.floor(phases)  # the same by arithmetic alone, over many more phases
    assert np.std(ends - rates * gate_s) == pytest.approx(RESOLUTION_COUNTS, rel=0.01)
    assert pytest.approx(1 / math.sqrt(6), rel=1e-3) == RESOLUTION_COUNTS


def test_many_latches_do_not_add_their_errors() -> None:
    """The mean of M intervals has the error of one, not that of M."""
    assert abs(mean_rate(counted(3333.3, latches=10_001)).net_pps - 3333.3) <= 1 / 1000


# Gaps


def test_latches_that_did_not_come_cost_nothing() -> None:
    keep = np.ones(101, dtype=bool)
    keep[[1, 2, 3, 40, 41, 80]] = False
    rate = mean_rate(counted(11_300.0, keep=keep))
    assert (rate.net_pps, rate.problems) == (pytest.approx(11_300.0), ())


def test_fewer_than_half_of_the_latches_are_too_few() -> None:
    keep = np.zeros(101, dtype=bool)
    keep[::2] = True
    assert problems(counted(11_300.0, keep=keep)) == ()
    keep[50] = False
    assert problems(counted(11_300.0, keep=keep)) == ("too_few_latches",)


@pytest.mark.parametrize("latches", [0, 1])
def test_one_latch_is_no_rate(latches: int) -> None:
    rate = mean_rate(counted(11_300.0, latches=latches))
    assert math.isnan(rate.net_pps)
    assert (rate.span_s, rate.problems) == (0.0, ("too_few_latches",))


def test_two_latches_are_a_rate() -> None:
    assert mean_rate(counted(11_300.0, latches=2)).net_pps == pytest.approx(11_300.0)


@pytest.mark.parametrize(("gap_latches", "ambiguous"), [(655, False), (656, True)])
def test_a_gap_in_which_a_counter_may_have_gone_round_is_not_used(gap_latches: int, ambiguous: bool) -> None:
    """2**24 pulses at 256 kHz take 65.536 s."""
    keep = np.ones(3001, dtype=bool)
    keep[1000 : 1000 + gap_latches - 1] = False
    found = problems(counted(11_300.0, latches=3001, keep=keep))
    assert ("ambiguous_gap" in found) == ambiguous


# Counters that are not to be trusted


def test_a_restart_that_was_told_is_a_problem() -> None:
    assert problems(counted(11_300.0, restarts=1)) == ("counter_restarted",)


def test_a_restart_that_nobody_told_is_seen_by_the_clock() -> None:
    first, second = counted(11_300.0, latches=50), counted(11_300.0, latches=51)
    tick = np.concatenate([first.tick, 100_000 * np.arange(1, 52)])
    positive = np.concatenate([first.positive, second.positive - second.positive[0]]) % 2**24
    sequence = np.arange(101)
    found = problems(counted(11_300.0, tick=tick, positive=positive, sequence=sequence))
    assert "irregular_clock" in found


def test_counts_that_fall_to_zero_while_the_clock_goes_on_are_impossible() -> None:
    counts = counted(11_300.0)
    positive = np.concatenate([counts.positive[:50], counts.positive[50:] - counts.positive[50]]) % 2**24
    assert "impossible_rate" in problems(dataclasses.replace(counts, positive=positive))


def test_more_pulses_than_the_converter_can_give_are_impossible() -> None:
    assert problems(counted(1.04 * MAX_PPS)) == ()
    assert problems(counted(1.06 * MAX_PPS)) == ("impossible_rate",)
    jump = counted(11_300.0)
    jump.negative[50:] += 100_000
    assert "impossible_rate" in problems(jump)


def test_a_single_pulse_is_never_too_many() -> None:
    """Ten latches for each pulse of a converter of 1 Hz."""
    assert "impossible_rate" not in problems(counted(0.99, max_rate_pps=1.0))


def test_a_clock_that_stands_is_not_divided_by() -> None:
    rate = mean_rate(counted(11_300.0, tick=np.full(101, 7)))
    assert math.isnan(rate.net_pps)
    assert "irregular_clock" in rate.problems
    assert "impossible_rate" in rate.problems


def test_a_clock_that_jumps_is_a_problem_and_one_that_trembles_is_not() -> None:
    counts = counted(11_300.0)
    trembling = counts.tick + np.random.default_rng(1).integers(-10_000, 10_000, 101)
    assert problems(dataclasses.replace(counts, tick=trembling % 2**32)) == ()
    jumped = counts.tick.copy()
    jumped[60:] += 100_000
    assert problems(dataclasses.replace(counts, tick=jumped % 2**32)) == ("irregular_clock",)


# The dead band


def silent_run(rate_pps: float, begin: int, end: int) -> Counts:
    """A steady rate of whole pulses, but for latches in which nothing fired."""
    steps = np.full(400, round(rate_pps * PERIOD_S))
    steps[begin:end] = 0
    return counted(1.0, latches=401, positive=np.concatenate([[0], steps.cumsum()]))


def test_no_pulse_at_all_is_the_dead_band() -> None:
    rate = mean_rate(counted(0.0))
    assert (rate.net_pps, rate.problems) == (0.0, ("dead_band",))


@pytest.mark.parametrize(("silent", "expected"), [(2, ()), (3, ("dead_band",)), (50, ("dead_band",))])
def test_pulses_that_stop_for_a_while_are_the_dead_band(silent: int, expected: tuple[str, ...]) -> None:
    assert problems(silent_run(1000.0, 100, 100 + silent)) == expected


def test_a_slow_rate_may_be_silent_between_its_pulses() -> None:
    assert problems(counted(1.0, latches=1001)) == ()
    slow = counted(1.0, latches=1001)
    slow.positive[:] = slow.positive[0] + np.where(np.arange(1001) * PERIOD_S > 20, np.arange(1001) // 10, 0)
    assert problems(slow) == ("dead_band",)


def test_a_stuck_counter_is_seen_as_silence() -> None:
    assert problems(silent_run(1000.0, 200, 400)) == ("dead_band",)


def test_pulses_of_both_signs_that_cancel_are_not_silence() -> None:
    number = np.arange(101)
    both = counted(0.0, positive=100 * number, negative=100 * number)
    assert (mean_rate(both).net_pps, problems(both)) == (0.0, ())
