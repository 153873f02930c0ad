"""Calibrations that are given to a run: which are refused, and what a person is told of them."""

import json

import pytest

from bench.app.request import RunRequest, load_checked, prepare
from bench.errors import InputError
from tests.support.runs import ROOT

SHIPPED = ROOT / "config/uut/imu_calibration.json"


@pytest.fixture
def given(tmp_path):
    """A calibration file, its content changed."""

    def calibration(**changes):
        path = tmp_path / "cal.json"
        path.write_text(json.dumps({**json.loads(SHIPPED.read_text("utf-8")), **changes}), "utf-8")
        return str(path)

    return calibration


def request(*calibrations, sequence="imu_start_up", bench="imu", **options):
    return RunRequest(
        sequence, bench=str(ROOT / f"config/{bench}.yaml"), calibrations=calibrations, preset="quick", **options
    )


def problems(wanted):
    with pytest.raises(InputError) as caught:
        prepare(wanted)
    return caught.value.problems


def test_the_shipped_one_is_that_of_the_simulated_unit():
    prepared = prepare(request(str(SHIPPED)))
    assert prepared.warnings == ()
    assert prepared.released["a"].to_json()["uut"] == "SIM-A"
    assert prepare(request(f"a={SHIPPED}")).released == prepared.released


def test_without_one_a_check_passes_and_a_run_is_refused():
    assert load_checked(request()).warnings == ()
    (problem,) = problems(request())
    advice = "give it with --calibration a=FILE"
    assert f"unit SIM-A in place 'a' is checked against its released calibration; {advice}" in problem


def test_that_of_another_unit_is_refused(given):
    (problem,) = problems(request(given(uut="IMU-7")))
    assert problem.endswith(
        "cal.json: is the calibration of unit IMU-7, but the unit in place 'a' is SIM-A. Give the file of this unit, "
        "or its "
        "serial number with --uut a=SERIAL"
    )
    assert prepare(request(given(uut="IMU-7"), units=("a=IMU-7",))).serials == {"a": "IMU-7"}


@pytest.mark.parametrize(("temperature", "warm"), [("-18 °C", "-13 °C"), ("52 °C", "57 °C")])
def test_temperatures_that_it_is_not_known_at_are_refused_where_they_stand(temperature, warm):
    (problem,) = problems(request(str(SHIPPED), settings=(f"temperatures=[15 °C, {temperature}]",)))
    place, _, reported = problem.partition(": ")
    assert place.rsplit(":", 2)[0].endswith("imu_start_up.yaml")
    assert reported == (
        f"at {temperature} the unit in place 'a' goes from {temperature} to about {warm}, but its calibration "
        "imu_calibration.json is valid from -14.96 °C to 54.92 °C. Choose temperatures in this range, or calibrate "
        "the unit over a wider one"
    )


def test_temperatures_at_which_it_was_calibrated_are_told():
    (warning,) = load_checked(request(str(SHIPPED), settings=("temperatures=[10 °C]",))).warnings
    assert (warning.rule, warning.severity) == ("at-a-knot", "warning")
    assert "at 10 °C the unit in place 'a' reaches a temperature at which it was calibrated" in warning.text


def test_one_of_a_unit_that_did_not_pass_is_told(given):
    (warning,) = load_checked(request(given(verdict="FAIL"))).warnings
    assert "cal.json: the unit's verdict in that run is FAIL" in warning.text


@pytest.mark.parametrize(
    ("calibrations", "reported"),
    [
        (("none.json",), "none.json"),
        (("b=none.json",), "the bench has no place 'b'"),
        ((f"a={ROOT / 'config/imu.yaml'}",), "imu.yaml: line 1, column 1"),
    ],
)
def test_what_cannot_be_read_or_belongs_nowhere_is_told(calibrations, reported):
    assert any(reported in problem for problem in problems(request(*calibrations)))


def test_a_channel_that_it_lacks_is_told(given):
    channels = json.loads(SHIPPED.read_text("utf-8"))["channels"][:-1]
    (problem,) = problems(request(given(channels=channels)))
    assert problem.endswith("cal.json: has no channel gyro_z, which the unit in place 'a' has")


def test_a_sequence_that_needs_none_takes_none():
    (problem,) = problems(request(str(SHIPPED), sequence="imu_24_position"))
    assert problem == "--calibration: no method of imu_24_position.yaml uses a calibration"
