"""GUM supplement 1 for threshold and resolution: dead bands drawn, and ladders pushed through the real reduction.

A dead band may lie anywhere between two steps of a ladder: drawn uniformly, it is as far from the upper one as the
uncertainty says, in the root mean square, and between the two that the result names.
"""

from functools import lru_cache
from unittest import mock

import numpy as np
import pytest

from bench.methods.threshold.method import THRESHOLD
from bench.methods.threshold.reduction import run as ladder
from bench.methods.threshold.reduction.run import reduce
from bench.metrology.acquisition import Acquisition
from bench.metrology.run_data import RunData, UnitUnderTest
from tests.support.monte_carlo import found_in, ratio, scatter_is_u, would_be_seen
from tests.truth.monte_carlo.test_monte_carlo import BENCH, K0, Errors, counts, known_elevation_rad

TRIALS = 300
UNIT = UnitUnderTest("a", "S1", "x", 0.0, "t", nominal_per_g=11_300.0)
POSITIONS_DEG = {"threshold": 0.0, "resolution": 30.0}
SIZES_ARCSEC, REPEATS = (5.0, 10.0, 20.0, 50.0), 2
ARCSEC_G = np.radians(1 / 3600)
GATE_S = 60.0
HOLDS = 0.9  # of the draws, that the two ends have to hold the truth in
SETTINGS = THRESHOLD.settings.model_validate({}).model_dump()


def ladder_run(rng, position_deg, threshold_g, noise_g):
    """A unit that follows only what is beyond half of its threshold, as friction makes it."""
    errors, acquisitions = Errors(rng), []
    offsets_arcsec = [sense * size for size in SIZES_ARCSEC for sense in (1, -1) for _ in range(REPEATS)]
    at_reference_g = np.sin(errors.true_rad(position_deg))
    for number, offset_arcsec in enumerate([0.0, *(at for each in offsets_arcsec for at in (each, 0.0))]):
        angle_deg = position_deg + offset_arcsec / 3600
        change_g = np.sin(errors.true_rad(angle_deg)) - at_reference_g
        followed_g = np.sign(change_g) * max(abs(change_g) - threshold_g / 2, 0.0)
        force_g = at_reference_g + followed_g + K0 + noise_g * rng.standard_normal()
        begin_s = number * (GATE_S + 5)
        acquisitions.append(
            Acquisition(
                step=f"steps/ladder/{number}", group="steps/ladder", begin_s=begin_s, end_s=begin_s + GATE_S,
                loops={"position": position_deg, "offset": offset_arcsec}, angles_deg={"head": angle_deg},
                set_from_c=np.nan, set_c=np.nan, temperatures_c={"t": np.full(1, 20.0)},
                temperatures_at_s={"t": np.zeros(1)},
                counts={"x": counts(np.full(1, UNIT.nominal_per_g * force_g), GATE_S, rng, errors.clock)},
            )
        )  # fmt: skip
    return RunData("ladder", (UNIT,), tuple(acquisitions), BENCH)


@lru_cache
def ladders(noise_g=1e-6, trials=TRIALS, seed=1):
    """The results of ladders, each with the threshold that is true."""
    rng, found = np.random.default_rng(seed), []
    with mock.patch.object(ladder, "elevation_rad", lambda each, *_: known_elevation_rad(each.angle_deg)):
        for number in range(trials):
            position_deg = list(POSITIONS_DEG.values())[number % 2]
            threshold_g = np.cos(np.radians(position_deg)) * ARCSEC_G * rng.uniform(SIZES_ARCSEC[0], SIZES_ARCSEC[-1])
            found.append((reduce(ladder_run(rng, position_deg, threshold_g, noise_g), SETTINGS)[0], threshold_g))
    return found


def errors_of(found):
    return found_in((result, dict.fromkeys(POSITIONS_DEG, lambda _, true_g=true_g: true_g)) for result, true_g in found)


@pytest.mark.parametrize("quantity", POSITIONS_DEG)
def test_thresholds_are_as_far_from_the_truth_as_their_uncertainties_say(quantity):
    rows = errors_of(ladders())[quantity]
    assert len(rows) == TRIALS / 2
    assert scatter_is_u(rows), ratio(rows)


@pytest.mark.parametrize("noise_g", [1e-6, 4e-6])
def test_the_two_ends_hold_the_threshold_unless_a_step_that_decides_is_marginal(noise_g):
    reported = [
        (each.at["above_g"] <= true_g <= (each.at["up_to_g"] or np.inf), "marginal" in each.flags)
        for result, true_g in ladders(noise_g)
        for each in result.findings
    ]
    assert len(reported) == TRIALS
    certain = [held for held, is_marginal in reported if not is_marginal]
    assert len(certain) > TRIALS / 3
    assert np.mean(certain) >= HOLDS


def test_an_uncertainty_that_is_15_percent_off_is_seen():
    assert would_be_seen(np.concatenate(list(errors_of(ladders()).values())))
