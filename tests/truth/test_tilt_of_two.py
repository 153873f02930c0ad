"""Tilt by two accelerometers on the bench for three units: a tumble and a ramp with the calibrations of both."""

import json

import pytest

from bench.app.request import RunRequest
from campaigns.truth import verified_pair
from campaigns.truth.campaign import full_bench, results_of, run_one
from campaigns.truth.ramp import draw_misalignments
from campaigns.truth.verified import known_of

UNITS = ("a=UA", "b=UB")
DWELLS = ("soak=30 min", "warm_up=40 min", "gate=10 s")
CALIBRATED = ("temperatures=[20 °C, 50 °C, 20 °C, -10 °C, 20 °C]", *DWELLS)
TUMBLED = ("temperatures=[20 °C, 35 °C, 5 °C]", *DWELLS)
RAMPED = ("low=0 °C", "high=40 °C", "ramp_rate=3 °C/min", "warm_up=40 min")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Verifications of one pair by a tumble and by a ramp; its calibrations are of a tumble."""
    folder = tmp_path_factory.mktemp("pair")
    bench = full_bench(folder / "config", "three_units")
    draw_misalignments(bench.parent)
    common = {"bench": str(bench), "units": UNITS, "seed": 3, "runs": folder / "runs"}
    first = run_one(RunRequest("tumble_static", settings=CALIBRATED, **common))
    given = tuple(f"{place}={first / f'calibration_{place}.json'}" for place in "ab")
    return [
        run_one(RunRequest(sequence, settings=settings, calibrations=given, **common))
        for sequence, settings in (("verify_compensation", TUMBLED), ("verify_on_ramp", RAMPED))
    ]


def compared(run, compare):
    truth = json.loads((run / "truth.json").read_text("utf-8"))
    return {each.quantity: each for each in compare(truth, results_of(run), known_of(run))}


def test_the_tilt_in_a_tumble_is_within_its_uncertainty_with_the_skew_that_it_finds(runs):
    found = compared(runs[0], verified_pair.compare_tumble)
    assert set(found) == {f"tilt_of_two/{name}" for name in ("uncompensated", "verified", "left_largest", "skew")}
    assert max(abs(each.ratio) for each in found.values()) < 3.5
    assert all(each.held for each in found.values())
    assert abs(found["tilt_of_two/skew"].truth) > 10 * found["tilt_of_two/skew"].u, "it is worth being found"
    assert found["tilt_of_two/verified"].value < 0.3 * found["tilt_of_two/uncompensated"].value


def test_the_tilt_on_a_ramp_is_within_its_uncertainty_which_holds_the_skew_of_the_bench_file(runs):
    found = compared(runs[1], verified_pair.compare_ramp)
    assert len(found) == 5
    assert max(abs(each.ratio) for each in found.values()) < 3.5
    assert all(each.held for each in found.values())
    assert found["tilt_of_two/left_largest"].u == pytest.approx(0.0859, rel=0.05), "1.5 mrad"


def test_results_of_a_pair_are_those_of_its_first_unit_and_in_its_report(runs):
    for run in runs:
        first, second = ({each["quantity"] for each in results_of(run)["findings"] if each["uut"] == uut}
                         for uut in ("UA", "UB"))  # fmt: skip
        assert first - second == {quantity for quantity in first if quantity.startswith("tilt_of_two/")} != set()
        assert "tilt of two: verified" in (run / "report.html").read_text("utf-8")


def test_units_that_are_exchanged_in_the_truth_are_seen(runs):
    """The truth of the second in place of the first is far off what was found."""
    truth, known = json.loads((runs[0] / "truth.json").read_text("utf-8")), known_of(runs[0])
    exchanged = {**truth, "units": {"a": truth["units"]["b"], "b": truth["units"]["a"]}}
    swapped = {"a": "b", "b": "a"}
    exchanged["dwells"] = {
        key.replace("/a@", "/?@").replace("/b@", "/a@").replace("/?@", "/b@"): dwell
        for key, dwell in truth["dwells"].items()
    }
    found = verified_pair.compare_tumble(exchanged, results_of(runs[0]), {p: known[o] for p, o in swapped.items()})
    assert max(abs(each.ratio) for each in found) > 20
