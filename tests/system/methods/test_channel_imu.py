"""The three channels of an inertial unit through every wire: cube, skew fixture, source; and what people do wrong."""

from __future__ import annotations

import pytest

from bench.offline.calibration_file import read_calibration
from bench.report.flag_words import flag_in_words
from bench.store.reader import RunReader
from campaigns.truth.channel import compare_channel
from campaigns.truth.signs import differences
from tests.support.channel import FULL, SHORT, findings, ran
from tests.support.runs import read_json

pytestmark = pytest.mark.slow

LEVELS = ("up_1g", "skew", "src_1g", "src_12g")
SUPPLY = ("supply_voltage=28 V", "supply_limit=1 A")
X_UP = ("fixture=x_up", "axis=axis x", "watched=output.a.acc_x", "warm_up=30 min", *SUPPLY, *SHORT)
INTO_X = ("channel=acc_x", "watched=output.a.acc_x", "source_warm_up=0 s", "levels=[1 g]", *SUPPLY, *SHORT)


@pytest.fixture(scope="module")
def full(tmp_path_factory):
    settings = (*FULL, "basis=raw")
    return ran(tmp_path_factory.mktemp("full"), "channel_imu", settings, bench="channel_imu", seed=3, no_report=False)


def test_every_channel_has_all_levels_with_the_decision_on_either_basis(full):
    assert (full.outcome.how, full.problems, full.results.verdict) == ("completed", [], "PASS")
    found = findings(full)
    for axis in "xyz":
        assert {f"{axis}/rate@{level}" for level in LEVELS} <= found.keys()
        assert found[f"{axis}/rate@skew"]["at"]["level_g"] == pytest.approx(0.57735, abs=1e-5)
    raw, relative = (found[f"x/deviation/{basis}@src_12g"]["at"] for basis in ("raw", "normalised"))
    assert (raw["decision"], relative["decision"]) == ("keep", "keep"), "by the parameter basis"
    assert (raw["own_decision"], relative["own_decision"]) == ("keep", "share"), "a drift in proportion to the output"


def test_errors_stay_within_their_uncertainties(full):
    compared = compare_channel(full.path)
    assert len(compared) == 3 * (4 * 3 + 3 * 2 + 2)
    assert max(abs(each.ratio) for each in compared.values()) < 3.5


def test_the_record_says_which_axis_was_up_and_which_channel_the_source_fed(full):
    with RunReader(full.path) as reader:
        asked = [event.data for event in reader.events("step_ended") if event.step.endswith("prompt")]
    assert [each.get("mount") for each in asked] == ["x_up", "y_up", "z_up", "skew", None, None, None, None]
    assert [each.get("input_channel") for each in asked][4:] == ["acc_x", "acc_y", "acc_z", None]
    assert asked[5]["question"].endswith("plug the cable of the current source in instead of acc_y.")


def test_the_report_has_a_table_of_decisions_for_each_axis_and_the_ramps_by_their_names(full):
    page = (full.path / "report.html").read_text("utf-8")
    for axis in "xyz":
        assert f"axis {axis}: Whether the model of one level serves another" in page
        assert f"{axis} up_1g" in page
    assert page.count("Decision by relative slopes") == 3


def test_the_calibration_file_has_every_channel(full):
    (path,) = full.path.glob("calibration*.json")
    channels = {each.channel for each in read_calibration(path).channels}
    assert {"ax@up_1g", "ay@up_1g", "az@up_1g"} <= channels


def test_a_unit_of_the_other_sign_differs_in_its_sign_alone(full):
    assert list(differences(full.path)) == []


def test_codes_of_three_channels_on_the_skew_fixture_are_within_their_uncertainties(tmp_path):
    settings = ("watched=output.a.acc_x", "warm_up=30 min", *SUPPLY, *SHORT)
    result = ran(tmp_path, "channel_skew", settings, bench="channel_imu_telemetry", seed=3)
    assert (result.outcome.how, result.problems, result.results.verdict) == ("completed", [], "PASS")
    assert {findings(result)[f"{axis}/rate@skew"]["unit"] for axis in "xyz"} == {"code"}
    compared = compare_channel(result.path)
    assert len(compared) == 3 * 3
    assert max(abs(each.ratio) for each in compared.values()) < 3.5


# Mistakes of people


def words_of(result):
    return [flag_in_words(flag) for flag in result.results.units[0].flags]


def test_an_axis_that_is_not_up_ends_the_run_before_its_ramp_and_says_which_is(tmp_path):
    turned = {"setup/else/prompt": {"does": {"mount": "y_up"}, "by": "A. Hurry"}}
    result = ran(tmp_path, "channel_gravity", X_UP, bench="channel_imu", answers=turned)
    (problem,) = result.problems
    assert "output.a.acc_x is outside its limits" in problem
    assert "acc_x 0.0013 g, acc_y 0.9989 g" in problem
    assert result.results.verdict == "FAIL"


def test_axes_exchanged_in_a_set_up_are_flagged_and_their_data_not_used(tmp_path):
    turned = {"setup/else/prompt": {"does": {"mount": "y_up"}, "by": "A. Hurry"}}
    result = ran(tmp_path, "channel_gravity", (*X_UP, "least_input=0 g"), bench="channel_imu", answers=turned)
    assert result.outcome.how == "completed"
    assert result.results.verdict == "INCOMPLETE"
    assert "x/up_1g" in result.results.units[0].left_out
    assert result.results.units[0].findings == ()
    (words,) = [each for each in words_of(result) if "vertical" in each]
    assert "axis y was along the vertical, unlike in mount 'x_up': the accelerometers read x 0.00 g, y 1.00 g" in words


@pytest.mark.parametrize(
    ("channel", "said"),
    [("acc_y", "was in channel acc_y instead of acc_x"), ("gyro_x", "did not reach channel acc_x, nor another")],
)
def test_current_into_the_wrong_channel_is_flagged_and_ends_the_run_before_its_ramp(channel, said, tmp_path):
    plugged = {"setup/prompt": {"does": {"input": "source", "channel": channel}, "by": "A. Hurry"}}
    result = ran(tmp_path, "channel_source", INTO_X, bench="channel_imu", answers=plugged)
    assert result.results.verdict == "FAIL"
    assert "output.a.acc_x is outside its limits" in result.problems[0]
    assert "x/src_1g" in result.results.units[0].left_out
    assert [each for each in words_of(result) if said in each]


def test_a_channel_that_nothing_feeds_makes_the_unit_incomplete(tmp_path):
    result = ran(tmp_path, "channel_gravity", X_UP, bench="channel_imu")
    assert (result.outcome.how, result.results.verdict) == ("completed", "INCOMPLETE")
    assert {"y", "z"} <= set(result.results.units[0].left_out)
    assert {each["id"].split("/")[2] for each in read_json(result, "results.json")["findings"]} == {"x"}
