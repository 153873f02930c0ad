"""The static tumble against the truth: few seeds of a short sequence here, forty of the whole one by `make truth`."""

import json
from dataclasses import replace

import numpy as np
import pytest

from bench.app.request import RunRequest
from bench.methods.tumble.method import TEMPERATURE_TUMBLE
from bench.methods.tumble.reduction.run import reduce
from bench.metrology.results.limits import Limits
from bench.reduce.stored_run import open_run
from campaigns.truth import judge
from campaigns.truth.campaign import compare, full_bench, perfect_bench, results_of, run_one
from campaigns.truth.planted import PLANTED, comparisons_with
from campaigns.truth.signs import differences
from tests.support.flags import texts
from tests.support.runs import SHORT

SEEDS = (1, 2)
OF_NOISE = (1, 2, 3, 4)  # two of them may be small by chance
SETTLED = ("temperatures=[20 °C, 20 °C, 20 °C]", "soak=30 min")  # warm, and at rest: only noise is left


def runs(tmp_path_factory, bench, settings, seeds=SEEDS):
    folder = tmp_path_factory.mktemp("truth")
    path = bench(folder / "config")
    return [
        run_one(RunRequest("tumble_static", bench=str(path), seed=seed, settings=settings, runs=folder / "runs"))
        for seed in seeds
    ]


@pytest.fixture(scope="module")
def perfect_runs(tmp_path_factory):
    return runs(tmp_path_factory, perfect_bench, SETTLED, OF_NOISE)


def test_on_a_perfect_bench_errors_are_as_large_as_their_uncertainties(perfect_runs):
    comparisons = compare(perfect_runs)
    ratios = [c.ratio for c in comparisons if c.quantity in ("K0", "K1_si", "K2", "misalignment")]
    assert 0.7 < judge._rms(ratios) < 1.35
    assert max(abs(ratio) for ratio in ratios) < 4.5
    assert all(c.u <= judge.K0_U_LIMIT_G for c in comparisons if c.quantity == "K0")
    assert all(c.u <= judge.K1_U_LIMIT * c.value for c in comparisons if c.quantity == "K1")


def test_on_a_full_bench_errors_stay_within_their_uncertainties(tmp_path_factory):
    comparisons = [c for c in compare(runs(tmp_path_factory, full_bench, SHORT)) if c.dwell == 0]
    assert max(abs(c.ratio) for c in comparisons) < 4
    assert all(c.u > 2e-6 for c in comparisons if c.quantity == "K0"), "the head's harmonics are in the budget"


@pytest.mark.parametrize("name", [name for name in PLANTED if "wrap" not in name and "legs" not in name])
def test_a_planted_error_is_seen(perfect_runs, name):
    found = judge.judge_perfect(comparisons_with(PLANTED[name], perfect_runs))
    worst = max(abs(c.ratio) for c in comparisons_with(PLANTED[name], perfect_runs))
    assert found
    assert worst > 10, "it is not the scatter of a few seeds that was seen"


@pytest.mark.parametrize("name", PLANTED)
def test_what_a_planted_error_changes_is_there(name):
    """Those of wraps and of legs show in long runs only, which `make truth` has."""
    with PLANTED[name]():
        pass


def test_the_closure_is_what_the_bias_really_did_between_the_ends(perfect_runs):
    for folder in perfect_runs:
        (closure,) = [found for found in results_of(folder)["findings"] if found["quantity"] == "K0/closure"]
        first, *_, last = json.loads((folder / "truth.json").read_text("utf-8"))["dwells"].values()
        assert abs(closure["value"] - (last["K0"] - first["K0"])) < 4 * closure["u"]
        assert closure["u"] < 1e-6


def test_a_bias_that_does_not_come_back_makes_every_verdict_marginal(perfect_runs):
    with open_run(perfect_runs[0]) as stored:
        data = stored.data("tumble")
    for limit_g, marginal in ((100e-6, False), (1e-15, True)):
        settings = TEMPERATURE_TUMBLE.settings.model_validate({}).model_dump() | {"closure_limit_g": limit_g}
        (unit,) = reduce(data, settings)
        judged = [finding.judged(Limits(-1, 1)) for finding in unit.findings if finding.quantity == "K0"]
        assert [(finding.verdict, finding.marginal) for finding in judged] == [("PASS", marginal)] * 3
        assert ("not_closed" in texts(unit.flags)) == marginal


