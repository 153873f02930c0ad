"""Few readings of an output on a table that turns unevenly: their mean, and how well it is known."""

import numpy as np
import pytest

from bench.methods.rate_table.reduction.turning_readings import LEAST_DOF, TurningReadings

EVERY_S, APERTURE_S = 0.216, 0.1
NOISE = 1e-4
RIPPLE, POLES = 1e-4, 24  # of the rate; the orders at which it is uneven are 1, 2 and this
SCALE_ERROR, TILT = 3e-4, 5e-3


def waves(angle_deg, phases):
    """How much faster the table is, relative, at angles (n,)."""
    return RIPPLE * sum(
        np.cos(np.radians(order * angle_deg) + phase) for order, phase in zip((1, 2, POLES), phases, strict=True)
    )


def mean_over(function, at_s, width_s):
    return np.mean([function(at_s + width_s * away) for away in (np.arange(50) + 0.5) / 50 - 0.5], axis=0)


def readings(rng, rate_dps, count=24, noise=NOISE):
    """A gyro that gravity tilts, read at times of its own."""
    phases = rng.uniform(0, 2 * np.pi, 3)
    at_s = EVERY_S * np.arange(count)

    def dps(time_s):
        return rate_dps * (1 + waves(rate_dps * time_s, phases))

    def output(time_s):
        return (1 + SCALE_ERROR) * dps(time_s) + TILT * np.cos(np.radians(rate_dps * time_s) + 0.3)

    return TurningReadings(
        mean_over(output, at_s, APERTURE_S) + noise * rng.standard_normal(count),
        (rate_dps * at_s) % 360, mean_over(dps, at_s, EVERY_S / 2),
    )  # fmt: skip


@pytest.mark.parametrize("rate_dps", [-130.0, 200.0, 400.0, 1134.0])
def test_what_goes_with_the_table_is_neither_in_the_mean_nor_in_its_uncertainty(rate_dps):
    rng = np.random.default_rng(5)
    found = np.array([readings(rng, rate_dps).at_rate(rate_dps) for _ in range(40)])
    errors, u = found[:, 0] - (1 + SCALE_ERROR) * rate_dps, found[:, 1]
    assert np.sqrt(np.mean((errors / u) ** 2)) == pytest.approx(1.0, abs=0.25)
    assert np.median(u) == pytest.approx(NOISE / np.sqrt(24), rel=0.25)
    plain = np.std(readings(rng, rate_dps).output, ddof=1) / np.sqrt(24)
    assert plain > 10 * np.median(u)


def test_a_wave_of_which_few_readings_see_a_part_is_in_the_uncertainty():
    """14 readings of 20 ms at 400 °/s, 86.4° apart: of the fourth harmonic, -14.4° apart, they see half a wave."""
    rng, at_s = np.random.default_rng(8), EVERY_S * np.arange(14)

    def one(phases):
        def dps(time_s):
            return 400 * (1 + RIPPLE * sum(
                np.cos(np.radians(order * 400 * time_s) + phase) for order, phase in zip((1, 2, 4), phases, strict=True)
            ))  # fmt: skip

        output = mean_over(dps, at_s, 0.02) + NOISE * rng.standard_normal(14)
        return TurningReadings(output, 400 * at_s % 360, mean_over(dps, at_s, EVERY_S / 2)).at_rate(400.0)

    found = np.array([one(rng.uniform(0, 2 * np.pi, 3)) for _ in range(200)])
    ratios = (found[:, 0] - 400) / found[:, 1]
    assert np.sqrt(np.mean(ratios**2)) < 1.35
    assert np.mean(np.abs(ratios) > 3) <= 0.02


def test_a_part_of_a_turn_does_not_tell_a_harmonic_from_the_mean():
    at_s = EVERY_S * np.arange(24)
    noise = 1e-6 * np.random.default_rng(6).standard_normal((2, 24))
    within = TurningReadings(0.1 + noise[0], 40.0 * at_s, 40.0 + noise[1])
    mean, u, dof = within.at_rate(40.0)
    assert (mean, dof) == (pytest.approx(0.1, abs=2e-6), 24 - 2)
    assert u < 1e-6


@pytest.mark.parametrize("count", [3, LEAST_DOF, LEAST_DOF + 1])
def test_few_readings_tell_their_mean(count):
    output = np.arange(count, dtype=float)
    mean, u, dof = TurningReadings(output, 90.0 * output, 400.0 + output % 2).at_rate(400.0)
    assert (mean, dof) == (pytest.approx(np.mean(output)), count - 1)
    assert u == pytest.approx(np.std(output, ddof=1) / np.sqrt(count))


def test_at_rest_nothing_goes_with_the_table():
    output = np.random.default_rng(7).standard_normal(30)
    mean, u, dof = TurningReadings(output, np.full(30, 90.0), np.zeros(30)).at_rate(0.0)
    assert (mean, dof) == (pytest.approx(np.mean(output)), 29)
    assert u == pytest.approx(np.std(output, ddof=1) / np.sqrt(30))
