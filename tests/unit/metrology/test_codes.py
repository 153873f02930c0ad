"""Means of what a unit sends: what makes them unusable, when samples were taken, and what their steps hide."""

import numpy as np
import pytest

from bench.metrology.acquisition import Acquisition, Codes, Turned
from bench.metrology.outputs import NO_CODES, mean_output, outputs_between, steadiness, windows_of
from bench.metrology.run_data import UnitUnderTest
from bench.metrology.sampled_codes import (
    has_restarted,
    hidden_by_steps,
    hidden_from_a_swing,
    mean_code,
    quantisation_by_angle,
    sampled_at_s,
    stuck,
)

PERIOD_S, TICK_S = 0.02, 1e-5
UNIT = UnitUnderTest("a", "S", "", 0.0, "t", telemetry="x", sent_unit="m/s²")


def codes(values, *, numbers=None, ticks=None, late_s=0.0, **changes) -> Codes:
    values = np.asarray(values, np.float64)
    numbers = np.arange(len(values)) if numbers is None else np.asarray(numbers)
    ticks = numbers * round(PERIOD_S / TICK_S) if ticks is None else np.asarray(ticks)
    return Codes(
        sequence=numbers, tick=ticks % 2**24, values=values, host_s=100 + numbers * PERIOD_S + late_s, tick_bits=24,
        tick_period_s=TICK_S, **({"step": 1.0, "lost": 0, "dropped": 0, "invalid": 0} | changes),
    )  # fmt: skip


def acquisition(found: Codes | None, **changes) -> Acquisition:
    return Acquisition(
        "steps/a", "steps", {}, 100.0, 110.0, {}, 20.0, 20.0, {}, {}, {}, codes={} if found is None else {"x": found},
        **changes,
    )  # fmt: skip


def noise(count, sd=3.0, seed=1):
    return np.rint(1000.3 + sd * np.random.default_rng(seed).standard_normal(count))


# The mean


def test_a_mean_has_the_scatter_of_its_samples():
    values = noise(500)
    found = mean_code(codes(values))
    assert found.value == values.mean()
    assert found.single_u == pytest.approx(values.std(ddof=1) / np.sqrt(500))
    assert found.quantisation_u < 1e-12
    assert found.problems == ()


@pytest.mark.parametrize(
    ("found", "problems"),
    [
        (codes([]), ("too_few_codes",)),
        (codes([5]), ("too_few_codes",)),
        (codes(noise(100), lost=99), ()),
        (codes(noise(100), lost=101), ("too_few_codes",)),
        (codes(noise(100), lost=60, invalid=60), ("too_few_codes",)),
        (codes(noise(5), numbers=[0, 1, 5, 6, 7]), ()),  # a gap in both
        (codes(noise(6), ticks=[0, 2000, 4000, 0, 2000, 4000]), ("irregular_clock",)),  # began anew, a number higher
        (codes(noise(5), ticks=2**24 - 3000 + 2000 * np.arange(5)), ()),  # the clock comes round
        (codes([1, 2, *[7] * 49, 3], stuck_after=50), ()),
        (codes([1, 2, *[7] * 50, 3], stuck_after=50), ("stuck_code",)),
        (codes([7] * 100), ()),  # nobody says how much noise there is
    ],
)
def test_what_makes_a_mean_unusable_is_told(found, problems):
    assert mean_code(found).problems == problems


def test_stuck_samples_are_those_of_the_long_row_only():
    assert stuck(codes([1, 1, 2, 2, 2, 3], stuck_after=3)).tolist() == [False, False, True, True, True, False]
    assert not stuck(codes([], stuck_after=3)).any()


# When samples were taken


def test_samples_are_as_old_as_the_clock_of_the_unit_says():
    """Frames are late by up to 10 ms, and the unit's clock is fast."""
    late_s = np.random.default_rng(2).uniform(0, 0.01, 3000)
    true_s = 100 + np.arange(3000) * PERIOD_S
    found = codes(noise(3000), late_s=late_s, ticks=np.rint(np.arange(3000) * 2000 * 1.0005).astype(int))
    assert np.abs(sampled_at_s(found) - true_s - 0.005).max() < 1e-3
    assert np.abs(found.host_s - true_s - 0.005).max() > 4.9e-3


def test_without_a_clock_that_can_be_trusted_arrivals_are_all_there_is():
    found = codes(noise(6), ticks=[0, 2000, 4000, 0, 2000, 4000])
    assert has_restarted(found)
    assert sampled_at_s(found).tolist() == found.host_s.tolist()
    assert not has_restarted(codes([1]))
    assert len(sampled_at_s(NO_CODES)) == 0


