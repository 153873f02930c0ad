"""The static tumble against the truth: few seeds of a short sequence here, forty of the whole one by `make truth`."""

import pytest

from bench.app.request import RunRequest
from tests.support.runs import SHORT
from tests.truth import judge
from tests.truth.campaign import compare, full_bench, perfect_bench, run_one
from tests.truth.planted import PLANTED, comparisons_with

SEEDS = (1, 2)
SETTLED = ("temperatures=[20 °C, 20 °C, 20 °C]", "soak=30 min")  # warm, and at rest: only noise is left


def runs(tmp_path_factory, bench, settings):
    folder = tmp_path_factory.mktemp("truth")
    path = bench(folder / "config")
    return [
        run_one(RunRequest("tumble_static", bench=str(path), seed=seed, settings=settings, runs=folder / "runs"))
        for seed in SEEDS
    ]


@pytest.fixture(scope="module")
def perfect_runs(tmp_path_factory):
    return runs(tmp_path_factory, perfect_bench, SETTLED)


@pytest.mark.timeout(120)
def test_on_a_perfect_bench_errors_are_as_large_as_their_uncertainties(perfect_runs):
    comparisons = compare(perfect_runs)
    ratios = [c.ratio for c in comparisons if c.quantity in ("K0", "K1_si", "K2", "misalignment")]
    assert 0.7 < judge._rms(ratios) < 1.35
    assert max(abs(ratio) for ratio in ratios) < 4.5
    assert all(c.u <= judge.K0_U_LIMIT_G for c in comparisons if c.quantity == "K0")
    assert all(c.u <= judge.K1_U_LIMIT * c.value for c in comparisons if c.quantity == "K1")


@pytest.mark.timeout(120)
def test_on_a_full_bench_errors_stay_within_their_uncertainties(tmp_path_factory):
    comparisons = [c for c in compare(runs(tmp_path_factory, full_bench, SHORT)) if c.dwell == 0]
    assert max(abs(c.ratio) for c in comparisons) < 4
    assert all(c.u > 2e-6 for c in comparisons if c.quantity == "K0"), "the head's harmonics are in the budget"


@pytest.mark.parametrize("name", [name for name in PLANTED if "wrap" not in name])
def test_a_planted_error_is_seen(perfect_runs, name):
    found = judge.judge_perfect(comparisons_with(PLANTED[name], perfect_runs))
    worst = max(abs(c.ratio) for c in comparisons_with(PLANTED[name], perfect_runs))
    assert found
    assert worst > 10, "it is not the scatter of a few seeds that was seen"
