"""The tests on a rate table by codes and by volts against the truth: each sequence short, on a full bench."""

import csv
import json

import pytest

from bench.app.request import RunRequest
from bench.offline.calibration_file import read_calibration
from bench.reduce.stored_run import open_run
from bench.report.export.export import FORMATS
from campaigns.truth.campaign import results_of, run_one
from campaigns.truth.signs import differences
from campaigns.truth.table import BENCHES_BY_OUTPUT, LONG_ON, SHORT, check_held, table_bench
from tests.support.runs import latest

SEEDS = (5, 6)
RANGE = (*LONG_ON, "record=3 s", "rest=3 s")
SHORTER = {
    "gyro_range": (*RANGE, "rates=[50 °/s, 400 °/s]"),
    "accel_range": (*RANGE, "accelerations=[0.5 g, 1 g, 20 g]"),
    "gyro_sweep": latest(*SHORT["gyro_sweep"], "over=30 s"),
    "accel_sweep": latest(*SHORT["accel_sweep"]),
    "gyro_response": latest(*SHORT["gyro_response"], "frequencies=[10.37 Hz, 57.37 Hz, 61.37 Hz]", "record=3 s"),
    "accel_response": latest(
        *SHORT["accel_response"], "frequencies=[10.37 Hz, 30.37 Hz, 57.37 Hz, 61.37 Hz, 90.37 Hz]", "record=2 s",
        "lever_record=10 s",
    ),
}  # fmt: skip
WORTH = {  # a standard uncertainty that is worth stating, at most
    "rest_rate": 3e-4, "rate_error/relative": 6e-5, "rest_output": 2e-5, "radius": 3e-4,
    "acceleration_error/relative": 8e-5, "gain": 2e-3, "phase": 2.0, "bandwidth": 0.15, "phase_at_bandwidth": 1.5,
    "lever_arm/x": 3e-4, "lever_arm/y": 5e-5,
}  # fmt: skip
CASES = [(output, sequence) for output in ("codes", "volts") for sequence in BENCHES_BY_OUTPUT[output]]
RUNS = {}


@pytest.fixture(scope="module")
def run_of(tmp_path_factory):
    """A run of a sequence, made once."""

    def run(output, sequence, seed=SEEDS[0]):
        key = output, sequence, seed
        if key not in RUNS:
            folder = tmp_path_factory.mktemp(sequence)
            bench = table_bench(folder / "config", BENCHES_BY_OUTPUT[output][sequence])
            request = RunRequest(
                sequence, bench=str(bench), seed=seed, settings=SHORTER[sequence], runs=folder / "runs"
            )
            RUNS[key] = run_one(request)
        return RUNS[key]

    yield run
    RUNS.clear()


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("output", "sequence"), CASES)
def test_errors_stay_within_their_uncertainties(run_of, output, sequence, seed):
    check_held(run_of(output, sequence, seed), WORTH, output)


def test_units_and_budgets_are_those_of_the_output(run_of):
    by_codes, by_volts = (read_calibration(run_of(output, "accel_range") / "calibration_a.json")
                          for output in ("codes", "volts"))  # fmt: skip
    scales = [next(iter(each.compensations().values())).scale for each in (by_codes, by_volts)]
    assert [(scale.value, scale.unit) for scale in scales] == [(45_200, "code/g"), (0.226, "V/g")]
    findings = results_of(run_of("volts", "gyro_range"))["findings"]
    sources = {line["source"] for found in findings for line in found["budget"]}
    assert {"voltmeter: gain", "voltmeter: offset", "counter: time base", "sensor and voltmeter: noise"} <= sources
    page = (run_of("codes", "gyro_response") / "report.html").read_text("utf-8")
    for words in ("Telemetry x", "samples in 3 acquisitions, 0 lost", "encoder: time to the end of the sample"):
        assert words in page
    assert "pulse" not in page.split("Budgets of all points")[1].split("</section>")[0]


@pytest.mark.parametrize(("output", "sequence"), [("codes", "accel_response"), ("volts", "accel_range")])
def test_a_run_is_reduced_and_compensated_again(run_of, bench_here, tmp_path, output, sequence):
    folder = run_of(output, sequence)
    again = bench_here("reduce", str(folder), "--json")
    assert (again.returncode, json.loads(again.stdout)["changes"]) == (0, [])
    outputs = tmp_path / "outputs.csv"
    rows = "f_Hz,phase_deg,output\n30,-40,45200\n" if output == "codes" else "T_C,output\n22,2.26\n"
    outputs.write_text(rows, "utf-8")
    done = bench_here("compensate", str(folder / "calibration_a.json"), str(outputs))
    assert done.returncode == 0, done.stderr
    (value,) = csv.DictReader(done.stdout.splitlines())
    assert float(value["value"]) == pytest.approx(1.03 if output == "codes" else 10.0, rel=0.03)


def rows_of(path, step):
    """The rows of a step."""
    return [row for row in csv.DictReader(path.read_text("utf-8").splitlines()) if row["step"] == step]


@pytest.mark.parametrize("form", FORMATS)
def test_a_run_is_exported(run_of, tmp_path, form):
    with open_run(run_of("codes", "gyro_response")) as stored:
        paths = FORMATS[form](stored, tmp_path)
        swing = stored.data("sweep").acquisitions[1]
    assert all(path.stat().st_size for path in paths)
    if form != "csv":
        return
    samples, positions = (rows_of(tmp_path / f"{name}.csv", swing.step) for name in ("samples", "positions"))
    codes, encoder = swing.codes["x"], swing.positions["table"]
    assert [float(row["value"]) for row in samples] == codes.values.tolist()
    assert [int(row["sequence"]) for row in samples] == codes.sequence.tolist()
    assert [int(row["position"]) for row in positions] == encoder.position.tolist()


def test_what_a_voltmeter_read_is_exported(run_of, tmp_path):
    with open_run(run_of("volts", "gyro_range")) as stored:
        names = {path.name for path in FORMATS["csv"](stored, tmp_path)}
        read = stored.data("range").acquisitions[0]
    assert names == {"readings.csv", "acquisitions.csv", "positions.csv", "voltages.csv", "journal.csv", "columns.csv"}
    found = [float(row["value"]) for row in rows_of(tmp_path / "voltages.csv", read.step)]
    assert found == pytest.approx(read.voltages["dvm"].values_v, abs=0)


@pytest.mark.parametrize(("output", "sequence"), CASES)
def test_a_unit_of_the_other_sign_differs_in_its_sign_alone(run_of, output, sequence):
    assert list(differences(run_of(output, sequence))) == []
