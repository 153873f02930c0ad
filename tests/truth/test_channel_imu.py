"""The three channels of an inertial unit against the truth, at the level of records: a sample of the campaign."""

from __future__ import annotations

import math
from unittest import mock

import pytest
from scipy.stats import chi2

from bench.app.request import RunRequest
from bench.config.bench import load_bench
from bench.metrology.run_data import UnitUnderTest
from campaigns.truth import bars, channel
from campaigns.truth.altered import alter_file
from campaigns.truth.campaign import full_bench
from campaigns.truth.cells import METHODS, Cell, Line
from campaigns.truth.replay import replayed, template_of
from tests.support.channel import FULL

pytestmark = pytest.mark.slow

METHOD = METHODS["M0 inertial"]
SEEDS = range(1, 7)
QUANTITIES = (*channel.OF_A_LEVEL, *channel.OF_TWO, *channel.OF_ALL)


@pytest.fixture(scope="module")
def template(tmp_path_factory):
    folder = tmp_path_factory.mktemp("template")
    bench = full_bench(folder / "config", METHOD.bench)
    return template_of(RunRequest(METHOD.sequence, bench=str(bench), seed=0, settings=FULL, runs=folder / "runs"))


def bench_with(folder, kind):
    path = full_bench(folder, METHOD.bench)
    alter_file(folder / "uut" / f"{METHOD.unit}.yaml", kind)
    return load_bench(path).bench


def lines(template, bench):
    runs = [replayed(template, bench, seed) for seed in SEEDS]
    return [Line(run.truth["seed"], tuple(METHOD.found(run.truth, run.results))) for run in runs]


@pytest.mark.parametrize("kind", ["as shipped", "misaligned"])
def test_errors_of_every_channel_are_as_large_as_their_uncertainties(kind, template, tmp_path):
    found = {
        each.quantity: each
        for each in bars.judged(Cell(METHOD.name, kind), lines(template, bench_with(tmp_path, kind)))
    }
    assert set(found) == set(QUANTITIES)
    low, high = (math.sqrt(chi2.ppf(chance, len(SEEDS)) / len(SEEDS)) for chance in (0.001, 0.999))
    assert max(each.rms for each in found.values()) < 1.35 * high
    assert min(each.rms for each in found.values()) > 0.75 * low


def test_the_truth_sees_a_channel_that_is_taken_for_another(template, tmp_path):
    bench = bench_with(tmp_path, "as shipped")
    honest = replayed(template, bench, 1)
    with mock.patch.object(UnitUnderTest, "alone", exchanged(UnitUnderTest.alone)):
        mistaken = replayed(template, bench, 1)
    assert largest(honest) < 4
    assert largest(mistaken) > 100


def exchanged(honest):
    """Take the channel of z for that of y, and that of y for z."""
    others = {"acc_x": "acc_x", "acc_y": "acc_z", "acc_z": "acc_y"}

    def alone(unit, sensor):
        found = honest(unit, others[sensor])
        return type(found)(**{name: getattr(found, name) for name in found.__slots__} | {"sensor": sensor})

    return alone


def largest(run):
    return max(abs(each.ratio) for each in METHOD.found(run.truth, run.results))
