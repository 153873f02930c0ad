"""Calibration files: written by a run, read again, and used on data of the unit."""

from __future__ import annotations

import csv
import io
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from bench.errors import InputError, StoreError
from bench.metrology.calibration.force_terms import ForceTerms
from bench.metrology.calibration.linearity import Linearity
from bench.metrology.calibration.response import ResponseCompensation
from bench.metrology.calibration.second_order import NAMES, second_order
from bench.metrology.calibration.temperature import Compensation
from bench.metrology.results.curves import Constant, KnotModel, TemperatureModel
from bench.offline.calibration_file import compensated, read_calibration

POLYNOMIAL = {
    "unit": "pulse/s/g", "centre": 20.0, "scale": 50.0, "coefficients": [11300.0, -30.0, 2.0], "valid_c": [-30, 70],
}  # fmt: skip
KNOTS = {"unit": "pulse/s", "knots_c": [-40, 0, 60], "values": [10.0, 2.0, 5.0]}
CHANNEL = {"channel": "x", "output": "pulse/s", "value": "g", "scale": POLYNOMIAL, "offset": KNOTS}
GOOD = {"schema": "itb-calibration/1", "uut": "QF-7", "verdict": "PASS", "simulated": False, "channels": [CHANNEL]}


def calibration(folder, **changes):
    path = folder / "cal.json"
    path.write_text(json.dumps({**GOOD, **changes}), "utf-8")
    return read_calibration(path)


def rows(folder, data, known, beyond="hold"):
    path = folder / "data.csv"
    path.write_text(data, "utf-8")
    return list(csv.DictReader(io.StringIO(compensated(known, path, beyond))))


def test_a_value_is_the_output_less_the_offset_over_the_scale_less_the_bias(tmp_path):
    known = calibration(tmp_path, channels=[{**CHANNEL, "bias": {"value": 0.25, "unit": "g"}}])
    (row,) = rows(tmp_path, "T_C,output\n45,5640.0\n", known)
    offset, scale = 2.0 + 3.0 * 45 / 60, 11300 - 30 * 0.5 + 2 * 0.25
    assert float(row["value"]) == pytest.approx((5640.0 - offset) / scale - 0.25, rel=1e-14)
    assert row["extrapolated"] == "0"


def test_beyond_what_all_its_curves_are_known_at_the_end_values_hold_or_nothing_is_told(tmp_path):
    known = calibration(tmp_path)
    data = "T_C,output\n-35,11000\n-30,11000\n60,11000\n65,11000\n"
    held, rejected = rows(tmp_path, data, known), rows(tmp_path, data, known, "reject")
    assert [row["extrapolated"] for row in held] == ["1", "0", "0", "1"]
    assert [held[0]["value"], held[3]["value"]] == [held[1]["value"], held[2]["value"]]
    assert [row["value"] for row in rejected] == ["", held[1]["value"], held[2]["value"], ""]


def test_other_columns_rows_and_their_order_stay_as_they_are(tmp_path):
    data = 'when,output,T_C,note\n3,11000,20,"a, b"\n1,,20,\n2,11000,,c\n'
    found = rows(tmp_path, data, calibration(tmp_path))
    assert [(row["when"], row["note"]) for row in found] == [("3", "a, b"), ("1", ""), ("2", "c")]
    assert [row["value"] != "" for row in found] == [True, False, False]


def test_of_several_channels_each_row_says_which(tmp_path):
    other = {**CHANNEL, "channel": "y", "scale": {"value": 2.0, "unit": "pulse/s/g"}, "offset": None}
    known = calibration(tmp_path, channels=[CHANNEL, other])
    found = rows(tmp_path, "channel,T_C,output\ny,20,3\nx,20,3\n", known)
    assert float(found[0]["value"]) == 1.5
    assert float(found[1]["value"]) == pytest.approx((3 - 3.0) / 11300)
    with pytest.raises(InputError, match=r"a row has no channel; the calibration has x, y"):
        rows(tmp_path, "T_C,output\n20,3\n", known)
    with pytest.raises(InputError, match=r"there is no channel 'z'.*the calibration has x, y"):
        rows(tmp_path, "channel,T_C,output\nz,20,3\n", known)


def test_what_a_program_writes_it_reads_again(tmp_path):
    model = TemperatureModel(
        "id", "QF-7", "K1", "pulse/s/g", 20.0, 50.0, (11300.0, -30.0), dwells_used=2, valid_c=(-30.0, 70.0),
    )  # fmt: skip
    knots = KnotModel("id", "QF-7", "K0", "pulse/s", (-40.0, 60.0), (1.0, 2.0), (0.1, 0.1))
    written = Compensation("x", "pulse/s", "g", model, knots, Constant(1e-3, "g", 1e-6))
    read = calibration(tmp_path, channels=[json.loads(json.dumps(written.to_json()))]).compensations()["x"]
    output, temperature_c = np.array([1.0, 11000.0, -5.0]), np.array([-20.0, 20.0, 69.0])
    assert read.apply(output, temperature_c)[0].tolist() == written.apply(output, temperature_c)[0].tolist()
    assert read.valid_c == written.valid_c == (-30.0, 60.0)


