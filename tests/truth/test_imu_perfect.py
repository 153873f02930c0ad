"""Inertial units on a perfect bench: their own noise is all that their results are uncertain by.

With 60 s in each attitude a hundredth of what a bench adds is seen. At 30 °C what the accelerometer z sees of y and its
bias cancel where y is down: its converter is in its dead band there.
"""

import numpy as np
import pytest

from bench.app.request import RunRequest
from bench.config.bench import load_bench
from bench.methods.imu.reduction import run as imu_run
from campaigns.truth import judge
from campaigns.truth.imu import QUANTITIES, bench_file, compared, draw_scale_factors
from campaigns.truth.replay import replayed, template_of

pytestmark = pytest.mark.timeout(600)
SEEDS = range(1, 13)
SHORT = (
    "offsets=[0 °C, 10 °C, 20 °C]", "warm_up=2 h", "soak=30 min", "dwell=60 s", "settle=1 s", "rate_dwell=3 s",
    "ramp_rate=3 °C/min", "rates=[20 °/s, -20 °/s, 30 °/s, -30 °/s, 40 °/s, -40 °/s]",
)  # fmt: skip
LARGEST = 5.0  # |error|/u of 1400 values, most of which have more than 15 degrees of freedom
RMS_OF_ONE = 1.8  # of the twelve values of one finding: beyond it one in 10 000


@pytest.fixture(scope="module")
def perfect(tmp_path_factory):
    """Replays a seed: truth and results."""
    folder = tmp_path_factory.mktemp("perfect")
    bench = bench_file(folder / "config", "imu", perfect=True)
    draw_scale_factors(folder / "config")
    template = template_of(RunRequest("imu_24_position", bench=str(bench), seed=3, settings=SHORT, runs=folder))
    loaded = load_bench(bench).bench
    return lambda seed: replayed(template, loaded, seed)


@pytest.fixture(scope="module")
def runs(perfect):
    return [perfect(seed) for seed in SEEDS]


@pytest.fixture(scope="module")
def comparisons(runs):
    return [each for run in runs for each in compared(run.truth, run.results)]


def test_errors_follow_the_uncertainties(comparisons):
    low, high = judge.RMS["perfect"]
    found = judge.by_quantity(comparisons)
    assert found.keys() == set(QUANTITIES)
    assert min(map(len, found.values())) == 3 * 3 * len(SEEDS)
    rms = {quantity: judge.rms_of(each) for quantity, each in found.items()}
    assert [(quantity, each) for quantity, each in rms.items() if not low <= each <= high] == []


def test_no_value_is_far_off(comparisons):
    assert max(abs(each.ratio) for each in comparisons) < LARGEST


def by_finding(runs):
    """Error over u of each seed, by the id of a finding."""
    ratios = {}
    for run in runs:
        for each in run.results["findings"]:
            for comparison in compared(run.truth, {"findings": [each]}):
                ratios.setdefault(each["id"], []).append(comparison.ratio)
    return ratios


def test_no_set_point_has_an_error_of_its_own(runs):
    ratios = by_finding(runs)
    assert {len(of) for of in ratios.values()} == {len(SEEDS)}
    rms = {name: np.sqrt(np.mean(np.square(of))) for name, of in ratios.items()}
    assert [(name, each) for name, each in rms.items() if each > RMS_OF_ONE] == []


def test_the_dead_band_is_met_and_flagged(runs):
    (unit,) = runs[0].results["units"]
    assert [flag for flag in unit["flags"] if "near_zero" in flag] == ["T=30:near_zero:acc_z Ay5..Ay8"]


def test_readings_in_the_dead_band_taken_for_good_ones_are_seen(perfect, monkeypatch):
    monkeypatch.setattr(imu_run, "near_zero", lambda *_: np.zeros((24, 3), dtype=np.bool_))
    far = [name for name, ratios in by_finding([perfect(1)]).items() if abs(ratios[0]) > LARGEST]
    assert far == ["imu/a/zy/misalignment@temperature=30"]