@pytest.fixture(scope="module")
def eight_points(tmp_path_factory):
    folder = tmp_path_factory.mktemp("eight")
    settings = ("temperatures=[20 °C, 20 °C]", "soak=30 min", "warm_up=0 s", "gate=20 s")
    bench = perfect_bench(folder / "config")
    return run_one(
        RunRequest(
            "tumble_static", bench=str(bench), preset="eight_points", seed=3, settings=settings, runs=folder / "r"
        )
    )


def test_eight_positions_tell_further_terms_as_large_as_they_are(eight_points):
    found = [each for each in compare([eight_points]) if each.quantity in ("K1", "K3", "Kip", "asymmetry")]
    assert len(found) == 8
    assert max(abs(each.ratio) for each in found) < 4
    asymmetry = [each for each in found if each.quantity == "asymmetry"]
    assert all(abs(each.value - 30e-6) < 4 * each.u + 3e-6 for each in asymmetry), "that of the unit file"


@pytest.fixture(scope="module")
def two_mounts(tmp_path_factory):
    folder = tmp_path_factory.mktemp("two")
    bench, settings = perfect_bench(folder / "config"), ("steady_within=9 µg",)
    request = RunRequest(
        "tumble_clocked", bench=str(bench), preset="quick", seed=3, settings=settings, runs=folder / "r"
    )
    return run_one(request)


def test_two_mounts_tell_both_couplings_and_misalignments_as_they_are_in_the_unit(two_mounts):
    truth = json.loads((two_mounts / "truth.json").read_text("utf-8"))
    unit, found = truth["units"]["a"], {each["quantity"]: each for each in results_of(two_mounts)["findings"]}
    of_the_unit = {
        "Kip": unit["kip"], "Kio": unit["kio"], "misalignment": unit["misalignment_o"],
        "misalignment_y": -unit["misalignment_p"],
    }  # fmt: skip
    for quantity, true in of_the_unit.items():
        products = 1e-7  # of misalignments and K2
        assert abs(found[quantity]["value"] - true) < 4 * found[quantity]["u"] + products, quantity
        assert found[quantity]["u"] < 3e-6
    assert max(abs(each.ratio) for each in compare([two_mounts])) < 4
    assert "not observable" not in (two_mounts / "report.html").read_text("utf-8")


def test_the_report_names_what_the_angles_do_not_tell(eight_points, perfect_runs):
    eight, four = ((folder / "report.html").read_text("utf-8") for folder in (eight_points, perfect_runs[0]))
    assert "these angles cannot separate K3 from K1: K1 contains it" in four
    assert "cannot tell K3" not in eight
    assert "contains K3<" in four
    assert "contains K3<" not in eight


def test_a_unit_of_the_other_sign_differs_in_its_sign_alone(perfect_runs, eight_points):
    for folder in (perfect_runs[0], eight_points):
        assert list(differences(folder)) == []


def test_where_the_head_stood_is_new_in_each_dwell_and_in_what_compares_dwells(perfect_runs):
    """A level axis feels all of the head's repeatability, an upright one none: residuals of tumbles hold half of it."""
    u_deg = 1e-4
    with open_run(perfect_runs[0]) as stored:
        data = stored.data("tumble")
    axes = {name: axis._replace(repeatability_u_deg=u_deg) for name, axis in data.bench.axes.items()}
    scattering = replace(data, bench=replace(data.bench, axes=axes))
    settings = TEMPERATURE_TUMBLE.settings.model_validate({}).model_dump()
    u = {}
    for each in (data, scattering):
        (unit,) = reduce(each, settings)
        u[each is data] = {finding.quantity: finding.u for finding in unit.findings}
    added = {quantity: np.sqrt(u[False][quantity] ** 2 - u[True][quantity] ** 2) for quantity in u[True]}
    of_a_dwell = np.radians(u_deg) / 2  # four level readings of each dwell
    assert added["K0"] == pytest.approx(of_a_dwell, rel=1e-3)
    assert added["K0/closure"] == pytest.approx(of_a_dwell * np.sqrt(2), rel=1e-3)
    assert added["K1"] < 0.05 * of_a_dwell * abs(u[True]["K1"] / u[True]["K0"])
