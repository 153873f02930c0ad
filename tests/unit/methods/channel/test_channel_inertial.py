"""An inertial unit as three channels: which of them has an input, and what contradicts the record."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bench.config.bench import load_bench
from bench.methods.channel.planned_levels import _upward
from bench.methods.channel.reduction.inertial import combined
from bench.methods.channel.reduction.inputs_seen import wrong_inputs
from bench.methods.channel.reduction.levels import input_level
from bench.metrology.acquisition import Acquisition, Counts, Mount
from bench.metrology.orientation import specific_force_g
from bench.metrology.outputs import mean_output
from bench.metrology.power_cycles import reduced
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import UnitResult
from bench.metrology.results.flag import Flag
from bench.metrology.run_data import PowerCycles, RunData, UnitUnderTest
from bench.reduce.acquisitions import mount_of
from bench.reduce.certificates import bench_record
from bench.report.flag_words import flag_in_words
from tests.support.runs import ROOT

FILE = load_bench(ROOT / "config/channel_imu.yaml").bench
BENCH = bench_record(FILE)
K1, PER_G = 1.13e-3, 11_300.0
CHANNELS = {f"{sensor}_{axis}": f"{sensor[0]}{axis}" for sensor in ("acc", "gyro") for axis in "xyz"}
UNIT = UnitUnderTest(
    "a", "IMU-7", "", 0.0, "unit", channels=CHANNELS, nominal_per_g=PER_G, converter="board", source="source",
    scale_a_per_g=K1,
)  # fmt: skip
MOUNTS = {name: mount_of(FILE, name) for name in FILE.fixture.mounts}
SEEN = {"x_up": (1.0, 0.0, 0.0), "y_up": (0.0, 1.0, 0.0), "z_up": (0.0, 0.0, 1.0), "skew": (0.577, 0.577, 0.577)}


def counted(rate_pps):
    number = np.arange(101)
    pulses = np.floor(np.abs(rate_pps) * number).astype(np.int64)
    none = np.zeros_like(pulses)
    return Counts(
        sequence=number, tick=1_000_000 * number, positive=pulses if rate_pps > 0 else none,
        negative=none if rate_pps > 0 else pulses, host_s=number.astype(float), tick_bits=62, counter_bits=62,
        tick_period_s=1e-6, max_rate_pps=256e3, lost=0, restarts=0,
    )  # fmt: skip


def acquired(seen_g, mount="x_up", channel="", level_g=0.0, step="steps/acquire"):
    counts = {f"a{axis}": counted(PER_G * g + 3.0) for axis, g in zip("xyz", seen_g, strict=True)}
    return Acquisition(
        step=step, group="", loops={}, begin_s=0.0, end_s=100.0, angles_deg={}, set_from_c=20.0, set_c=20.0,
        counts=counts, temperatures_c={}, temperatures_at_s={}, mount=MOUNTS[mount],
        input="source" if channel else "accelerometer", input_channel=channel,
        sources_a={"source": level_g * K1} if channel else {},
    )  # fmt: skip


def data_of(*acquisitions):
    return RunData("channel", (UNIT,), acquisitions, BENCH)


def flags_of(*acquisitions, unit=UNIT):
    return [flag_in_words(each) for each in wrong_inputs(data_of(*acquisitions), unit).values()]


@pytest.mark.parametrize("mount", MOUNTS)
def test_each_mount_has_the_axes_up_that_it_is_named_for(mount):
    force_g = specific_force_g(acquired((0, 0, 0), mount), UNIT, BENCH)
    assert force_g == pytest.approx(SEEN[mount], abs=1e-3)
    assert _upward(FILE, FILE.fixture.mount(mount), 0.0) == pytest.approx(force_g.tolist(), abs=1e-12)


def test_up_is_the_same_for_the_rule_as_for_the_reduction_in_any_mount():
    entry = FILE.fixture.mount("skew").model_copy(update={"angle": 12.0, "roll": -130.0, "clock": 77.0})
    turned = replace(acquired((0, 0, 0)), mount=Mount("m", 12.0, -130.0, 77.0))
    raised = replace(UNIT, mount_angle_deg=33.0)
    assert _upward(FILE, entry, 33.0) == pytest.approx(specific_force_g(turned, raised, BENCH).tolist(), abs=1e-12)


@pytest.mark.parametrize(
    ("mount", "channel", "levels"),
    [
        ("x_up", "", ["up_1g", None, None]),
        ("z_up", "", [None, None, "up_1g"]),
        ("skew", "", ["skew", "skew", "skew"]),
        ("skew", "acc_y", [None, "src_12g", None]),
    ],
)
def test_a_channel_has_a_level_where_its_axis_is_up_or_the_source_feeds_it(mount, channel, levels):
    acquisition = acquired((0, 0, 0), mount, channel, 12.0)
    found = [input_level(data_of(acquisition), each, acquisition) for each in UNIT.accelerometers]
    assert [None if level is None else level.name for level in found] == levels


@pytest.mark.parametrize("mount", MOUNTS)
def test_a_unit_as_recorded_is_not_flagged_even_with_bias_and_misalignment(mount):
    seen_g = np.add(SEEN[mount], [0.05, -0.08, 0.06])
    assert flags_of(acquired(seen_g, mount), acquired(seen_g * 1.3, mount)) == []


@pytest.mark.parametrize(
    ("seen_g", "mount", "words"),
    [
        ((0.0, 1.0, 0.0), "x_up", "axis y was along the vertical, unlike in mount 'x_up'"),
        ((-1.0, 0.0, 0.0), "x_up", "axis x was along the vertical, unlike in mount 'x_up'"),
        ((1.0, 0.0, 0.0), "skew", "axis x was along the vertical, unlike in mount 'skew'"),
        ((0.577, 0.577, 0.577), "x_up", "the unit was not in mount 'x_up'"),
        ((-0.577, -0.577, -0.577), "skew", "the unit was not in mount 'skew'"),
        ((0.0, 0.0, 0.0), "x_up", "the unit was not in mount 'x_up', or an accelerometer was not connected"),
    ],
)
def test_another_attitude_than_the_recorded_one_is_flagged(seen_g, mount, words):
    (flag,) = flags_of(acquired(seen_g, mount))
    assert words in flag


@pytest.mark.parametrize(
    ("seen_g", "level_g", "words"),
    [
        ((0.0, 1.0, 0.0), 1.0, "was in channel acc_y instead of acc_x: at 1 g the channels read x 0.00 g, y 1.00 g"),
        ((0.0, 0.0, -12.0), -12.0, "was in channel acc_z instead of acc_x: at -12 g"),
        ((0.0, 0.0, 0.0), 1.0, "did not reach channel acc_x, nor another accelerometer channel"),
    ],
)
def test_current_in_another_channel_is_flagged(seen_g, level_g, words):
    (flag,) = flags_of(acquired(seen_g, channel="acc_x", level_g=level_g))
    assert words in flag


def test_current_where_it_belongs_is_not_flagged_though_other_accelerometers_are_still_connected():
    seen = (1.0, 0.0, 1.0)
    assert flags_of(acquired(seen, channel="acc_x", level_g=1.0)) == []
    assert flags_of(acquired(seen, channel="acc_x", level_g=0.0)) == [], "a source at 0 A is judged as a zero"


def test_nothing_is_judged_without_nominal_data():
    assert flags_of(acquired((0.0, 1.0, 0.0)), unit=replace(UNIT, nominal_per_g=None)) == []


def test_a_set_up_is_flagged_once_and_its_levels_make_the_unit_incomplete():
    steps = [acquired((0.0, 1.0, 0.0), step=f"steps/acquire#{number}") for number in range(3)]
    data, flag = data_of(*steps), Flag("accelerometer_drift", of="up_1g")
    found = {
        axis: UnitResult("a", "IMU-7", (), (), (), (flag, Flag("no_thermometer", of="converter"))) for axis in "xyz"
    }
    result = combined(data, UNIT, found, wrong_inputs(data, UNIT))
    assert result.verdict == "INCOMPLETE"
    assert result.left_out == ("x/up_1g", "x", "y", "z")
    assert sum("mount 'x_up'" in str(each) for each in result.flags) == 1
    assert [str(each) for each in result.flags if each.code in ("accelerometer_drift", "no_thermometer")] == [
        "x/up_1g:accelerometer_drift", "converter:no_thermometer", "y/up_1g:accelerometer_drift",
        "z/up_1g:accelerometer_drift",
    ]  # fmt: skip


def test_the_repeatability_of_gyros_is_in_no_result_of_the_accelerometers():
    stated = replace(UNIT, power_cycles=PowerCycles(bias_g=1e-5, scale=1e-5, gyro_bias_dps=1e-4, gyro_scale=1e-5))
    one, other = (replace(acquired((1.0, 0.0, 0.0), step=f"s{stretch}"), stretch=stretch) for stretch in (0, 1))
    line, acc = [BudgetLine("counts", "B", 1e-3)], UNIT.accelerometers[0]

    def mean(data, settings):
        rate = sum(mean_output(each, acc).value for each in data.acquisitions) / 2
        found = data.subject(acc).finding("rate", "mean", rate, "pulse/s", line, {}, ("s0", "s1"))
        return [UnitResult("a", "IMU-7", (found,), (), (), ())]

    (result,) = reduced(mean, RunData("channel", (stated,), (one, other), BENCH), {})
    (found,) = result.findings
    assert found.verdict is None
    assert found.u == pytest.approx(math.hypot(1e-5 * PER_G, 1e-5 * PER_G) / math.sqrt(2), rel=1e-2)


def test_channels_that_send_codes_are_units_of_one_telemetry_channel():
    sent = replace(UNIT, channel_units=dict.fromkeys(CHANNELS, "code"), sent_unit="code")
    assert [(each.telemetry, each.output_unit, each.channel) for each in sent.accelerometers] == [
        ("ax", "code", ""), ("ay", "code", ""), ("az", "code", ""),
    ]  # fmt: skip
    assert [(each.measured_by, each.output_unit, each.row) for each in UNIT.accelerometers] == [
        ("ax", "pulse/s", 0), ("ay", "pulse/s", 1), ("az", "pulse/s", 2),
    ]  # fmt: skip
