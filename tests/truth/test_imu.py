"""Calibrations of an inertial unit against the truth: a short run here, more by `python -m campaigns.truth.imu`."""

import dataclasses
import json
from unittest import mock

import numpy as np
import pytest

from bench.app.request import RunRequest
from bench.config.bench import load_bench
from bench.methods.imu.reduction import attitude_fit
from bench.methods.imu.reduction import windows as imu_windows
from bench.reduce.stored_run import open_run
from campaigns.truth import judge
from campaigns.truth.campaign import results_of
from campaigns.truth.imu import QUANTITIES, SHORT, bench_file, compare_imu, compared, draw_scale_factors, judged
from campaigns.truth.replay import replayed, template_of
from campaigns.truth.signs import differences
from tests.support.runs import read_json

SEED, SEEDS = 3, range(1, 21)  # of the run through all wires; of those at the level of records


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    draw_scale_factors(bench_file(folder, "imu", perfect=False).parent)
    return folder / "imu.yaml"


@pytest.fixture(scope="module")
def template(tmp_path_factory, bench):
    folder = tmp_path_factory.mktemp("imu")
    return template_of(RunRequest("imu_24_position", bench=str(bench), seed=SEED, settings=SHORT, runs=folder))


@pytest.fixture(scope="module")
def run(template):
    return template.folder


def reduced(run):
    with open_run(run) as stored:
        return stored.evaluate().to_json()


def test_every_finding_of_a_run_through_all_wires_is_within_its_uncertainty(run):
    comparisons = compare_imu(run)
    assert {each.quantity for each in comparisons} == set(QUANTITIES)
    assert max(abs(each.ratio) for each in comparisons) < 3


@pytest.fixture(scope="module")
def replays(template, bench):
    """Runs of other seeds at the level of records."""
    loaded = load_bench(bench).bench
    return {seed: replayed(template, loaded, seed) for seed in SEEDS}


def test_errors_follow_the_uncertainties(replays):
    """Held to the bars of the campaign, with half as many seeds."""
    comparisons = [each for run in replays.values() for each in compared(run.truth, run.results)]
    found = judge.by_quantity(judged(comparisons, "full"))
    assert found.keys() == set(QUANTITIES)
    assert min(len(each) for each in found.values()) >= 3 * len(SEEDS)
    assert list(judge.beyond(found, "full")) == []


def test_the_same_is_found_at_the_level_of_records(template, replays):
    """With the seed of the run through all wires it is the same unit on the same bench; only noise comes otherwise."""
    wires = {(each.quantity, each.dwell) for each in compare_imu(template.folder)}
    again = replays[SEED]
    comparisons = compared(again.truth, again.results)
    assert again.truth["imus"] == read_json(type("Run", (), {"path": template.folder}), "truth.json")["imus"]
    assert {(each.quantity, each.dwell) for each in comparisons} == wires
    assert max(abs(each.ratio) for each in comparisons) < 3


def test_uncertainties_are_worth_stating(run):
    most = {"K0": 3e-6, "K1": 0.15, "D0": 4e-5, "KG": 0.08, "misalignment": 30e-6, "gyro_misalignment": 40e-6}
    found = {(each.quantity, each.u) for each in compare_imu(run) if each.quantity in most}
    assert {quantity for quantity, _ in found} == most.keys()
    assert [(quantity, u) for quantity, u in found if u > most[quantity]] == []


def test_the_closure_is_what_biases_and_level_did_between_the_ends(run):
    found = {each["id"]: each for each in results_of(run)["findings"] if each["quantity"].endswith("/closure")}
    windows = json.loads((run / "truth.json").read_text("utf-8"))["windows"]
    for axis, letter in enumerate("xyz"):
        closure = found[f"imu/a/{letter}/K0/closure"]
        ends = [
            np.mean([
                windows[f"closure/a@{step}"]["accelerometers_g"][axis] + windows[f"closure/a@{step}"]["moving_g"][axis]
                for step in closure["steps"] if step.split("/")[1] == end
            ]) for end in ("opening", "closing")
        ]  # fmt: skip
        assert abs(closure["value"] - (ends[1] - ends[0])) < 4 * closure["u"]
    for direction in ("east", "north"):  # the base of the simulated table stays as it is
        closure = found[f"imu/a/{direction}/level/closure"]
        assert abs(closure["value"]) < 4 * closure["u"] < 30e-6


def _wrong_sense(turning):
    return dataclasses.replace(turning, rate_dps=-turning.rate_dps, command_dps=-turning.command_dps)


def test_a_planted_error_is_seen(run):
    """The wrong sense of rotation, and attitudes in which y is mirrored."""
    honest = imu_windows._turning
    senses = mock.patch.object(imu_windows, "_turning", lambda *of: (found := honest(*of)) and _wrong_sense(found))
    mirrored = mock.patch.object(attitude_fit, "SPECIFIC_FORCE_G", attitude_fit.SPECIFIC_FORCE_G * [1, -1, 1])
    for plant, quantity in ((senses, "KG"), (mirrored, "misalignment")):
        with plant:
            found = [each for each in compare_imu(run, reduced(run)) if each.quantity == quantity]
        assert max(abs(each.ratio) for each in found) > 10, quantity


def test_the_run_gives_tables_that_compensate(run):
    calibration = read_json(type("Run", (), {"path": run}), "calibration_a.json")
    channels = {channel["channel"]: channel for channel in calibration["channels"]}
    assert set(channels) == {f"{sensor}_{axis}" for sensor in ("acc", "gyro") for axis in "xyz"}
    assert len(channels["acc_x"]["scale"]["knots_c"]) == 2


def test_the_report_tells_it_in_words(run):
    page = (run / "report.html").read_text("utf-8")
    for words in ("Misalignment of the gyros", "without compensation", "K0 contains K2", "Course of the run"):
        assert words in page


def test_a_unit_of_the_other_sign_differs_in_its_sign_alone(run):
    assert list(differences(run)) == []
