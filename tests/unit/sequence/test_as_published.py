"""Presets `as_published`: what they plan is the schedule of their source, to the minute."""

from __future__ import annotations

import math

from bench.config.bench import load_bench
from bench.sequence.checks.swings import acquired_inside
from bench.sequence.load import load_judged_plan
from bench.sequence.steps.measuring import Acquire
from bench.sequence.steps.orienting import Orient
from bench.sequence.steps.stimulus import Move, Oscillate, Ramp, Rotate, SetOutput
from tests.support.sequences import ELSEWHERE, ROOT

MIN_S = 60.0
RATES_DPS = [1, -1, 3, -3, 5, -5]
OFFSETS_C = [0, 30, 20, 10, 0, -10, -20, -25, -30, -35, -40]


def planned(name, bench=None, *settings):
    bench = load_bench(ROOT / f"config/{bench or ELSEWHERE[name][0]}.yaml").bench
    return load_judged_plan(ROOT / f"sequences/{name}.yaml", bench, preset="as_published", settings=settings)[0]


def steps_of(plan, kind):
    return [each.step for each in plan if isinstance(each.step, kind)]


def peak_rate_dps(motion):
    return 2 * math.pi * motion.highest_hz * motion.amplitude_deg


def setting(plan, name):
    return plan.sequence.results[0].settings[name]


def test_a_set_point_of_an_inertial_unit_takes_84_minutes_of_measuring():
    plan = planned("imu_24_position")
    inside = acquired_inside(plan, "imu")
    seconds = {
        each.id: each.step.duration_s if motion is None else 360 * each.step.turns / abs(motion.rate_dps)
        for each, motion in inside
    }
    assert {round(each, 6) for each in seconds.values()} == {2 * MIN_S}
    assert len(seconds) == 11 * (24 + 18)
    assert sum(seconds.values()) / 11 == 84 * MIN_S


def test_set_points_attitudes_and_rates_come_in_the_order_of_the_source():
    plan = planned("imu_24_position", None, "nominal=15 °C")
    set_points = [each.temperature_c for each in steps_of(plan, Ramp)]
    assert set_points[1:12] == [15 + offset for offset in OFFSETS_C]
    assert len(set(set_points[1:12])) == 10
    at_one = [each for each in plan if each.id.startswith("steps/temperature=45/")]
    rates = [each.step.rate_dps for each in at_one if isinstance(each.step, Rotate)]
    assert rates == RATES_DPS * 3
    kinds = [type(each.step).__name__ for each in at_one if isinstance(each.step, (Orient, Rotate))]
    assert kinds == (["Orient"] * 9 + ["Rotate"] * 6) * 3


def test_whole_turns_remain_the_default():
    bench = load_bench(ROOT / "config/imu.yaml").bench
    plan, _ = load_judged_plan(ROOT / "sequences/imu_24_position.yaml", bench)
    turns = [each.step.turns for each, motion in acquired_inside(plan, "imu") if motion is not None]
    assert set(turns) == {1, 2}


def test_a_static_tumble_powers_on_after_the_soak_and_measures_four_positions_twice():
    plan = planned("tumble_static", "volts")
    dwell = [each.step for each in plan if each.id.startswith("steps/cycle=1/temperature=70/")]
    kinds = [type(each).__name__ for each in dwell]
    assert kinds == ["Ramp", "Soak", "SetOutput", "WaitUntil", *["Move", "Acquire"] * 8, "SetOutput"]
    assert [each.output for each in dwell if isinstance(each, SetOutput)] == ["on", "off"]
    assert [each.target_deg(0) for each in dwell if isinstance(each, Move)] == [0, 90, 180, 270] * 2
    assert dwell[1].at_least_s == 60 * MIN_S
    temperatures = {each.temperature_c for each in steps_of(plan, Ramp)} - {25}
    assert temperatures == {10 * tens for tens in range(-4, 8)}


def test_a_ramp_goes_twice_from_minus_40_to_80_degrees_at_3_degrees_a_minute():
    plan = planned("ramp_dynamic", "volts")
    ramps = [each for each in plan if each.id.startswith("steps/") and isinstance(each.step, Ramp)]
    assert [each.step.temperature_c for each in ramps] == [80, -40] * 4
    assert {each.step.rate_c_per_min for each in ramps} == {3}
    assert [each.target_deg(0) for each in steps_of(plan, Move)][:2] == [0, 90]


def test_frequencies_are_whole_ones_from_10_to_100_hz_at_3_degrees_per_second_for_10_seconds():
    for name in ("gyro_response", "accel_response"):
        plan = planned(name)
        swings = [(each.step, motion) for each, motion in acquired_inside(plan, "sweep")][-91:]
        assert [round(motion.highest_hz, 9) for _, motion in swings] == list(range(10, 101))
        assert {round(peak_rate_dps(motion), 9) for _, motion in swings} == {3}
        assert {step.duration_s for step, _ in swings} == {10}


def test_the_slow_oscillation_and_the_setting_for_it_are_one_parameter():
    plan = planned("accel_response", None, "lever_frequency=0.4 Hz")
    assert steps_of(plan, Oscillate)[0].highest_hz == 0.4
    assert setting(plan, "lever_frequency") == "0.4 Hz"


def test_a_range_begins_with_10_seconds_at_rest_at_one_angle_and_goes_both_ways():
    for name in ("gyro_range", "accel_range"):
        plan = planned(name)
        inside = [(each.step.duration_s, motion) for each, motion in acquired_inside(plan, "range")]
        assert {seconds for seconds, _ in inside} == {10}
        assert [motion is None for _, motion in inside] == [True, *[False] * (len(inside) - 2), True]
        rates = [motion.rate_dps for _, motion in inside[1:-1]]
        assert rates[::2] == [-each for each in rates[1::2]]


def test_levels_are_compared_by_their_raw_slopes_after_ramps_of_30_degrees_an_hour():
    for name in ("channel_full", "channel_source", "channel_gravity", "channel_skew"):
        plan = planned(name)
        inner = [each for each in plan if isinstance(each.step, Ramp) and "acquire" in each.id]
        assert {round(each.step.rate_c_per_min * 60, 9) for each in inner} == {30}
    assert setting(planned("channel_full"), "compare_basis") == "raw"
    bench = load_bench(ROOT / "config/channel.yaml").bench
    usual, _ = load_judged_plan(ROOT / "sequences/channel_full.yaml", bench)
    assert setting(usual, "compare_basis") == "normalised"


def test_an_indexing_table_goes_up_to_the_largest_angle_and_back_without_a_loop_before():
    plan = planned("indexing_static")
    up = [each for each in plan if "pass=1/end=up/" in each.id and isinstance(each.step, (Move, Acquire))]
    angles = [round(each.step.target_deg(0), 9) for each in up if isinstance(each.step, Move)]
    assert angles == [0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.5, 0.4, 0.3, 0.2, 0.1, 0]
    assert [type(each.step).__name__ for each in up] == ["Move", "Acquire"] * 12