# What steps hide


def errors_of_means(sd, count, seeds=400):
    """Errors of means of rounded samples, of inputs anywhere between two codes, in steps."""
    draw = np.random.default_rng(3)
    inputs = draw.uniform(0, 1, (seeds, 1))
    samples = np.rint(inputs + sd * draw.standard_normal((seeds, count)))
    return samples.mean(axis=1) - inputs[:, 0], samples.std(axis=1, ddof=1)


@pytest.mark.parametrize("sd", [0.0, 0.1, 0.2, 0.3, 0.5, 1.0])
def test_the_uncertainty_covers_what_rounding_does_to_means(sd):
    errors, scatter = errors_of_means(sd, 400)
    u = [np.hypot(each / np.sqrt(400), hidden_by_steps(each, 1.0)) for each in scatter]
    ratios = errors / u
    assert np.sqrt(np.mean(ratios**2)) < 1.15
    assert np.abs(ratios).max() < 4
    if sd in (0.0, 1.0):  # where it is not known whether noise carries across the steps it is told too large
        assert np.sqrt(np.mean(ratios**2)) > 0.85


def test_steps_count_in_their_own_size():
    assert hidden_by_steps(0.0, 0.25) == pytest.approx(0.25 / np.sqrt(12))
    assert hidden_by_steps(0.14, 0.25) == pytest.approx(0.25 * hidden_by_steps(0.56, 1.0))
    assert hidden_by_steps(0.56, 1.0) < 0.02
    assert hidden_by_steps(1.0, 1.0) < 1e-8


def test_readings_at_one_angle_err_alike():
    gain, angle_rad = np.array([0.25, 0.25, 0.25, 0.25]), np.radians([0.0, 90.0, 90.0, 180.0])
    parts = quantisation_by_angle(gain, np.full(4, 0.3), angle_rad)
    assert parts.tolist() == pytest.approx([0.075, 0.15, 0.075])


# As the output of a unit


def test_the_output_of_a_unit_is_what_it_sends():
    found = mean_output(acquisition(codes([7] * 100)), UNIT)
    assert (found.value, found.single_u, found.quantisation_u, found.problems) == (7.0, 0.0, hidden_by_steps(0, 1), ())
    assert (UNIT.output_unit, UNIT.measured_by, UNIT.is_counted) == ("m/s²", "x", False)


def test_a_unit_that_sent_nothing_has_no_output():
    found = mean_output(acquisition(None), UNIT)
    assert np.isnan(found.value)
    assert found.problems == ("too_few_codes",)


def test_of_one_that_became_stable_the_last_part_is_read():
    values = np.concatenate([np.full(400, 50.0), np.full(100, 60.0)])
    for stable, problems in ((frozenset("a"), ()), (frozenset(), ("unstable",))):
        found = mean_output(acquisition(codes(values, lost=450), over_s=1.99, stable=stable), UNIT)
        assert (found.value, found.problems) == (60.0, problems)


def test_samples_are_cut_between_edges():
    values = np.arange(500.0)  # 50 a second
    edges_s, outputs, problems = outputs_between(codes(values), np.array([100.0, 102.0, 106.0, 111.0, 120.0]))
    assert edges_s.tolist() == [100.0, 102.0, 106.0, 111.0, 120.0]
    assert outputs[:3].tolist() == pytest.approx([50.0, 200.0, 399.5])
    assert np.isnan(outputs[3])
    assert problems == {"too_few_codes": 1}


def test_stuck_samples_are_in_no_part_and_a_unit_that_began_anew_has_none():
    values = np.concatenate([np.arange(100.0), np.full(100, 5.0), np.arange(100.0)])
    edges_s = 100 + np.array([0.0, 1.9, 3.9, 5.9])  # five samples at the edge are no part
    _, outputs, problems = outputs_between(codes(values, stuck_after=50), edges_s)
    assert np.isnan(outputs).tolist() == [False, True, False]
    assert problems == {"too_few_codes": 1}
    _, outputs, problems = outputs_between(codes(values, ticks=np.arange(300) % 150 * 2000), edges_s)
    assert np.isnan(outputs).all()
    assert problems == {"irregular_clock": 3}


def test_steadiness_is_that_of_the_means_of_ten_seconds():
    count = 3500
    values = 0.5 * np.arange(count) * PERIOD_S + noise(count, sd=5.0)
    sd, slope = steadiness(codes(values), 60.0)
    assert slope == pytest.approx(0.5, abs=0.05)
    assert sd == pytest.approx(0.5 * 10 * np.std(range(6), ddof=1), rel=0.1)
    assert steadiness(codes(values[:2000]), 60.0) is None


