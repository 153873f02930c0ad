"""A calibration verified by a new tumble: what is left, against the truth of the unit and the curves of the file."""

import json

import pytest

from bench.app.request import RunRequest, prepare
from bench.errors import InputError, StoreError
from bench.offline import calibration_file
from bench.reduce.stored_run import open_run
from campaigns.truth.campaign import full_bench, results_of, run_one

DWELLS = ("soak=30 min", "warm_up=40 min", "gate=10 s")
CALIBRATED = ("temperatures=[20 °C, 50 °C, 20 °C, -10 °C, 20 °C]", *DWELLS)
VERIFIED = ("temperatures=[20 °C, 35 °C, 20 °C, 5 °C]", *DWELLS)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A calibration of a unit, and its verification."""
    folder = tmp_path_factory.mktemp("verified")
    bench = str(full_bench(folder / "config"))
    common = {"bench": bench, "seed": 5, "runs": folder / "runs"}
    first = run_one(RunRequest("tumble_static", settings=CALIBRATED, **common))
    given = (str(first / "calibration_a.json"),)
    return first, run_one(RunRequest("verify_compensation", settings=VERIFIED, calibrations=given, **common))


def test_the_set_points_of_the_calibration_are_accepted_and_colder_ones_are_not(runs, tmp_path):
    given = (str(runs[0] / "calibration_a.json"),)
    bench = str(full_bench(tmp_path))
    same = RunRequest("verify_compensation", settings=CALIBRATED, bench=bench, calibrations=given)
    prepare(same)
    colder = ("temperatures=[20 °C, 50 °C, -12 °C]", *DWELLS)
    with pytest.raises(InputError, match=r"at -12 °C the unit in place 'a' is at about -7 °C, but its calibration"):
        prepare(same._replace(settings=colder))


def value(curve, at_c):
    """A curve of a calibration file at a temperature."""
    x = (at_c - curve["centre"]) / curve["scale"]
    return sum(each * x**power for power, each in enumerate(curve["coefficients"]))


def left(runs):
    """True bias and scale factor at each dwell that the file leaves, by path of the dwell."""
    calibrated, verified = runs
    (known,) = json.loads((calibrated / "calibration_a.json").read_text("utf-8"))["channels"]
    truth = json.loads((verified / "truth.json").read_text("utf-8"))
    for key, dwell in truth["dwells"].items():
        scale, bias = (value(known[name], dwell["temperature_c"]) for name in ("scale", "bias"))
        yield key.partition("@")[2], {
            "K0/left": dwell["K0"] * dwell["K1"] / scale - bias, "K1/left": dwell["K1"] / scale - 1,
        }  # fmt: skip


def test_what_is_left_is_what_the_unit_does_less_what_the_file_says(runs):
    true, found = dict(left(runs)), results_of(runs[1])["findings"]
    at_dwells = [each for each in found if each["quantity"] in ("K0/left", "K1/left")]
    assert len(at_dwells) == 2 * len(true) == 8
    for each in at_dwells:
        error = each["value"] - true[each["id"].partition("@")[2]][each["quantity"]]
        assert abs(error) < 3 * each["u"], each["id"]


def test_the_span_of_the_tilt_has_what_changes_from_dwell_to_dwell(runs):
    (span,) = (each for each in results_of(runs[1])["findings"] if each["quantity"] == "tilt/verified")
    of_span = {line["source"]: line["u"] for line in span["budget"]}
    assert of_span["unit_temperature: drift within the run"] > 0
    assert of_span["fixture: level: drift within the run, not stated, a fifth of its offset"] > 0


def test_the_largest_holds_the_largest_that_is_true(runs):
    found = {each["quantity"]: each for each in results_of(runs[1])["findings"]}
    for quantity in ("K0/left", "K1/left"):
        largest = max(abs(values[quantity]) for _, values in left(runs))
        interval = found[f"{quantity}_largest"]["interval"]
        assert interval["low"] <= largest <= interval["high"], quantity
    tilt = found["tilt/left_largest"]
    assert tilt["value"] == pytest.approx(found["K0/left_largest"]["value"] * 57.29578, rel=1e-4)


def test_the_tilt_of_the_run_that_found_the_model_is_named_as_in_sample(runs):
    in_sample, out = ({each["quantity"]: each for each in results_of(run)["findings"]} for run in runs)
    assert "in sample" in in_sample["tilt/compensated"]["name"]
    assert "in sample" not in out["tilt/verified"]["name"]


def test_the_calibration_that_a_run_itself_found_verifies_nothing(runs, monkeypatch):
    """Its copy says so: data to which a model was fitted are refused before anything is computed."""
    verified, honest = runs[1], calibration_file.read_calibration
    monkeypatch.setattr(
        calibration_file, "read_calibration", lambda path: honest(path).model_copy(update={"run": verified.name})
    )
    with open_run(verified) as run, pytest.raises(StoreError, match="to which a model was fitted cannot verify it"):
        run.evaluate()
