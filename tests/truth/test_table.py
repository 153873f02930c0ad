"""The tests on a rate table against the truth: each sequence once, short, on a full bench, through all the wires."""

import dataclasses
from unittest import mock

import numpy as np
import pytest

from bench.app.request import RunRequest
from bench.config.bench import load_bench
from bench.methods.rate_table.reduction import range_points as range_blocks
from bench.methods.rate_table.reduction.intake import table_samples
from bench.methods.rate_table.reduction.response_points import Remarks, gyro_point
from bench.offline.calibration_file import read_calibration
from bench.reduce.stored_run import open_run
from campaigns.truth.campaign import Comparison, results_of
from campaigns.truth.player import Player
from campaigns.truth.replay import replayed, template_of
from campaigns.truth.signs import differences
from campaigns.truth.table import (
    BENCHES,
    SHORT,
    check_held,
    compare_table,
    compared,
    one_a_run,
    problems_of,
    table_bench,
)  # fmt: skip

WORTH = {  # a standard uncertainty that is worth stating, at most
    "rest_rate": 1e-4, "rate_error/relative": 4e-5, "rest_output": 1e-5, "radius": 3e-4,
    "acceleration_error/relative": 3e-5, "gain": 2e-3, "phase": 2.0, "bandwidth": 0.15, "phase_at_bandwidth": 1.5,
    "lever_arm/x": 3e-4, "lever_arm/y": 5e-5,
}  # fmt: skip
SEED = 5
# A scale error is that at the temperature which it names, the mean of what a thermometer told: of equally warm units
# that is not the same through wires, which carry steps of 0.01 °C, and of records, which have none.
TOLD_C, SCALE_PER_C = 5e-3, 60e-6
TEMPLATES = {}


@pytest.fixture(scope="module")
def template_of_run(tmp_path_factory):
    """The bench file of a sequence, and what a run of it through all wires did, made once."""

    def template(sequence):
        if sequence not in TEMPLATES:
            folder = tmp_path_factory.mktemp(sequence)
            bench = table_bench(folder / "config", BENCHES[sequence])
            request = RunRequest(sequence, bench=str(bench), seed=SEED, settings=SHORT[sequence], runs=folder / "runs")
            TEMPLATES[sequence] = bench, template_of(request)
        return TEMPLATES[sequence]

    yield template
    TEMPLATES.clear()


@pytest.fixture(scope="module")
def run_of(template_of_run):
    """A run of a sequence through all wires, made once."""
    return lambda sequence: template_of_run(sequence)[1].folder


@pytest.mark.parametrize("sequence", BENCHES)
def test_errors_stay_within_their_uncertainties(run_of, sequence):
    check_held(run_of(sequence), WORTH, at_least=8)


def test_the_equation_of_a_gyro_is_that_of_its_file(run_of):
    (model,) = results_of(run_of("gyro_response"))["models"]
    found = {name: each["value"] for name, each in model["constants"].items()}
    assert found["damping"] == pytest.approx(0.65, abs=2e-3)
    assert found["f0"] == pytest.approx(55.54, abs=0.05)  # whose gain has fallen to 1/√2 at 60 Hz
    assert abs(found["delay"] - 2e-3) < 3 * model["constants"]["delay"]["u"]


def test_the_curve_of_a_gyro_is_that_of_its_file(run_of):
    findings = results_of(run_of("gyro_range"))["findings"]
    found = {each["quantity"]: each for each in findings if "point" not in each["at"]}
    for quantity, true in (("asymmetry", 20e-6), ("nonlinearity/cubic", 1e-10 * 400**2)):
        assert abs(found[quantity]["value"] - true) < 4 * found[quantity]["u"] < 40e-6, quantity


@pytest.mark.parametrize(("sequence", "what"), [("gyro_range", "rate_dps"), ("accel_range", "acceleration_g")])
def test_the_calibration_of_a_range_takes_the_errors_back(run_of, sequence, what):
    (known,) = read_calibration(run_of(sequence) / "calibration_a.json").compensations().values()
    errors = [each for each in results_of(run_of(sequence))["findings"] if each["quantity"].endswith("_error")]
    errors = [each for each in errors if "point" in each["at"]]
    assert len(errors) >= 4
    for each in errors:
        true, error = each["at"][what], each["value"]
        output = np.array([known.offset.value + known.scale.value * (true + error)])
        (value,), _ = known.apply(output, np.full(1, np.nan))
        assert abs(value - true) < max(4 * each["u"], 2e-5 * abs(true))
        assert abs(value - true) < abs(error) / 2