def test_force_terms_are_read_as_they_were_written(tmp_path):
    curve = TemperatureModel("", "", "", "pulse/s/g", 20.0, 1.0, (1e4, -0.1), (0.2, 1e-3), valid_c=(0.0, 40.0))
    knots = KnotModel("", "", "", "pulse/s", (0.0, 40.0), (1.0, 2.0), (0.1, 0.2))
    terms = ForceTerms(
        Constant(2e-5, "g/g²", 1e-6),
        (-1.0, 1.0),
        {"y": Constant(1e-3, "rad", 1e-5)},
        ((1.0, 0.5), (0.5, 1.0)),
        3e-6,
        1e-6,
    )
    written = Compensation("x", "pulse/s", "g", curve, knots, Constant(1e-3, "g", 1e-6), force=terms)
    read = of_one(tmp_path, written).compensations()["x"]
    assert read.force == terms
    assert (read.scale.u, read.offset.u, read.bias.u) == (curve.u, knots.u, 1e-6)


def test_a_row_without_a_channel_is_of_the_only_rate_beside_one_in_g(tmp_path):
    rate = {**CHANNEL, "channel": "x@up_1g", "value": "pulse/s", "scale": {"value": 2.0, "unit": "1"}, "offset": None}
    known = calibration(tmp_path, channels=[rate, CHANNEL])
    found = rows(tmp_path, "T_C,output,channel\n20,3,\n20,11300,x\n", known)
    assert float(found[0]["value"]) == 1.5
    assert float(found[1]["value"]) == pytest.approx((11300 - 3.0) / 11300)


def of_one(folder, known):
    return calibration(folder, channels=[json.loads(json.dumps(known.to_json()))])


def test_a_curve_over_the_range_needs_no_temperature(tmp_path):
    curve = Linearity(
        {"scale_error": 1e-3, "cubic": 2e-3}, {"scale_error": 1e-5, "cubic": 1e-5}, (), 400.0, (-400, 400)
    )
    known = Compensation("x", "pulse/s", "°/s", Constant(100.0, "pulse/°"), Constant(50.0, "pulse/s"), linearity=curve)
    reading = 50 + 100 * 200 * (1 + 1e-3 + 2e-3 / 4)
    found = rows(tmp_path, f"output\n{reading}\n50000\n", of_one(tmp_path, known))
    assert float(found[0]["value"]) == pytest.approx(200, rel=1e-12)
    assert [row["extrapolated"] for row in found] == ["0", "1"]
    rejected = rows(tmp_path, f"output\n{reading}\n50000\n", of_one(tmp_path, known), "reject")
    assert [row["value"] for row in rejected] == [found[0]["value"], ""]


def test_a_response_turns_amplitude_and_phase_of_an_output_into_those_of_what_is_measured(tmp_path):
    constants = {name: Constant(value, "") for name, value in zip(NAMES, (1.01, 40.0, 0.6, 1e-3), strict=True)}
    known = ResponseCompensation("x", "pulse/s", "°/s", Constant(100.0, "pulse/°"), constants, (10.0, 60.0))
    response = second_order(np.array([30.0]), 1.01, 40.0, 0.6, 1e-3)[0]
    output, phase_deg = 100 * 5 * abs(response), 20 + np.degrees(np.angle(response))
    data = f"f_Hz,phase_deg,output\n30,{phase_deg},{output}\n70,,100\n,1,2\n"
    inside, beyond, missing = rows(tmp_path, data, of_one(tmp_path, known))
    assert float(inside["value"]) == pytest.approx(5, rel=1e-12)
    assert float(inside["value_phase_deg"]) == pytest.approx(20, abs=1e-9)
    assert (beyond["extrapolated"], beyond["value_phase_deg"], missing["value"]) == ("1", "", "")
    (plain,) = rows(tmp_path, f"f_Hz,output\n30,{output}\n", of_one(tmp_path, known))
    assert "value_phase_deg" not in plain
    with pytest.raises(InputError, match="no column 'f_Hz'"):
        rows(tmp_path, "T_C,output\n20,3\n", of_one(tmp_path, known))


