"""Inertial units that send codes, against the truth; more by `python -m campaigns.truth.imu --bench imu_telemetry`."""

import csv

import pytest

from bench.app.request import RunRequest, prepare
from bench.config.bench import load_bench
from bench.errors import InputError
from bench.offline.calibration_file import compensated, read_calibration
from bench.reduce.stored_run import open_run
from campaigns.truth import judge
from campaigns.truth.campaign import results_of, run_one
from campaigns.truth.imu import QUANTITIES, SHORT, bench_file, compare_imu, compared, draw_scale_factors, judged
from campaigns.truth.imu_start_up import CALIBRATION, LIMITS, compare_start_up
from campaigns.truth.replay import replayed, template_of
from campaigns.truth.signs import differences

SEEDS = range(1, 21)
START_UP = ("temperatures=[27 °C]", "soak=30 min", "passes=6", "ramp_rate=3 °C/min")


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    draw_scale_factors(bench_file(folder, "imu_telemetry", perfect=False).parent)
    return folder / "imu_telemetry.yaml"


@pytest.fixture(scope="module")
def template(tmp_path_factory, bench):
    folder = tmp_path_factory.mktemp("imu")
    return template_of(RunRequest("imu_24_position", bench=str(bench), seed=1, settings=SHORT, runs=folder))


@pytest.fixture(scope="module")
def run(template):
    return template.folder


def test_every_finding_of_a_run_through_all_wires_is_within_its_uncertainty(run):
    comparisons = compare_imu(run)
    assert {each.quantity for each in comparisons} == set(QUANTITIES)
    assert max(abs(each.ratio) for each in comparisons) < 3


def test_errors_follow_the_uncertainties(template, bench):
    """Runs of other seeds at the level of records, held to the bars of the campaign, with half as many seeds."""
    loaded = load_bench(bench).bench
    runs = [replayed(template, loaded, seed) for seed in SEEDS]
    found = judge.by_quantity(judged([each for run in runs for each in compared(run.truth, run.results)], "full"))
    assert found.keys() == set(QUANTITIES)
    assert min(len(each) for each in found.values()) >= 3 * len(SEEDS)
    assert list(judge.beyond(found, "full")) == []


def test_uncertainties_are_worth_stating(run):
    most = {"K0": 3e-6, "K1": 0.7, "D0": 4e-5, "KG": 0.1, "misalignment": 30e-6, "gyro_misalignment": 40e-6}
    found = {(each.quantity, each.u) for each in compare_imu(run) if each.quantity in most}
    assert {quantity for quantity, _ in found} == most.keys()
    assert [(quantity, u) for quantity, u in found if u > most[quantity]] == []


def test_scale_factors_are_of_codes_and_zeros_are_physical(run):
    units = {each["quantity"]: each["unit"] for each in results_of(run)["findings"]}
    assert (units["K1"], units["K1_si"], units["KG"]) == ("code/g", "code/(m/s²)", "code/(°/s)")
    assert (units["K0"], units["D0"], units["K2"]) == ("g", "°/s", "g/g²")


def test_the_clock_of_the_computer_stands_where_that_of_a_counter_would(run):
    budgets = {each["quantity"]: {line["source"] for line in each["budget"]} for each in results_of(run)["findings"]}
    assert "computer: clock" in budgets["KG"]
    assert not any("counter: time base" in sources for sources in budgets.values())


def test_the_report_tells_codes(run):
    page = (run / "report.html").read_text("utf-8")
    for words in ("code/(°/s)", "code/g", "Misalignment of the gyros"):
        assert words in page
    assert "pulse/" not in page


def test_the_calibration_makes_values_of_codes(run, tmp_path):
    calibration = read_calibration(run / "calibration_a.json")
    channels = {channel.channel: channel for channel in calibration.channels}
    assert {channel.output for channel in channels.values()} == {"code"}
    scale = channels["gyro_x"].compensation().scale.values[0]
    data = tmp_path / "data.csv"
    data.write_text(f"channel,T_C,output\ngyro_x,25,{30 * scale}\n", "utf-8")
    (row,) = csv.DictReader(compensated(calibration, data, "hold").splitlines())
    assert float(row["value"]) == pytest.approx(30, abs=0.05)


def test_a_compensated_unit_that_sends_codes_is_watched_from_power_on(run, bench, tmp_path):
    given = (str(run / "calibration_a.json"),)
    started = run_one(
        RunRequest("imu_start_up", bench=str(bench), seed=1, settings=START_UP, runs=tmp_path, calibrations=given)
    )
    comparisons = compare_start_up(started)
    assert {each.quantity.split("/")[0] for each in comparisons} == set(LIMITS)
    assert max(abs(each.ratio) for each in comparisons) < 4
    sources = {line["source"] for each in results_of(started)["findings"] for line in each["budget"]}
    assert "computer: clock" in sources
    assert "counter: time base" not in sources


def test_a_calibration_of_pulses_is_refused_for_codes(bench, tmp_path):
    request = RunRequest(
        "imu_start_up", bench=str(bench), settings=START_UP, runs=tmp_path, calibrations=(str(CALIBRATION),)
    )
    with pytest.raises(InputError, match="acc_x is for an output in pulse/s, on the bench it is in code"):
        prepare(request)


def test_the_rate_of_the_table_is_timed_by_the_computer(run):
    """The clock of the unit errs by tens of ppm; a mean of samples knows nothing of it."""
    with open_run(run) as stored:
        windows = [window for each in stored.data("imu").acquisitions for window in each.windows.values()]
    assert windows
    assert all(window.span_s == window.host_span_s for window in windows if window.single_u != 0)


def test_a_unit_of_the_other_sign_differs_in_its_sign_alone(run):
    assert list(differences(run)) == []