@pytest.mark.parametrize("sequence", BENCHES)
def test_at_record_level_is_found_what_is_found_through_all_wires(template_of_run, sequence):
    bench, template = template_of_run(sequence)
    again = replayed(template, load_bench(bench).bench, SEED)
    through_wires, by_records = compare_table(template.folder), compared(again.truth, again.results)
    assert len(by_records) == len(through_wires)
    for each, found in zip(through_wires, by_records, strict=True):
        assert (found.quantity, found.dwell) == (each.quantity, each.dwell)
        reported = TOLD_C * SCALE_PER_C if found.quantity == "scale_error" else 0.0
        if found.quantity.startswith("rate_error"):  # a warm unit is the same within a thermal model's last steps
            reported = 1e-6
        assert found.truth == pytest.approx(each.truth, rel=0, abs=reported), found
        # The errors of a phase are nearly all those of the bench; in a short sweep noise has a part in them.
        most = 4.0 if not found.quantity.startswith("phase") else 0.8 if sequence.endswith("sweep") else 0.2
        assert abs(found.value - each.value) < most * np.hypot(found.u, each.u), found
        assert 1 / 2 < found.u / each.u < 2, found
    assert max(abs(found.ratio) for found in by_records) < 4


def test_at_record_level_a_swing_is_followed_from_the_first_latch_on(template_of_run):
    bench, template = template_of_run("gyro_response")
    (data,) = Player(template, load_bench(bench).bench, SEED, None).play().values()
    remarks = Remarks()
    for acquisition in data.acquisitions:
        samples = table_samples(acquisition, data.units[0])
        assert gyro_point(samples.swing(1 / 4000), acquisition.motion.frequency_hz, remarks)
    assert remarks.excluded["outlier"] == 0


@pytest.mark.parametrize("sequence", ["gyro_response", "accel_response"])
def test_the_calibration_of_a_response_takes_gain_and_phase_back(run_of, sequence):
    (known,) = read_calibration(run_of(sequence) / "calibration_a.json").compensations().values()
    findings = [each for each in results_of(run_of(sequence))["findings"] if "frequency_hz" in each["at"]]
    gains, phases = ([each for each in findings if each["quantity"] == name] for name in ("gain", "phase"))
    hz, gain, phase_deg = np.array([[each["at"]["frequency_hz"], each["value"], p["value"]]
                                    for each, p in zip(gains, phases, strict=True)]).T  # fmt: skip
    amplitude, back_deg, beyond = known.apply(known.scale.value * gain, phase_deg, hz)
    assert np.abs(amplitude - 1).max() < 5e-3
    assert np.abs((back_deg + 180) % 360 - 180).max() < 1
    assert beyond.sum() <= 2, "the ends of the sweep, by rounding"


@pytest.mark.parametrize("sequence", BENCHES)
def test_the_report_draws_it_and_tells_its_points(run_of, sequence):
    page = (run_of(sequence) / "report.html").read_text("utf-8")
    words = ("Errors over the range", "allowed", "Points of the range", "worst of")
    if sequence.endswith(("response", "sweep")):
        words = ("Frequency response", "-3 dB", "Points of the sweep", "K · exp(-2πi f delay)")
    for word in (*words, "Budgets of all points"):
        assert word in page


def test_the_commanded_rate_in_place_of_the_encoder_s_is_seen(run_of):
    honest = range_blocks.Turning

    def mistaken(step, command_dps, steady, *rest):
        return honest(step, command_dps, dataclasses.replace(steady, rate_dps=command_dps), *rest)

    with mock.patch.object(range_blocks, "Turning", mistaken), open_run(run_of("gyro_range")) as stored:
        found = compare_table(stored.folder, stored.evaluate().to_json())
    assert max(abs(each.ratio) for each in found if each.quantity == "rate_error/relative") > 6


def of_seeds(rng, u, points=4, seeds=40):
    """Figures whose errors, of a standard deviation of 1, are alike at all points of a run."""
    errors = rng.standard_normal(seeds)
    return [Comparison(seed, point, "gain", errors[seed], 0.0, u) for seed in range(seeds) for point in range(points)]


def test_of_each_run_one_figure_is_judged_and_all_points_have_their_turn():
    judged = list(one_a_run(of_seeds(np.random.default_rng(1), u=1.0)))
    assert sorted(each.seed for each in judged) == list(range(40))
    assert {each.dwell for each in judged} == {0, 1, 2, 3}


@pytest.mark.parametrize("kind", ["perfect", "full"])
def test_uncertainties_that_are_too_small_or_too_large_are_told(kind):
    rng = np.random.default_rng(1)
    assert problems_of(of_seeds(rng, u=1.0), kind, by_records=True) == []
    for u in (0.5, 2.0):
        assert "rms(error/u)" in problems_of(of_seeds(rng, u), kind, by_records=True)[0]
    few = [*of_seeds(rng, u=0.5, seeds=3), Comparison(1, 0, "phase", 6.0, 0.0, 1.0)]
    assert problems_of(few, kind, by_records=False) == [str(few[-1])]


@pytest.mark.parametrize("sequence", BENCHES)
def test_a_unit_of_the_other_sign_differs_in_its_sign_alone(run_of, sequence):
    assert list(differences(run_of(sequence))) == []
