"""An inertial unit on a rate table through all wires, against the truth of each of its sensors (equations 5.10)."""

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from bench.app.request import RunRequest
from bench.methods.rate_table.method import ACCELEROMETER_RESPONSE, GYRO_RANGE
from bench.methods.rate_table.reduction.range import reduce_gyro
from bench.methods.rate_table.reduction.response import reduce_accelerometer
from bench.metrology.acquisition import Mount
from bench.reduce.stored_run import open_run
from campaigns.truth.campaign import results_of, run_one
from campaigns.truth.table_imu import compare_table_imu, prepared

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
WORTH = {  # a standard uncertainty that is worth stating, at most
    "rest_rate": 1e-4, "rate_error/relative": 4e-6, "rest_output": 3e-5, "radius": 5e-4,
    "acceleration_error/relative": 1e-4, "gain": 2e-3, "phase": 3.0, "bandwidth": 0.5, "phase_at_bandwidth": 2.0,
    "lever_arm/x": 5e-4, "lever_arm/y": 5e-4,
}  # fmt: skip
SHORTER = (
    "mountings=[z_up, x_up]", "warm_up=25 min", "rates=[100 °/s, 200 °/s, 300 °/s, 400 °/s]", "rest=4 s",
    "rate_record=4 s", "swing_record=3 s", "lever_record=20 s",
    "frequencies=[10.2 Hz, 50.2 Hz, 57.2 Hz, 62.2 Hz, 70.2 Hz, 78.2 Hz, 84.2 Hz]",
)  # fmt: skip
Y_UP = Mount("y_up", roll_deg=90.0)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run in two mountings, of a unit whose scale factors are negative, as bench file and sequence state."""
    folder = tmp_path_factory.mktemp("table_imu")
    bench, sequence = prepared(folder / "config", "negative scale")
    return run_one(RunRequest(str(sequence), bench=str(bench), seed=7, settings=SHORTER, runs=folder / "runs"))


def test_errors_of_all_sensors_stay_within_their_uncertainties(run):
    found = compare_table_imu(run)
    ratios = np.array([each.ratio for each in found])
    assert len(found) > 150
    assert np.max(np.abs(ratios)) < 4
    assert 0.5 < np.sqrt(np.mean(ratios**2)) < 1.5
    assert {each.quantity: each.u for each in found if each.u > WORTH.get(each.quantity, np.inf)} == {}


def test_one_report_has_every_sensor_in_its_mountings(run):
    results, page = results_of(run), (run / "report.html").read_text("utf-8")
    sensors = {(each["at"]["mount"], each["at"]["sensor"]) for each in results["findings"]}
    in_z_up = {("z_up", name) for name in ("gyro_z", "acc_x", "acc_y")}
    assert sensors == in_z_up | {("x_up", name) for name in ("gyro_x", "acc_y", "acc_z")}
    assert results["verdict"] == "PASS"
    assert [flag for unit in results["units"] for flag in unit["flags"]] == []
    for mount, sensor in sensors:
        assert f"{sensor}, {mount} – Errors over the range" in page
        assert f"{sensor}, {mount} – Frequency response" in page


def test_gyros_and_accelerometers_have_the_same_acquisitions(run):
    steps = {}
    for each in results_of(run)["findings"]:
        if each["quantity"] in ("gain", "rest_rate", "rest_output"):
            kind = each["at"]["sensor"].partition("_")[0]
            steps.setdefault((each["at"]["mount"], kind), set()).update(each["steps"])
    for mount in ("z_up", "x_up"):
        assert steps[mount, "gyro"] == steps[mount, "acc"]
        assert len(steps[mount, "gyro"]) == 8 + 7


def test_the_calibration_has_each_sensor_once(run):
    channels = [each["channel"] for each in json.loads((run / "calibration_a.json").read_text("utf-8"))["channels"]]
    assert len(channels) == len(set(channels))
    assert {"gyro_z", "gyro_x", "acc_y", "gyro_z@response", "acc_z@response"} <= set(channels)


def test_another_axis_up_than_said_is_noticed(run):
    """The records of x up, as if the sequence had asked for y up."""
    with open_run(run) as stored:
        data = stored.data("range")
    said = tuple(replace(each, mount=Y_UP) for each in data.acquisitions if each.mount.name == "x_up")
    settings = {"scale": "-4000 pulse/°", "full_scale": "400 °/s", "clip": "420 °/s"}
    (found,) = reduce_gyro(replace(data, acquisitions=said), GYRO_RANGE.settings.model_validate(settings).model_dump())
    assert "mounting_unlike_sequence" in [flag.code for flag in found.flags]
    assert found.verdict == "INCOMPLETE"


def test_accelerometers_from_another_swing_than_the_encoder_are_noticed(run):
    """Each swing has the accelerometers of the one before it."""
    with open_run(run) as stored:
        data = stored.data("sweep")
    swings = [each for each in data.acquisitions if each.mount.name == "z_up"]
    mixed = tuple(
        replace(each, counts={**each.counts, **{name: before.counts[name] for name in ("ax", "ay", "az")}})
        for before, each in pairwise(swings)
    )
    settings = {"scale": "-11300 pulse/s/g"}
    chosen = ACCELEROMETER_RESPONSE.settings.model_validate(settings).model_dump()
    (found,) = reduce_accelerometer(replace(data, acquisitions=mixed), chosen)
    assert [flag.code for flag in found.flags].count("not_one_swing") == len(mixed)
    assert found.verdict == "INCOMPLETE"
    assert [each for each in found.findings if each.quantity == "gain"] == []


def test_a_unit_that_sends_codes_is_measured_with_the_encoder_latched_with_its_samples(tmp_path):
    bench, sequence = prepared(tmp_path / "config", "as shipped", name="table_imu_telemetry")
    settings = ("mountings=[x_up]", *SHORTER[1:])
    run = run_one(RunRequest(str(sequence), bench=str(bench), seed=5, settings=settings, runs=tmp_path / "runs"))
    results, found = results_of(run), compare_table_imu(run)
    assert results["verdict"] == "PASS"
    assert [flag for unit in results["units"] for flag in unit["flags"]] == []
    assert {each["at"]["sensor"] for each in results["findings"]} == {"gyro_x", "acc_y", "acc_z"}
    ratios = np.array([each.ratio for each in found])
    assert len(found) > 70
    assert np.max(np.abs(ratios)) < 4
    assert 0.4 < np.sqrt(np.mean(ratios**2)) < 1.5
    units = {channel["output"] for channel in json.loads((run / "calibration_a.json").read_text("utf-8"))["channels"]}
    assert units == {"code"}
