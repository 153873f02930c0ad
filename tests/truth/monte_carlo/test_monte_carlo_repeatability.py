"""GUM supplement 1 for repeatability: seats and turn-on biases drawn, and pushed through the real reduction.

A standard deviation is no linear function of what is drawn: its interval has to hold the truth. What the readings of a
tumble scatter by is contained in it, and in the truth as well.
"""

from dataclasses import replace
from functools import lru_cache
from unittest import mock

import numpy as np
import pytest

from bench.methods.tumble.reduction import dwells
from bench.methods.tumble.reduction.repeatability import reduce
from bench.metrology.acquisition import Acquisition
from bench.metrology.bench_uncertainty import Drift
from bench.metrology.run_data import RunData
from tests.support.monte_carlo import found_in, ratio, scatter_is_u, would_be_seen
from tests.truth.monte_carlo.test_monte_carlo import (
    BENCH,
    GATE_S,
    K0,
    K1,
    NOISE_PPS,
    POSITIONS_DEG,
    UNIT,
    Errors,
    counts,
    known_elevation_rad,
)

TRIALS = 300
REPETITIONS = 5
TURN_ON_G, SCALE, SEAT = 4e-6, 3e-6, 3e-6  # standard deviations, as large as to be seen beside those of the readings
BIAS_PER_C_U, DRIFT_U_C = 20e-6, 0.15  # of the unit; of its thermometer, from the begin of the run to its end
HOLDS = 0.9  # of the draws, that intervals have to hold the truth in; they claim 0.95


def repetition(number, bias_g, scale, misalignment, errors, rng):
    for position, angle_deg in enumerate(POSITIONS_DEG):
        turn = errors.true_rad(angle_deg)
        force_g = np.sin(turn) + misalignment * np.cos(turn) + bias_g
        rate_pps = K1 * scale * force_g + NOISE_PPS * rng.standard_normal()
        group, begin_s = f"steps/repetition={number}", (8 * number + position) * (GATE_S + 5)
        yield Acquisition(
            step=f"{group}/{position}", group=group, loops={}, begin_s=begin_s, end_s=begin_s + GATE_S,
            angles_deg={"head": angle_deg}, set_from_c=25.0, set_c=25.0,
            counts={"x": counts(np.full(1, rate_pps), GATE_S, rng, errors.clock)},
            temperatures_c={"t": np.full(1, 25.0)}, temperatures_at_s={"t": np.zeros(1)},
        )  # fmt: skip


def run(rng):
    """A run, and by how much the bias really moved from the first repetition to the last."""
    errors = Errors(rng)
    biases, scales, seats = rng.standard_normal((3, REPETITIONS)) * np.array([[TURN_ON_G], [SCALE], [SEAT]])
    moved_g = biases[-1] - biases[0]
    # shown is 25 °C throughout: the unit is as much colder as the thermometer has come to show too much
    drifted_c = DRIFT_U_C * rng.standard_normal() * np.linspace(-0.4, 0.4, REPETITIONS)
    biases = biases - BIAS_PER_C_U * rng.standard_normal() * drifted_c
    acquisitions = [
        each
        for number, drawn in enumerate(zip(K0 + biases, 1 + scales, seats, strict=True))
        for each in repetition(number, *drawn, errors, rng)
    ]
    bench = replace(BENCH, thermometer_drifts={UNIT.temperature: Drift(DRIFT_U_C, is_stated=True)})
    return RunData("repeat", (UNIT,), tuple(acquisitions), bench), moved_g


def true_sd(found):
    """What was drawn from, and what the readings add to it."""
    drawn = {"K0/sd": TURN_ON_G, "K1/sd": SCALE, "misalignment/sd": SEAT}[found.quantity]
    return float(np.hypot(drawn, found.interval.from_scatter))


@lru_cache
def repeated(trials, seed=1):
    """The results of runs, each with the closure that is true."""
    rng, found = np.random.default_rng(seed), []
    with mock.patch.object(dwells, "elevation_rad", lambda each, *_: known_elevation_rad(each.angle_deg)):
        for _ in range(trials):
            data, moved_g = run(rng)
            found.append((reduce(data, {"bias_per_c_u": BIAS_PER_C_U})[0], moved_g))
    return found


SDS = ("K0/sd", "K1/sd", "misalignment/sd")


def trials(count=TRIALS, seed=1):
    return found_in(
        (result, dict.fromkeys(SDS, true_sd) | {"K0/closure": lambda _, moved_g=moved_g: moved_g})
        for result, moved_g in repeated(count, seed)
    )


@pytest.mark.parametrize("quantity", [*SDS, "K0/closure"])
def test_the_uncertainties_of_repeatability_are_those_of_repeated_campaigns(quantity):
    rows = trials()[quantity]
    assert scatter_is_u(rows), ratio(rows)


@pytest.mark.parametrize("quantity", SDS)
def test_the_interval_of_a_standard_deviation_holds_what_was_drawn_from(quantity):
    found = [each for result, _ in repeated(TRIALS) for each in result.findings if each.quantity == quantity]
    held = np.mean([each.interval.low <= true_sd(each) <= each.interval.high for each in found])
    assert held >= HOLDS
    narrow = np.mean([each.value - each.u <= true_sd(each) <= each.value + each.u for each in found])
    assert narrow < HOLDS, "an interval of one standard uncertainty is too short"


def test_every_finding_of_repeatability_is_tried():
    (result, _), *_ = repeated(TRIALS)
    assert {each.quantity for each in result.findings} == set(trials())


def test_an_uncertainty_that_is_15_percent_off_is_seen():
    assert would_be_seen(trials()["K0/closure"])
