"""Where the axes of a plan stand before each of its steps, over whole turns, and limits found on the way."""

from __future__ import annotations

import pytest

from bench.config.bench import load_bench
from bench.sequence.plan.poses import PASSES_LOOKED_AT, angles_before, poses_before
from bench.sequence.steps.measuring import Acquire
from bench.sequence.steps.stimulus import Move
from tests.support.sequences import BENCH, ROOT, load_plan, plan_of, problems_of, steps

TABLE = load_bench(ROOT / "config/rate_table.yaml").bench
TABLE_TAIL = """\
schema: itb-sequence/1
title: Test
needs: {table: rate_table, head: positioner, counter: pulse_counter, unit_temperature: thermometer}
"""
MEASURE = "{measure: unit_temperature, as: t}"
WARM = "\"${t > '30 °C'}\""
FREE = BENCH.model_copy(
    update={
        "devices": {
            **BENCH.devices,
            "head": BENCH.devices["head"].model_copy(
                update={"limits": type(BENCH.devices["head"].limits).model_validate(
                    {"angle": {"min": "-5000°", "max": "5000°"}, "rate": {"max": "30 °/s"}}
                )}
            ),
        }
    }
)  # fmt: skip


def angles(folder, *lines, bench=FREE, **options):
    """The angle before each step, and at the end."""
    plan = plan_of(folder, steps(*lines, "{move: head, by: 0°}"), bench=bench, **options)
    return [
        round(from_deg, 9) for planned, from_deg in angles_before(plan) if planned.id.rpartition("/")[2] != "measure"
    ]


def test_axes_begin_at_zero_and_steps_without_an_axis_stand_nowhere(tmp_path):
    plan = plan_of(tmp_path, steps("{move: head, to: 90°}", "wait: 1 s", "{move: head, by: 5°}"))
    assert [from_deg for _, from_deg in angles_before(plan)] == [0.0, 0.0, 90.0]


def test_relative_moves_add_up_over_a_loop_and_over_the_phases(tmp_path):
    body = "setup: [{move: head, to: 10°}]\n" + steps("{repeat: 3, steps: [{move: head, by: 90°}]}")
    plan = plan_of(tmp_path, body + "teardown: [{move: head, to: 0°}]\n", bench=FREE)
    assert [from_deg for _, from_deg in angles_before(plan)] == [0.0, 10.0, 100.0, 190.0, 280.0]


def test_ways_modulo_a_turn_add_up_to_turns(tmp_path):
    loop = "{for_each: a, in: [90°, 180°, 270°, 0°, 90°], steps: [{move: head, to: '${a}', way: increasing}]}"
    assert angles(tmp_path, loop) == [0, 90, 180, 270, 360, 450]
    back = loop.replace("increasing", "decreasing")
    assert angles(tmp_path, back) == [0, -270, -540, -810, -1080, -1350]
    assert angles(tmp_path, loop.replace("increasing", "nearest")) == [0, 90, 180, 270, 360, 450]


def test_a_rotation_of_known_length_goes_on_from_there_and_one_around_other_steps_is_not_counted(tmp_path):
    plan = plan_of(
        tmp_path,
        steps(
            "{rotate: table, at: -10 °/s, turns: 2}",
            "{rotate: table, at: 10 °/s, for: 9 s}",
            "{rotate: table, at: 10 °/s, during: [wait: 9 s]}",
            "{rotate: table, at: 10 °/s, turns: 1}",
        ),
        tail=TABLE_TAIL.replace(" head: positioner,", ""),
        bench=TABLE,
    )
    assert [from_deg for planned, from_deg in angles_before(plan) if "wait" not in planned.id] == [0, -720, -630, -630]


def test_each_axis_stands_for_itself(tmp_path):
    body = steps("{move: head, to: 90°}", "{move: table, by: 30°}", "{move: head, by: 5°}", "{move: table, by: 5°}")
    plan = plan_of(tmp_path, body, tail=TABLE_TAIL.replace("rate_table", "positioner"), bench=None)
    assert [from_deg for _, from_deg in angles_before(plan)] == [0, 0, 90, 30]


def test_both_alternatives_begin_at_the_same_angle(tmp_path):
    block = f"{{if: {WARM}, then: [{{move: head, by: 90°}}], else: [{{move: head, by: 5°}}]}}"
    assert angles(tmp_path, "{move: head, to: 10°}", MEASURE, block)[:3] == [0, 10, 10]


