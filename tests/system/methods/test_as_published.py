"""Presets `as_published` rehearsed through all wires and reduced: shorter, with all their other figures."""

from __future__ import annotations

from functools import partial

import pytest

from bench.reduce.stored_run import open_run
from campaigns.truth.campaign import compare_one, results_of
from campaigns.truth.channel import compare_channel
from campaigns.truth.imu import compare_imu
from campaigns.truth.indexing import compare_indexing
from campaigns.truth.ramp import compare_ramp
from campaigns.truth.table import LONG_ON, compare_table
from tests.support.channel import FULL
from tests.support.runs import ROOT, run_short

pytestmark = pytest.mark.slow

FEW = "frequencies={from: 10 Hz, to: 100 Hz, step: 10 Hz}"
OF_LEVELS = tuple(each for each in FULL if not each.startswith("ramp_rate"))
AT_FEW_PHASES = {"{frequency} Hz few_phases"}
SHORTER = {  # sequence: bench, what is shortened, flags of its units (of an inertial unit, by chance)
    "channel_full": ("channel", OF_LEVELS, {"slope_follows_level", "input_drifted"}),
    "channel_source": ("channel", (*OF_LEVELS[:-2], "source_warm_up=1 min"), {"slope_follows_level"}),
    "channel_gravity": ("channel", OF_LEVELS[:-1], set()),
    "channel_skew": ("channel", OF_LEVELS[:-1], set()),
    "channel_imu": ("channel_imu", OF_LEVELS[:-1], {"slope_follows_level", "input_drifted"}),
    "indexing_static": ("indexing", ("warm_up=20 min",), {"K2_K3:range_too_small"}),
    "imu_24_position": ("imu", ("offsets=[0 °C, 30 °C, -40 °C, 0 °C]", "warm_up=1 h"), None),
    "gyro_range": ("gyro", (*LONG_ON, "rates=[50 °/s, 200 °/s, 400 °/s]"), {"rest_of_one_angle"}),
    "accel_range": (
        "centrifuge", (*LONG_ON, "accelerations=[0.5 g, 1 g, 10 g, 20 g]"), {"rest_of_one_angle"},
    ),
    "gyro_response": ("gyro", (FEW, "warm_up=1 min"), AT_FEW_PHASES),
    "accel_response": ("table_telemetry", (FEW, "warm_up=1 min"), AT_FEW_PHASES),
    "tumble_static": ("volts", ("temperatures=[20 °C, 40 °C, 60 °C, 40 °C, 20 °C]",), {"too_few_temperatures"}),
    "ramp_dynamic": ("volts", ("low=10 °C", "high=60 °C"), set()),
}  # fmt: skip
COMPARED = {
    "channel": compare_channel, "imu": compare_imu, "indexing": compare_indexing, "ramp": compare_ramp,
    "tumble": lambda folder: compare_one(folder, results_of(folder)),
    "accel_response": partial(compare_table, output="codes"), "": compare_table,
}  # fmt: skip


@pytest.fixture(scope="module", params=SHORTER)
def rehearsed(request, tmp_path_factory):
    bench, settings, _ = SHORTER[request.param]
    return request.param, run_short(
        tmp_path_factory.mktemp(request.param), bench=ROOT / f"config/{bench}.yaml", sequence=request.param,
        preset="as_published", settings=settings, seed=2,
    )  # fmt: skip


def test_it_completes_and_the_unit_passes_with_the_flags_of_its_schedule(rehearsed):
    name, result = rehearsed
    assert (result.outcome.how, result.problems, result.results.verdict) == ("completed", [], "PASS")
    flags = SHORTER[name][2]
    if flags is not None:
        assert {flag.code for unit in result.results.units for flag in unit.flags} == flags


def test_it_is_reduced_again_to_the_same_with_its_preset(rehearsed):
    _, result = rehearsed
    with open_run(result.path) as stored:
        again = stored.evaluate()
    assert [unit.findings for unit in again.units] == [unit.findings for unit in result.results.units]
    assert [unit.flags for unit in again.units] == [unit.flags for unit in result.results.units]


def test_what_it_finds_is_the_truth_within_its_uncertainty(rehearsed):
    name, result = rehearsed
    found = next(compare for start, compare in COMPARED.items() if name.startswith(start))(result.path)
    ratios = [each.ratio for each in (found.values() if isinstance(found, dict) else found)]
    assert ratios
    assert max(map(abs, ratios)) < 3.5