# Windows


def window_of(found, turned=None):
    return windows_of({"x": found}, turned)["x"]


def test_a_window_at_rest_is_the_mean_of_its_samples():
    values = noise(500)
    found = window_of(codes(values))
    assert (found.mean, found.problems) == (values.mean(), ())
    assert found.span_s == found.host_span_s == pytest.approx(499 * PERIOD_S)
    assert found.single_u == pytest.approx(values.std(ddof=1) / np.sqrt(500))


TURN = Turned("outer", 60.0, 102.011, 0.0, 108.011, 360.0)


def test_a_window_of_turns_is_cut_where_the_table_was_seen():
    """What goes up and down once a turn is not in it, nor what began before the first look at the table."""
    ends_s = 100 + PERIOD_S * np.arange(500)
    values = 1000 + 50 * np.sin(2 * np.pi * (ends_s - PERIOD_S / 2 - TURN.from_s) / 6)
    values[: 1 + np.searchsorted(ends_s, TURN.from_s)] = 5000.0  # the last of them has begun before it
    values[ends_s > TURN.to_s] = -5000.0
    found = window_of(codes(values), TURN)
    assert found.mean == pytest.approx(1000, abs=1e-3)
    assert (found.span_s, found.host_span_s) == (pytest.approx(6.0), pytest.approx(6.0))


def test_samples_that_did_not_come_leave_a_turn_whole():
    ends_s = 100 + PERIOD_S * np.arange(500)
    values = 1000 + 50 * np.sin(2 * np.pi * (ends_s - PERIOD_S / 2 - TURN.from_s) / 6)
    there = np.delete(np.arange(500), np.arange(150, 160))
    found = window_of(codes(values[there], numbers=there, lost=10), TURN)
    assert abs(found.mean - 1000) < 0.2
    assert abs(values[there][(ends_s[there] > TURN.from_s) & (ends_s[there] <= TURN.to_s)].mean() - 1000) > 1


def test_what_goes_up_and_down_over_a_turn_is_no_scatter():
    turning = 50 * np.sin(2 * np.pi * PERIOD_S * np.arange(500) / 6)
    still, moving = (window_of(codes(noise(500) + extra), TURN).single_u for extra in (0.0, turning))
    assert still == pytest.approx(3.0 / np.sqrt(299), rel=0.15)
    assert moving == pytest.approx(still, rel=0.1)


def test_turns_of_which_no_sample_came_are_unusable():
    turned = Turned("outer", 20.0, 202.0, 0.0, 208.0, 120.0)
    assert window_of(codes(noise(500)), turned).problems == ("too_few_codes",)


def test_a_unit_that_began_anew_while_it_turned_is_unusable():
    turned = Turned("outer", 20.0, 100.5, 0.0, 101.5, 20.0)
    found = window_of(codes(noise(100), ticks=np.arange(100) % 50 * 2000), turned)
    assert found.problems == ("irregular_clock",)


# Swings


@pytest.mark.parametrize(("size", "sd"), [(3.0, 0.0), (30.0, 0.0), (300.0, 0.0), (30.0, 0.15), (30.0, 0.3)])
def test_steps_change_a_swing_by_what_is_told(size, sd):
    """Swings of about one size through the steps, each about a middle of its own."""
    draw = np.random.default_rng(3)
    phase = 2 * np.pi * np.arange(20_000) / 20_000 * 601
    errors, scatters = [], []
    for _ in range(60):
        amplitude, middle = size + draw.uniform(0, 1), draw.uniform(0, 1)
        exact = middle + amplitude * np.cos(phase)
        samples = np.rint(exact + sd * draw.standard_normal(len(phase)))
        errors.append(2 * np.mean(samples * np.cos(phase)) - amplitude)
        scatters.append(np.std(samples - exact))
    by_noise = np.sqrt(2 / len(phase)) * np.mean(scatters)
    (reported,) = hidden_from_a_swing(np.array([size]), float(np.mean(scatters)), 1.0)
    assert 0.6 < np.std(errors) / np.hypot(reported, by_noise) < 1.5


def test_thirty_codes_are_enough_and_noise_hides_the_steps():
    assert hidden_from_a_swing(np.array([30.0]), 0.29, 1.0)[0] / 30 == pytest.approx(6.5e-4, rel=0.1)
    assert hidden_from_a_swing(np.array([30.0, 300.0]), 1.0, 1.0) == pytest.approx([0, 0], abs=1e-8)
    assert hidden_from_a_swing(np.array([30.0]), 0.0, 0.0).tolist() == [0.0]
