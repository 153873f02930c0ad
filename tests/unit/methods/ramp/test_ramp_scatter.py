"""How well the samples of a ramp tell a slope: counts that share latches, scatter, and what every cycle has."""

import numpy as np
import pytest

from bench.methods.ramp.reduction.samples import RampLeg
from bench.methods.ramp.reduction.scatter import slope_scatter

SAMPLE_S, SAMPLES, RATE_PPS, SLOPE = 5.0, 240, 7000.0, 3.0
SEEDS = 60


def leg(rng, cycle, direction, sd=0.0, pattern=0.0, counted=True, samples=SAMPLES) -> RampLeg:
    edges_s = SAMPLE_S * np.arange(samples + 1)
    middle_s = (edges_s[1:] + edges_s[:-1]) / 2
    temperature_c = direction * 60.0 * (middle_s / edges_s[-1] - 0.5)
    output = RATE_PPS + SLOPE * temperature_c + sd * rng.standard_normal(samples)
    output = output + pattern * np.exp(-middle_s / 120.0) + pattern * np.sin(middle_s / 40.0)
    if counted:
        charge = rng.uniform() + np.concatenate([[0.0], np.cumsum(output * SAMPLE_S)])
        output = np.diff(np.floor(charge)) / SAMPLE_S
    return RampLeg(
        f"steps/cycle={cycle}/end={direction}/acquire", cycle, direction, 0.0, middle_s, temperature_c, output,
        np.full(samples, SAMPLE_S), counted, {},
    )  # fmt: skip


def legs(seed, cycles=2, **how) -> list[RampLeg]:
    rng = np.random.default_rng(seed)
    return [leg(rng, cycle, direction, **how) for cycle in range(1, cycles + 1) for direction in (1, -1)]


def slope(ramp) -> float:
    temperature_c, output = (
        np.concatenate([getattr(each, name) for each in ramp]) for name in ("temperature_c", "output")
    )
    return float(np.polyfit(temperature_c, output, 1)[0])


@pytest.mark.parametrize("sd", [0.0, 0.02, 0.3])
def test_slopes_err_as_much_as_is_said(sd):
    errors, reported = [], []
    for seed in range(SEEDS):
        ramp = legs(seed, sd=sd)
        found = slope_scatter(ramp)
        errors.append(slope(ramp) - SLOPE)
        reported.append(np.hypot(found.counted, found.own))
    rms = np.sqrt(np.mean(np.square(errors) / np.square(reported)))
    assert 0.8 < rms < 1.25, rms


def test_counts_are_worth_much_more_than_as_many_independent_ones():
    found = slope_scatter(legs(1))
    temperature_c = np.concatenate([each.temperature_c for each in legs(1)])
    independent = 0.408 / SAMPLE_S / (np.std(temperature_c) * np.sqrt(len(temperature_c)))
    assert found.counted < independent / 4
    assert found.own < found.counted


def test_what_is_not_counted_shares_no_latch():
    found = slope_scatter(legs(2, sd=0.02, counted=False))
    assert found.counted == 0
    assert found.own > 0


def test_what_comes_in_every_cycle_is_no_scatter():
    calm, patterned = slope_scatter(legs(3, sd=0.02)), slope_scatter(legs(3, sd=0.02, pattern=2.0))
    assert patterned.own == pytest.approx(calm.own, rel=0.3)
    once = slope_scatter(legs(3, cycles=1, sd=0.02, pattern=2.0))
    assert once.own > 5 * calm.own, "one cycle cannot tell them apart"


def test_legs_that_are_too_short_tell_nothing():
    assert slope_scatter(legs(4, samples=40)) is None
    assert slope_scatter([]) is None


def test_samples_without_a_temperature_are_left_out():
    ramp = legs(5, sd=0.02)
    whole = slope_scatter(ramp)
    ramp[0].temperature_c[100:110] = np.nan
    ramp[1].output[50] = np.nan
    holed = slope_scatter(ramp)
    assert np.isfinite([holed.counted, holed.own]).all()
    assert holed.counted > whole.counted, "a hole has ends too"
