"""The dynamic temperature test against the truth: short ramps on the full bench, of a good unit and one that jumps."""

import pytest

from campaigns.truth.campaign import results_of, run_one
from campaigns.truth.ramp import QUANTITIES, compare_ramp, quick_request
from campaigns.truth.signs import differences

JUMP_C, JUMP_G = 30.0, 150e-6
JUMPING = ("  Kd:", f"  jumps: [{{at: {JUMP_C:g} °C, size: {JUMP_G * 1e6:g} µg}}]\n  Kd:")


@pytest.fixture(scope="module")
def good_run(tmp_path_factory):
    return run_one(quick_request(tmp_path_factory.mktemp("good"), 1))


@pytest.fixture(scope="module")
def jumping_run(tmp_path_factory):
    return run_one(quick_request(tmp_path_factory.mktemp("jumping"), 2, JUMPING))


def test_errors_stay_within_their_uncertainties(good_run, jumping_run):
    comparisons = [comparison for run in (good_run, jumping_run) for comparison in compare_ramp(run)]
    assert [comparison.quantity for comparison in comparisons] == [*QUANTITIES, *QUANTITIES]
    assert max(abs(comparison.ratio) for comparison in comparisons) < 3.5
    assert all(comparison.held for comparison in comparisons)
    assert sum(abs(comparison.ratio) < 2 for comparison in comparisons) > 0.8 * len(comparisons)


def test_uncertainties_are_worth_stating(good_run):
    most = {"K0/temperature_coefficient": 0.1e-6, "K0/hysteresis": 8e-6, "K0/repeatability": 8e-6}
    found = {each["quantity"]: each["u"] for each in results_of(good_run)["findings"]}
    assert {quantity: u for quantity, u in found.items() if u > most.get(quantity, 1.0)} == {}


def test_a_jump_of_the_unit_is_found_and_fails_it(good_run, jumping_run):
    assert results_of(good_run)["verdict"] == "PASS"
    results = results_of(jumping_run)
    (jump,) = (found for found in results["findings"] if found["quantity"] == "K0/jump")
    assert results["verdict"] == "FAIL"
    assert (jump["at"]["cycle"], jump["at"]["leg"]) == (1, "up")
    assert abs(jump["at"]["at_c"] - JUMP_C) < 2, "the thermometer lags, and has its error"
    assert abs(jump["value"] - JUMP_G) < 3 * jump["u"]


def test_the_report_draws_every_leg_and_the_jump(good_run, jumping_run):
    good, jumping = ((run / "report.html").read_text("utf-8") for run in (good_run, jumping_run))
    for words in (
        "cycle 1, rising",
        "cycle 1, falling",
        "cycle 2, rising",
        "cycle 2, falling",
        "leg 8",
        "4 dwells or legs used",
    ):
        assert words in good
    assert ">jump<" in jumping
    assert ">jump<" not in good


def test_a_unit_of_the_other_sign_differs_in_its_sign_alone(jumping_run):
    assert list(differences(jumping_run)) == []