def test_a_response_of_negative_scale_factor_has_a_phase_of_its_own():
    constants = {name: Constant(value, "") for name, value in zip(NAMES, (1.01, 40.0, 0.6, 1e-3), strict=True)}
    known = ResponseCompensation("x", "pulse/s", "°/s", Constant(-100.0, "pulse/°"), constants, (10.0, 60.0))
    of_output = -100 * second_order(np.array([30.0]), 1.01, 40.0, 0.6, 1e-3)
    size, phase_deg, _ = known.apply(5 * np.abs(of_output), 20 + np.degrees(np.angle(of_output)), np.array([30.0]))
    assert size == pytest.approx([5.0])
    assert phase_deg == pytest.approx([20.0])


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"schema": "itb-results/1"}, "cal.json: schema: is 'itb-results/1', expected 'itb-calibration/1'"),
        ({"channels": []}, "cal.json: channels: "),
        ({"channels": [{**CHANNEL, "scale": {**POLYNOMIAL, "coefficients": ["a"]}}]}, "coefficients.0: is 'a'"),
        ({"channels": [{**CHANNEL, "scale": {"unit": "g"}}]}, "scale.constant.value: is missing"),
    ],
)
def test_a_file_that_is_no_calibration_is_refused_in_words(tmp_path, changes, problem):
    with pytest.raises(InputError) as refused:
        calibration(tmp_path, **changes)
    assert problem in str(refused.value)


def test_a_column_that_would_be_written_over_is_refused(tmp_path):
    with pytest.raises(InputError, match="has a column 'value' already; rename it"):
        rows(tmp_path, "T_C,output,value\n20,3,4\n", calibration(tmp_path))


def test_whoever_uses_it_is_warned_of_simulation_and_of_a_verdict(tmp_path):
    assert calibration(tmp_path).warnings == []
    simulated, failed = calibration(tmp_path, simulated=True, verdict="FAIL").warnings
    assert "simulated" in simulated
    assert "FAIL" in failed


@pytest.mark.lengthy
def test_a_run_writes_one_that_gives_back_the_gravity_it_was_made_in(tmp_path, tumble_run):
    result = tumble_run
    (path,) = result.path.glob("calibration_*.json")
    assert result.results is not None
    manifest = json.loads((result.path / "manifest.json").read_text("utf-8"))
    assert path.name in manifest["hashes"]
    scale = next(model for model in result.results.units[0].models if model.quantity == "K1")
    assert isinstance(scale, TemperatureModel)
    warm_c = sum(scale.valid_c) / 2
    (row,) = rows(tmp_path, f"T_C,output\n{warm_c},{scale.coefficients[0] * 1.001}\n", read_calibration(path))
    assert float(row["value"]) == pytest.approx(1.0, abs=0.01)


@pytest.fixture
def finished(tumble_run):
    """The directory of a run that has written a calibration; not to be changed."""
    return tumble_run.path


@pytest.mark.lengthy
def test_a_calibration_that_was_edited_in_its_run_is_refused(tmp_path, finished):
    path = Path(shutil.copytree(finished, tmp_path / finished.name)) / "calibration_a.json"
    assert read_calibration(path).uut == "QF-0001"
    path.write_text(path.read_text("utf-8").replace('"QF-0001"', '"QF-8"'), "utf-8")
    with pytest.raises(StoreError, match=r"calibration_a\.json: has changed since it was written; 'bench runs verify"):
        read_calibration(path)


@pytest.mark.parametrize(
    "edit",
    [
        lambda content: content["channels"][0]["scale"]["coefficients"].reverse(),
        lambda content: content["channels"][0]["scale"].update(valid_c=[-100.0, 100.0]),
        lambda content: content.update(uut="QF-8"),
        lambda content: content.update(verdict="FAIL"),
        lambda content: content.update(gravity_mps2=9.80665),
        lambda content: content.update(digest=None),
    ],
)
def test_an_edited_copy_of_what_a_run_has_written_is_refused(tmp_path, finished, edit):
    copy = tmp_path / "copy.json"
    content = json.loads((finished / "calibration_a.json").read_text("utf-8"))
    copy.write_text(json.dumps(dict(sorted(content.items()))), "utf-8")  # another order and other blanks are no edit
    assert read_calibration(copy).uut == "QF-0001"
    edit(content)
    copy.write_text(json.dumps(content), "utf-8")
    with pytest.raises(InputError, match=r"copy\.json: was edited after a run had written it: .* the run 2"):
        read_calibration(copy)


@pytest.mark.parametrize("key", ["coefficients", "powers_of_T", "centre", "scale"])
def test_a_copy_whose_curve_was_edited_is_refused(tmp_path, key):
    at_t = np.polynomial.Polynomial(POLYNOMIAL["coefficients"])(np.polynomial.Polynomial([-20 / 50, 1 / 50]))
    curve = {**POLYNOMIAL, "powers_of_T": at_t.coef.tolist()}
    calibration(tmp_path, channels=[{**CHANNEL, "scale": curve}])
    before = curve[key]
    edited = {**curve, key: [before[0] * 1.000001, *before[1:]] if isinstance(before, list) else before * 1.01}
    with pytest.raises(InputError, match="coefficients and powers_of_T are not the same curve: the file was edited"):
        calibration(tmp_path, channels=[{**CHANNEL, "scale": edited}])


@pytest.mark.parametrize("value", [1.0, None, [], "x", True])
def test_a_curve_that_is_no_mapping_is_refused_in_words(tmp_path, value):
    with pytest.raises(InputError, match="scale"):
        calibration(tmp_path, channels=[{**CHANNEL, "scale": value}])
