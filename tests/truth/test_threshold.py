"""Threshold and resolution against the truth, through all wires: a unit with a wide dead band, and a good one."""

from unittest import mock

import numpy as np
import pytest

from bench.methods.threshold.reduction import run as ladder
from bench.reduce.stored_run import open_run
from campaigns.truth.campaign import results_of
from campaigns.truth.ladder import compare_ladders, ladder_run, true_threshold_g
from campaigns.truth.signs import differences

GOOD = ("ladder=[10 arcsec, 20 arcsec, 50 arcsec]", "repeats=2", "warm_up=0 s", "positions=[0°, 30°]")


@pytest.fixture(scope="module")
def silent(tmp_path_factory):
    return ladder_run(tmp_path_factory.mktemp("silent"), 1)


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    return ladder_run(tmp_path_factory.mktemp("good"), 2, unit=None, settings=GOOD)


def anew(run):
    with open_run(run) as stored:
        return stored.evaluate().to_json()


def test_the_dead_band_is_found_where_it_is(silent):
    (threshold, low_g, high_g), (resolution, *_) = compare_ladders(silent)
    assert (threshold.quantity, resolution.quantity) == ("threshold", "resolution")
    assert threshold.truth > 80e-6
    assert low_g <= threshold.truth <= high_g
    assert 0 < low_g < high_g
    assert abs(threshold.ratio) < 2
    assert resolution.truth == 0.0
    assert resolution.value == pytest.approx(5 / 206265 * 0.866, rel=1e-3), "at most the smallest step"


def test_its_verdict_and_its_words_are_those_of_a_unit_that_does_not_follow(silent):
    results = results_of(silent)
    assert results["verdict"] == "FAIL"
    assert results["units"] == [{"place": "a", "uut": "SIM-A", "verdict": "FAIL", "flags": []}]
    page = (silent / "report.html").read_text("utf-8")
    for words in ("Threshold about 0°", "Resolution about 30°", "in the grey band", "Change over expected", "arcsec"):
        assert words in page


def test_a_good_unit_follows_every_step(good):
    results = results_of(good)
    assert results["verdict"] == "PASS"
    assert [found["flags"] for found in results["findings"]] == [["at_most"], ["at_most"]]
    assert [found["at"]["above_g"] for found in results["findings"]] == [0.0, 0.0]


# Mistakes that a reduction could make, planted on purpose


def test_readings_within_the_dead_band_are_no_faults(silent):
    def mistaken(output):
        return next(iter(output.problems), "")

    with mock.patch.object(ladder, "_problem", mistaken):
        assert anew(silent)["verdict"] == "INCOMPLETE"


def test_a_step_taken_for_its_size_alone_is_seen(silent):
    honest = ladder.elevation_rad

    def mistaken(*orientation):
        return abs(honest(*orientation))

    with mock.patch.object(ladder, "elevation_rad", mistaken):
        (_, low_g, high_g), _ = compare_ladders(silent, anew(silent))
    (threshold, *_), _ = compare_ladders(silent)
    assert not low_g <= threshold.truth <= high_g


def test_a_unit_of_the_other_sign_differs_in_its_sign_alone(silent, good):
    assert [*differences(silent), *differences(good)] == []


@pytest.mark.parametrize(
    ("stands_g", "noise_g", "threshold_g"),
    [(0.0, 0.0, 100e-6), (30e-6, 0.0, 130e-6), (-30e-6, 0.0, 130e-6), (101e-6, 0.0, 0.0), (0.0, 300e-6, 0.0)],
)
def test_the_true_threshold_is_the_largest_step_that_is_not_followed(stands_g, noise_g, threshold_g):
    ladder = {"reference_g": stands_g, "dead_band_g": 100e-6}
    assert true_threshold_g(ladder, noise_g) == pytest.approx(threshold_g, abs=0.2e-6)


def test_noise_of_latches_lets_the_mean_follow_within_the_dead_band():
    """Against the mean of many latches."""
    rng = np.random.default_rng(3)
    ladder = {"reference_g": 0.0, "dead_band_g": 100e-6}
    threshold_g = true_threshold_g(ladder, 45e-6)
    assert 50e-6 < threshold_g < 95e-6
    for step_g, share in ((0.9 * threshold_g, -1), (1.1 * threshold_g, 1)):
        latches_g = step_g + 45e-6 * rng.standard_normal(1_000_000)
        followed = np.mean(np.where(np.abs(latches_g) < 100e-6, 0.0, latches_g)) / step_g
        assert share * (followed - 0.5) > 0
