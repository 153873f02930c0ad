"""A thermometer at each sensor, a temperature circuit, and regressed outputs against the truth.

More by `python -m campaigns.truth.imu_nominal`.
"""

import csv
import json
from unittest import mock

import numpy as np
import pytest

from bench.app.request import RunRequest
from bench.config.bench import load_bench
from bench.metrology.run_data import UnitUnderTest
from bench.reduce.stored_run import open_run
from campaigns.truth import judge
from campaigns.truth.campaign import full_bench, results_of
from campaigns.truth.imu import QUANTITIES, compare_imu, draw_scale_factors
from campaigns.truth.imu_nominal import BENCH, UNIT, both
from campaigns.truth.replay import replayed, template_of
from tests.support.commands import invoked

SEED, SEEDS = 3, range(1, 21)  # of the run through all wires; of those at the level of records
SHORT = (
    "offsets=[0 °C, 25 °C, 0 °C, -25 °C]", "warm_up=30 min", "soak=30 min", "dwell=10 s", "settle=1 s",
    "rate_dwell=3 s", "ramp_rate=3 °C/min", "rates=[20 °/s, -20 °/s, 30 °/s, -30 °/s, 25 °/s, -25 °/s]",
)  # fmt: skip
OWN = {
    "acc_x": "ax_temperature", "acc_y": "ay_temperature", "acc_z": "az_temperature",
    "gyro_x": "wx_temperature", "gyro_y": "wy_temperature", "gyro_z": "wz_temperature",
}  # fmt: skip


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    file = full_bench(tmp_path_factory.mktemp("bench"), BENCH)
    draw_scale_factors(file.parent, UNIT)
    return file


@pytest.fixture(scope="module")
def template(tmp_path_factory, bench):
    folder = tmp_path_factory.mktemp("imu")
    return template_of(RunRequest("imu_24_position", bench=str(bench), seed=SEED, settings=SHORT, runs=folder))


@pytest.fixture(scope="module")
def run(template):
    return template.folder


@pytest.fixture(scope="module")
def calibration(run):
    content = json.loads((run / "calibration_a.json").read_text("utf-8"))
    return {channel["channel"]: channel for channel in content["channels"]}


def test_every_finding_is_at_the_temperature_of_its_own_sensor(run):
    comparisons = compare_imu(run)
    assert {each.quantity for each in comparisons} == set(QUANTITIES)
    assert max(abs(each.ratio) for each in comparisons) < 4
    truth = json.loads((run / "truth.json").read_text("utf-8"))
    found = [each for each in results_of(run)["findings"] if each["quantity"] in ("K0", "D0")]
    assert len(found) == 24
    for each in found:
        number = "xyz".index(each["at"]["axis"]) + (3 if each["quantity"] == "D0" else 0)
        true_c = np.mean([truth["windows"][f"imu/a@{step}"]["sensors_c"][number] for step in each["steps"]])
        assert abs(each["at"]["temperature_c"] - true_c) < 4 * each["at"]["temperature_u_c"]
    at_ends = [each["at"]["temperature_c"] for each in found if each["at"]["temperature_set_c"] == 45]
    assert np.ptp(at_ends) > 1


def test_errors_follow_the_uncertainties(template, bench):
    loaded = load_bench(bench).bench
    runs = [replayed(template, loaded, seed) for seed in SEEDS]
    found = judge.by_quantity([each for run in runs for each in both(run.truth, run.results)])
    assert {*QUANTITIES, "N", "W", "circuit/nominal", "circuit/deviation"} == found.keys()
    assert min(len(each) for each in found.values()) == len(SEEDS)
    assert list(judge.beyond(found, "full")) == []
    assert max(abs(each.ratio) for comparisons in found.values() for each in comparisons) < 5


def _exchanged(unit, channel):
    return OWN[{"acc_x": "acc_y", "acc_y": "acc_x"}.get(channel, channel)]


def _common(_unit, channel):
    return "gyro_temperature" if channel.startswith("gyro") else "unit_temperature"


@pytest.mark.parametrize("plant", [_exchanged, _common])
def test_another_thermometer_than_its_own_gives_other_constants(run, plant):
    """Exchanged thermometers are seen by the truth alone: within a run any smooth temperature makes a table."""
    with mock.patch.object(UnitUnderTest, "thermometer", plant), open_run(run) as stored:
        results = stored.evaluate().to_json()
    found = [each for each in compare_imu(run, results) if each.quantity == "K1"]
    assert max(abs(each.ratio) for each in found) > 6
    assert results["verdict"] == "PASS"
    assert results["units"]
    assert not any("thermometer" in flag for unit in results["units"] for flag in unit["flags"])


def test_the_files_and_the_report_name_the_thermometer_of_each_sensor(run, calibration):
    assert {name: channel["thermometer"] for name, channel in calibration.items()} == OWN
    page = (run / "report.html").read_text("utf-8")
    assert "Outputs regressed to the nominal temperature" in page
    assert all(page.count(name) > 1 for name in OWN.values())


def test_what_is_left_of_an_output_is_a_small_part_of_its_change(run):
    found = {(each["quantity"], each["at"]["axis"]): each for each in results_of(run)["findings"]
             if each["quantity"][:2] in ("N/", "W/")}  # fmt: skip
    assert len(found) == 12
    for symbol in "NW":
        for axis in "xyz":
            change, left = found[f"{symbol}/change", axis], found[f"{symbol}/left", axis]
            assert (change["unit"], left["unit"]) == ("pulse/s", "pulse/s")
            assert 0 <= left["value"] < change["value"] / 10


def test_an_acquisition_is_regressed_by_the_thermometers_of_its_run(run, calibration, tmp_path):
    """At 1 g and 45 °C the pulses are those at the nominal temperature, in the mean of a window."""
    out, step = tmp_path / "nominal.csv", "steps/temperature=45/attitude=Ax1/acquire"
    words = ["compensate", run / "calibration_a.json", run, "--to", "nominal", "--step", step, "--out", out]
    assert invoked(*map(str, words)).returncode == 0
    rows = list(csv.DictReader(out.read_text("utf-8").splitlines()))[1:]
    found = np.mean([float(row["acc_x_pps"]) for row in rows])
    own = calibration["acc_x"]
    expected, raw = (
        sum(np.interp(at_c, own[name]["knots_c"], own[name]["values"]) for name in ("offset", "scale"))
        for at_c in (own["nominal"]["at_c"], own["scale"]["knots_c"][-1])
    )
    assert abs(found - expected) < 0.3 < abs(raw - expected) / 10
