"""Ladders counted by a converter with a dead band (equations 8.5), reduced and held against the true threshold."""

import numpy as np
import pytest

from bench.methods.threshold.reduction.threshold import LadderRecord, find_threshold

PPS_PER_G = 11_300.0
DWELL_S = 100.0
SIZES_ARCSEC = (1, 2, 5, 10, 20, 50, 100)
NOISE_G = 2e-7  # of the mean of one dwell
REPEATABILITY_G = 2e-7


def counted_ladder(rng, *, dead_band_g, off_centre_g, drift_g_per_s=0.0):
    """Three repeats of both senses, A-B-A; the converter is silent within `dead_band_g` of zero input.

    The reference position stands `off_centre_g` from there. The head's error is in the input, and not read back.
    """
    step = [0.0]
    for size in SIZES_ARCSEC:
        for _ in range(3):
            step += [size, 0, -size, 0]
    step = np.array(step)
    n = len(step)
    time_s = 1.2 * DWELL_S * np.arange(n)
    input_g = np.radians(step / 3600)
    true_g = input_g + off_centre_g + REPEATABILITY_G * rng.standard_normal(n) + drift_g_per_s * time_s
    sensed_g = true_g + NOISE_G * rng.standard_normal(n)
    pulses = np.where(np.abs(sensed_g) < dead_band_g, 0.0, sensed_g) * PPS_PER_G * DWELL_S
    phase = rng.uniform(0, 1, n)
    count_g = 1 / (PPS_PER_G * DWELL_S)
    return LadderRecord(
        time_s=time_s,
        step=step,
        input_g=input_g,
        output_g=(np.floor(pulses + phase) - np.floor(phase)) * count_g,
        u_g=np.full(n, np.sqrt(NOISE_G**2 + REPEATABILITY_G**2 + (0.408 * count_g) ** 2)),
        count_g=np.full(n, count_g),
    )


def test_the_dead_band_of_a_converter_is_found_within_its_uncertainty():
    rng = np.random.default_rng(20_240_607)
    ratios, inside = [], []
    for _ in range(150):
        dead_band_g = rng.uniform(10e-6, 150e-6)
        off_centre_g = rng.uniform(-0.7, 0.7) * dead_band_g
        truth_g = dead_band_g + abs(off_centre_g)  # the sense that has to cross all of it
        found = find_threshold(counted_ladder(rng, dead_band_g=dead_band_g, off_centre_g=off_centre_g))
        assert found.relation == "equal"
        ratios.append((found.threshold_g - truth_g) / np.hypot(found.u_ladder_g, found.u_noise_g))
        inside.append(found.low_g - 2 * found.u_noise_g < truth_g < found.high_g + 2 * found.u_noise_g)
    assert 0.8 < np.sqrt(np.mean(np.square(ratios))) < 1.2
    assert np.mean(inside) == 1.0


@pytest.mark.parametrize("drift_g_per_s", [0.0, 3e-9, -3e-9])  # 3e-9 g/s moves the zero by 1.8 µg within A-B-A
def test_without_a_dead_band_the_smallest_step_passes_whatever_the_zero_does(drift_g_per_s):
    rng = np.random.default_rng(1)
    for _ in range(20):
        found = find_threshold(counted_ladder(rng, dead_band_g=0.0, off_centre_g=3e-4, drift_g_per_s=drift_g_per_s))
        assert found.relation == "at_most"
        assert found.threshold_g == pytest.approx(np.radians(1 / 3600))
        assert max(abs(step.ratio - 1) / step.u_ratio for step in found.steps) < 4.5
