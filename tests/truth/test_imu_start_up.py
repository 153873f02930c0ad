"""The start-up of a compensated unit against the truth; over many seeds `python -m campaigns.truth.imu_start_up`."""

import json
import math
import shutil
from unittest import mock

import pytest

from bench.app.request import RunRequest
from bench.methods.imu.start_up.readings import PowerOn
from bench.reduce.reduced_again import reduced_again
from bench.reduce.stored_run import open_run
from bench.report.revision import verify
from bench.report.terminal import results_text
from campaigns.truth import judge
from campaigns.truth.campaign import campaign, full_bench, results_of, run_one
from campaigns.truth.imu_start_up import CALIBRATION, LIMITS, compare_start_up

pytestmark = pytest.mark.timeout(600)
SHORT = ("temperatures=[15 °C]", "soak=30 min", "passes=8", "ramp_rate=3 °C/min")

SEED, FURTHER_SEEDS = 4, range(5, 16)
CLAIMED = 0.95  # of the truths, that intervals hold
CHANCE = 0.01  # how often so many do not hold it although they are right


def requested(folder, seed):
    return RunRequest("imu_start_up", bench=str(folder / "config/imu.yaml"), seed=seed, settings=SHORT, runs=folder,
                      calibrations=(str(CALIBRATION),))  # fmt: skip


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("start_up")
    full_bench(folder / "config")
    return run_one(requested(folder, SEED))


@pytest.fixture(scope="module")
def further_runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("further")
    full_bench(folder / "config")
    return campaign([requested(folder, seed) for seed in FURTHER_SEEDS])


def least_held(count):
    """How many of intervals that hold the truth as often as they claim do so at least, but for chance."""
    missed, left = 0, 1.0
    while True:
        left -= math.comb(count, missed) * (1 - CLAIMED) ** missed * CLAIMED ** (count - missed)
        if left < CHANCE:
            return count - missed
        missed += 1


def reduced(run):
    with open_run(run) as stored:
        return stored.evaluate().to_json()


def test_everything_is_found_and_compared(run):
    comparisons = compare_start_up(run)
    assert {each.quantity.split("/")[0] for each in comparisons} == set(LIMITS)
    assert "K0/settling" in {each.quantity for each in comparisons}


def test_errors_follow_the_uncertainties(run, further_runs):
    """Held to the bars of the campaign, which has more seeds; of intervals there are too few for its bar."""
    comparisons = [each for folder in (run, *further_runs) for each in compare_start_up(folder)]
    values = [each for each in comparisons if not each.quantity.endswith("/settling")]
    assert list(judge.beyond(judge.by_quantity(values), "full")) == []


def test_intervals_of_times_hold_the_truth(run, further_runs):
    comparisons = [each for folder in (run, *further_runs) for each in compare_start_up(folder)]
    times = [each for each in comparisons if each.quantity.endswith("/settling")]
    assert len(times) >= 3 * (1 + len(FURTHER_SEEDS)), "the zero of an accelerometer after each power-on at least"
    assert sum(each.held for each in times) >= least_held(len(times)), f"{len(times)} intervals of 95 %"


def test_uncertainties_are_worth_stating(run):
    most = {"K0/power_on": 15e-6, "K0/warm": 5e-6, "K0/settling": 240.0, "K1/warm": 5e-6, "KG/warm": 5e-6}
    found = {(each.quantity, each.u) for each in compare_start_up(run) if each.quantity in most}
    assert {quantity for quantity, _ in found} == set(most)
    assert [(quantity, u) for quantity, u in found if u > most[quantity]] == []


def test_planted_errors_are_seen(run):
    """Time from the end of the first pass instead of from power-on; the temperature of the chamber, not of the unit."""
    since, compensated = PowerOn._since_s, PowerOn._compensated
    late = mock.patch.object(PowerOn, "_since_s", lambda self, window: since(self, window) - 420.0)
    chamber = mock.patch.object(
        PowerOn, "_compensated", lambda self, channel, pps, step, _: compensated(self, channel, pps, step, 15.0)
    )
    for plant, quantity in ((late, "K0/settling"), (chamber, "K0/warm")):
        with plant:
            found = [each for each in compare_start_up(run, reduced(run)) if each.quantity == quantity]
        assert max(abs(each.ratio) for each in found) > 4, quantity


def test_the_run_keeps_the_calibration_that_it_was_given(run):
    manifest = json.loads((run / "manifest.json").read_text("utf-8"))
    reported = manifest["released"]["a"]
    assert (reported["file"], reported["uut"]) == ("imu_calibration.json", "SIM-A")
    assert manifest["hashes"]["released_a.json"].startswith("sha256:")
    assert (run / "released_a.json").read_bytes() == CALIBRATION.read_bytes()
    assert reported["valid_c"] == pytest.approx([-15, 55], abs=0.2)


def test_it_can_be_reduced_again_and_another_calibration_in_its_place_is_noticed(run, tmp_path):
    again = shutil.copytree(run, tmp_path / "again")
    with open_run(again) as stored:
        assert reduced_again(stored).changes == ()
    other = json.loads((again / "released_a.json").read_text("utf-8"))
    (again / "released_a.json").write_text(json.dumps({**other, "operator": "?"}), "utf-8")
    assert any("released_a.json" in problem for problem in verify(again))


def test_the_report_tells_it_in_words_and_draws_it(run):
    page = (run / "report.html").read_text("utf-8")
    for words in (
        "Time from power-on until it stays within its limits", "Zero and scale factor since power-on, set point 15 °C",
        "Calibration of unit SIM-A", "imu_calibration.json, of run", "Accelerometers: zero",
        "Residual errors of the compensation after power-on", "Budgets of all points",
    ):  # fmt: skip
        assert words in page
    with open_run(run) as stored:
        on_the_console = results_text(stored.evaluate())
    assert all(f"{quantity}: {what}" in on_the_console for quantity in LIMITS for what in ("warm", "settling"))
    assert {each["quantity"] for each in results_of(run)["findings"]} == {
        f"{quantity}/{what}" for quantity in LIMITS for what in ("power_on", "warm", "settling")
    }


def test_the_run_tells_when_the_unit_was_put_on(run):
    with open_run(run) as stored:
        acquired = stored.data("start_up").acquisitions
    ((begun_s, ended_s),) = {each.on_since_s["supply"] for each in acquired}
    assert 0 <= ended_s - begun_s < 5
    assert all(each.begin_s >= ended_s for each in acquired)
