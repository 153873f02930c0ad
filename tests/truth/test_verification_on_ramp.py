"""A calibration verified by a new ramp of the same unit, through all wires, against the truth of the unit."""

import json
from pathlib import Path

import pytest

from bench.app.request import prepare
from bench.errors import InputError
from campaigns.truth.campaign import results_of, run_one
from campaigns.truth.ramp import SHORT, quick_request
from campaigns.truth.verified import compare_ramp, known_of

NARROWER = ("low=12 °C", "high=38 °C", "ramp_rate=1 °C/min", "warm_up=0 s")


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """The request of a ramp with its run, which releases a calibration."""
    request = quick_request(tmp_path_factory.mktemp("ramps"), 1)
    return request, run_one(request)


def of(calibrated, **changed):
    request, run = calibrated
    given = str(run / "calibration_a.json")
    return request._replace(sequence="verify_on_ramp", settings=NARROWER, seed=2, calibrations=(given,))._replace(
        **changed
    )


@pytest.fixture(scope="module")
def verified(calibrated):
    return run_one(of(calibrated))


def test_errors_of_what_is_left_stay_within_their_uncertainties(verified):
    truth, results = json.loads((verified / "truth.json").read_text("utf-8")), results_of(verified)
    comparisons = compare_ramp(truth, results, known_of(verified))
    assert len(comparisons) == len(results["findings"]) == 7
    assert max(abs(each.ratio) for each in comparisons) < 3.5
    assert all(each.held for each in comparisons)


def test_both_models_are_side_by_side_and_judged(verified):
    found = {each["quantity"]: each for each in results_of(verified)["findings"]}
    for quantity in ("K0/left_largest", "K0/left_largest_dynamic", "tilt/verified", "tilt/verified_dynamic"):
        assert found[quantity]["verdict"] == "PASS"
        assert found[quantity]["u"] > 0
    page = (verified / "report.html").read_text("utf-8")
    for words in ("Bias that the calibration leaves on the ramps", ">dynamic<", ">static<", "cycle 1, falling"):
        assert words in page


def test_a_calibration_of_another_unit_is_refused(calibrated):
    with pytest.raises(InputError, match="is the calibration of unit SIM-A, but the unit in place 'a' is OTHER"):
        prepare(of(calibrated, units=("a=OTHER",)))


def test_a_ramp_beyond_the_calibration_is_refused_and_its_own_is_not(calibrated):
    prepare(of(calibrated, settings=SHORT))
    with pytest.raises(
        InputError, match=r"on the ramp from -20 °C to 35 °C the unit in place 'a' goes from .* is valid"
    ):
        prepare(of(calibrated, settings=("low=-20 °C", "high=35 °C")))


def test_the_released_file_compensates_with_the_rate(calibrated, tmp_path):
    from bench.offline.calibration_file import compensated, read_calibration

    known = read_calibration(Path(of(calibrated).calibrations[0]))
    rate = known.compensations()["x"].dynamic.rate.value
    data = tmp_path / "data.csv"
    data.write_text("T_C,output,dT_dt_C_per_min\n25,200,0\n25,200,2\n25,200,\n25,200,9\n", "utf-8")
    still, moving, unknown, fast = (row.split(",")[3:] for row in compensated(known, data, "hold").splitlines()[1:])
    assert float(still[0]) - float(moving[0]) == pytest.approx(2 * rate, rel=1e-9)
    assert (unknown[0], moving[1], fast[1]) == ("", "0", "1")
    data.write_text("T_C,output\n25,200\n", "utf-8")
    (static,) = (row.split(",")[2:] for row in compensated(known, data, "hold").splitlines()[1:])
    assert abs(float(static[0]) - float(still[0])) < 1e-4