@pytest.mark.parametrize(
    "block",
    [
        "{group: g, steps: [{move: head, by: 30°}], teardown: [{move: head, by: 60°}]}",
        "{retry: 2, steps: [{move: head, by: 30°}, {move: head, by: 60°}]}",
        "{parallel: {a: [{move: head, by: 30°}, {move: head, by: 60°}], b: [wait: 1 s]}}",
        "{acquire: counter, label: a, during: [{move: head, by: 30°}, {move: head, by: 60°}]}",
    ],
)
def test_moves_inside_other_blocks_are_followed(tmp_path, block):
    assert angles(tmp_path, block)[-1] == 90


def test_a_measured_loop_is_followed_as_often_as_it_may_be_gone_through(tmp_path):
    loop = f"{{while: {WARM}, at_most: 5, steps: [{{move: head, by: 90°}}]}}"
    assert angles(tmp_path, MEASURE, loop) == [0, 90, 180, 270, 360, 450]


def test_a_measured_loop_that_comes_back_is_followed_until_it_does(tmp_path):
    loop = f"{{while: {WARM}, at_most: 900, steps: [{{move: head, to: 90°}}, {{move: head, to: 0°}}]}}"
    assert angles(tmp_path, "{move: head, to: 0°}", MEASURE, loop) == [0, 0, 90, 0]
    retry_once = loop.replace("{move: head, to: 0°}", "wait: 1 s")
    assert angles(tmp_path, MEASURE, retry_once) == [0, 0, 90, 0, 90]


def test_a_measured_loop_is_followed_in_bounded_time(tmp_path):
    loop = f"{{while: {WARM}, at_most: 1000000, steps: [{{move: head, by: 1°}}]}}"
    assert angles(tmp_path, MEASURE, loop)[-1] == PASSES_LOOKED_AT


@pytest.mark.parametrize(
    ("lines", "problem"),
    [
        (("{repeat: 9, steps: [{move: head, by: 90°}]}",),
         "2:38: by: 450 ° is above the 365 ° that the bench file allows 'head' (step steps/pass=5/move)"),
        ((MEASURE, f"{{while: {WARM}, at_most: 9, steps: [{{move: head, by: -2°}}]}}",),
         "3:64: by: -6 ° is below the -5 ° that the bench file allows 'head' (step steps/while/pass=3/move)"),
        (("{for_each: a, in: [0°, 120°, 240°, 0°], steps: [{move: head, to: '${a}', way: increasing}, wait: 1 s]}",
          "{move: head, to: 10°, way: increasing}"),
         "3:18: to: 370 ° is above the 365 ° that the bench file allows 'head' (step steps/move)"),
        (("{move: head, to: 360°}", "{retry: 3, steps: [{move: head, by: 6°}]}"),
         "3:37: by: 366 ° is above the 365 ° that the bench file allows 'head' (step steps/retry/move)"),
        (("{move: head, to: 180°}", "{move: head, to: 0°, way: nearest}", "{move: head, by: 10°}"),
         "4:18: by: 370 ° is above the 365 ° that the bench file allows 'head' (step steps/move#3)"),
    ],
)  # fmt: skip
def test_a_limit_is_found_at_the_pass_that_reaches_it(tmp_path, lines, problem):
    assert problems_of(tmp_path, steps(*lines)) == [problem]


def test_the_indexing_table_comes_to_every_angle_from_below_and_from_above():
    bench = load_bench(ROOT / "config/indexing.yaml").bench
    plan = load_plan(ROOT / "sequences/indexing_static.yaml", bench, settings=("step=0.25°", "largest=0.5°"))
    came: dict[float, set[str]] = {}
    side = ""
    for planned, pose in poses_before(plan, bench):
        head_deg = pose.angles_deg.get("head", 0.0)
        if isinstance(planned.step, Acquire):
            came.setdefault(head_deg, set()).add(side)
        elif isinstance(planned.step, Move) and planned.step.target_deg(head_deg) != head_deg:
            assert planned.step.approach == "direct", planned.id
            side = "below" if planned.step.target_deg(head_deg) > head_deg else "above"
    assert {angle for angle, sides in came.items() if sides >= {"below", "above"}} >= {-0.25, 0.0, 0.25}
