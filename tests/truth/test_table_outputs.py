"""The tests on a rate table by codes and by volts against the truth: each sequence short, on a full bench."""

import numpy as np
import pytest

from bench.app.request import RunRequest
from tests.truth.campaign import results_of, run_one
from tests.truth.table import BENCHES_BY_OUTPUT, SHORT, compare_table, table_bench

SEEDS = (3, 4)
RANGE = ("warm_up=0 s", "record=3 s", "rest=3 s")
SHORTER = {
    "gyro_range": (*RANGE, "rates=[50 °/s, 400 °/s]"),
    "accel_range": (*RANGE, "accelerations=[0.5 g, 1 g, 20 g]"),
    "gyro_response": (*SHORT["gyro_response"], "frequencies=[10.37 Hz, 57.37 Hz, 61.37 Hz]", "record=3 s"),
    "accel_response": (
        *SHORT["accel_response"], "frequencies=[10.37 Hz, 57.37 Hz, 61.37 Hz]", "record=3 s", "lever_record=10 s",
    ),
}  # fmt: skip
WORTH = {  # a standard uncertainty that is worth stating, at most
    "rest_rate": 3e-4, "rate_error/relative": 6e-5, "rest_output": 2e-5, "radius": 1e-4,
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
    folder = run_of(output, sequence, seed)
    comparisons = compare_table(folder, output=output)
    assert len(comparisons) >= 6
    ratios = np.array([each.ratio for each in comparisons])
    assert np.max(np.abs(ratios)) < 4
    assert np.sqrt(np.mean(ratios**2)) < 2
    assert {each.quantity: each.u for each in comparisons if each.u > WORTH.get(each.quantity, np.inf)} == {}
    results = results_of(folder)
    assert results["verdict"] == "PASS"
    assert [flag for unit in results["units"] for flag in unit["flags"]] == []
