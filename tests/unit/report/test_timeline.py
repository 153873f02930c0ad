"""The timeline of a plan as text, as JSON, and drawn."""

from __future__ import annotations

import json
import math
import re
from xml.etree import ElementTree

import pytest

from bench.config.bench import load_bench
from bench.errors import InputError
from bench.report.plan_view.content import planned
from bench.report.plan_view.picture import write_picture
from bench.report.plan_view.timeline import plan_table, safe_states, timeline_json
from bench.sequence.estimate.estimate import estimate
from tests.support.sequences import BENCH, ROOT, load_plan, plan_of, steps

TABLE = load_bench(ROOT / "config/rate_table.yaml").bench
TREE = """\
setup:
  - {set: supply, voltage: 15 V, current_limit: 120 mA, output: on}
steps:
  - {prompt: Put the unit on the fixture.}
  - {measure: unit_temperature, for: 10 s, as: t}
  - if: ${t > '30 °C'}
    then: [{ramp: chamber, to: 30 °C, at: 1 °C/min}, {wait: 20 min}]
    else: [{ramp: chamber, to: 40 °C, at: 1 °C/min}]
  - while: ${t > '20 °C'}
    at_most: 10
    steps: [{wait: 1 min}]
  - parallel:
      heat: [{ramp: chamber, to: 60 °C, at: 2 °C/min}, {soak: unit_temperature, at_least: 30 min}]
      turn:
        - retry: 3
          delay: 10 s
          steps: [{move: head, to: 90°}]
  - group: feed
    on_failure: continue
    steps:
      - {set: source, current: 1 mA, compliance: 5 V, output: on}
      - acquire: counter
        label: background
        during: [{wait: 30 s}, {move: head, to: 270°}]
    teardown: [{set: source, output: off}]
teardown:
  - {set: supply, output: off}
"""
TURNING = """\
steps:
  - {move: table, to: 90°}
  - rotate: table
    at: 30 °/s
    during: [{acquire: counter, turns: 20, of: table, label: turning}]
  - {oscillate: table, amplitude: 1°, frequency: 0.5 Hz, for: 10 s}
  - {move: table, to: 0°}
schema: itb-sequence/1
title: T
needs: {table: rate_table, counter: pulse_counter}
"""


@pytest.fixture
def tree(tmp_path):
    plan = plan_of(tmp_path, TREE)
    return plan, estimate(plan, BENCH)


@pytest.fixture
def turning(tmp_path):
    plan = plan_of(tmp_path, TURNING, tail="", bench=TABLE)
    return plan, estimate(plan, TABLE)


def test_each_step_has_its_time_and_the_bench_after_it_and_each_decision_a_line(tree):
    assert list(plan_table(*tree, BENCH)) == [
        "   begins        takes  chamber  head  supply  source   resumed  step",
        "  0:00:00          0 s    20 °C    0°    15 V     off  restored  setup/set",
        "  0:00:00         60 s    20 °C    0°    15 V     off     asked  steps/prompt",
        "  0:01:00         10 s    20 °C    0°    15 V     off     again  steps/measure",
        "                                                                 if ${t > '30 °C'}",
        "  0:01:10       10 min    30 °C    0°    15 V     off  restored    steps/then/ramp",
        "  0:11:10       20 min    30 °C    0°    15 V     off   in full    steps/then/wait",
        "                                                                 else",
        "  0:01:10       20 min    40 °C    0°    15 V     off  restored    steps/else/ramp",
        "                                                                 while ${t > '20 °C'}, at most 10 passes",
        "  0:31:10         60 s    30 °C    0°    15 V     off   in full    steps/while/pass=1/wait",
        "                                                                 parallel: heat",
        "  0:41:10       15 min    60 °C    0°    15 V     off  restored    steps/parallel/heat/ramp",
        "  0:56:10       30 min    60 °C    0°    15 V     off   in full    steps/parallel/heat/soak",
        "                                                                 parallel: turn",
        "                                                                   retry, 3 attempts, 10 s between them",
        "  0:41:10          6 s    60 °C   90°    15 V     off  restored      steps/parallel/turn/retry/move",
        "                                                                 group steps/feed, on failure: continue",
        "  1:26:10          0 s    60 °C   90°    15 V    1 mA  restored    steps/feed/set",
        "  1:26:10         41 s    60 °C  270°    15 V    1 mA      anew    steps/feed/acquire",
        "  1:26:10         30 s    60 °C   90°    15 V    1 mA   in full      steps/feed/acquire/wait",
        "  1:26:40         11 s    60 °C  270°    15 V    1 mA  restored      steps/feed/acquire/move",
        "                                                                 in any case after steps/feed",
        "  1:26:51          0 s    60 °C  270°    15 V     off  restored    steps/feed/teardown/set",
        "  1:26:51          0 s    60 °C  270°     off     off  restored  teardown/set",
    ]


def test_while_a_table_turns_its_rate_is_shown_and_what_does_not_occur_has_no_column(turning):
    lines = list(plan_table(*turning, TABLE))
    assert lines[0].split() == ["begins", "takes", "table", "resumed", "step"]
    assert [re.split("  +", line.strip())[2] for line in lines[1:]] == [
        "90°", "7292.25°", "30 °/s", "7292.25°", "0°"
    ]  # fmt: skip


def test_no_line_is_wider_than_a_terminal_and_of_a_long_id_the_end_is_kept(tmp_path):
    inner = "{for_each: position_of_the_head, in: [0°, 90°], steps: [{move: head, to: 0°}]}"
    outer = f"{{for_each: temperature_of_the_chamber, in: [20 °C, 30 °C], steps: [{inner}]}}"
    plan = plan_of(tmp_path, steps(f"{{group: a_group_with_a_rather_long_name, steps: [{outer}]}}"))
    table = list(plan_table(plan, estimate(plan, BENCH), BENCH))
    assert max(map(len, table)) == 120
    assert "  …" in table[1]
    assert table[1].endswith("the_chamber=20/position_of_the_head=0/move")


def test_levels_that_a_measurement_will_tell_are_not_known(tmp_path):
    measure = "{measure: supply.current, as: i}"
    on = '{set: source, current: "${i}", compliance: 5 V, output: on}'
    plan = plan_of(tmp_path, steps(measure, on) + "teardown: [{set: source, output: off}]\n")
    expected = estimate(plan, BENCH)
    assert "? A" in list(plan_table(plan, expected, BENCH))[2]
    content = timeline_json(expected, BENCH)
    assert content["steps"][1]["outputs"] == {"source": None}
    assert json.dumps(content, allow_nan=False)


def test_json_has_the_same_numbers(tree):
    plan, expected = tree
    content = timeline_json(expected, BENCH)
    assert content["total_s"] == expected.total_s == sum(content["phases_s"].values())
    assert [step["id"] for step in content["steps"]] == [planned.id for planned in plan]
    loop = next(step for step in content["steps"] if step["id"] == "steps/while/pass=1/wait")
    assert (loop["times"], loop["duration_s"], loop["set_point_c"]) == (10, 60, 30)


def drawn(plan, expected, bench):
    content = planned(plan, expected, bench)
    return {panel.label: panel for panel in content.panels}, content


def test_a_line_stays_between_the_steps_that_change_it(tree):
    panels, _ = drawn(*tree, BENCH)
    assert list(panels) == ["set point / °C", "angle / °", "output / V", "output / mA"]
    chamber = panels["set point / °C"].lines["chamber"]
    assert [value for _, value in chamber] == [20, 20, 30, 30, 60, 60]
    assert [at_s for at_s, _ in chamber] == pytest.approx([0, 70, 670, 2470, 3370, 5211], abs=1)
    assert [value for _, value in panels["output / mA"].lines["source"]] == [0, 0, 1, 1, 0, 0]
    assert [value for _, value in panels["output / V"].lines["supply"]] == [0, 0, 15, 15, 0, 0]


def test_bars_are_where_time_is_spent_and_loops_are_marked(tree):
    _, content = drawn(*tree, BENCH)
    assert list(content.bars) == ["prompt", "soak", "wait", "measure", "acquire background"]
    assert content.bars["prompt"] == [pytest.approx((0.05, 60.05))]
    assert content.chosen, "the ramp to 40 °C is not shown"
    assert len(content.bars["wait"]) == 3
    ((begin_s, end_s, count),) = content.passes
    assert (end_s - begin_s, count) == (pytest.approx(540), 9)


def test_turning_has_a_rate_and_no_angle_until_it_ends_many_turns_away(turning):
    panels, content = drawn(*turning, TABLE)
    assert list(panels) == ["angle / °", "rate / °/s"]
    rate = panels["rate / °/s"]
    assert [value for _, value in rate.lines["table"]] == [0, 0, 30, 30, 0, 0]
    assert [far for _, _, far in rate.swings] == [pytest.approx(math.pi)]
    angles = [value for _, value in panels["angle / °"].lines["table"]]
    assert angles[2] == 90
    assert math.isnan(angles[4])
    assert 7292.25 % 360 in angles
    assert not content.chosen


def texts(path):
    return ["".join(found.itertext()) for found in ElementTree.parse(path).iter("{http://www.w3.org/2000/svg}text")]


@pytest.mark.lengthy
def test_the_picture_has_a_panel_for_each_thing_that_occurs(tree, tmp_path):
    path = tmp_path / "plan.svg"
    write_picture(path, *tree, BENCH)
    found = texts(path)
    for label in ("set point / °C", "angle / °", "output / V", "output / mA", "soak", "prompt", "acquire background",
                  "up to 9 passes more", "60"):  # fmt: skip
        assert label in found
    assert "rate / °/s" not in found
    assert any("of alternatives the longer one is shown" in text for text in found)
    again = tmp_path / "again.svg"
    write_picture(again, *tree, BENCH)
    assert again.read_bytes() == path.read_bytes()


@pytest.mark.parametrize(
    ("name", "unit", "panels"),
    [("smoke", "s", 3), ("tumble_static", "h", 3)],
)
def test_the_shipped_sequences_are_drawn_in_a_unit_that_suits_them(tmp_path, name, unit, panels):
    plan = load_plan(ROOT / f"sequences/{name}.yaml", BENCH)
    write_picture(tmp_path / "plan.svg", plan, estimate(plan, BENCH), BENCH)
    found = texts(tmp_path / "plan.svg")
    assert f"time since the run began / {unit}" in found
    assert sum(text.endswith(("°C", "/ °", "/ V")) for text in found) == panels


def test_two_axes_in_one_panel_have_a_legend(tmp_path):
    bench = TABLE.model_copy(update={"devices": {**TABLE.devices, "other": TABLE.devices["table"]}})
    body = "steps: [{move: table, to: 90°}, {move: other, to: 45°}]\nschema: itb-sequence/1\ntitle: T\n"
    plan = plan_of(tmp_path, body, tail="needs: {table: positioner, other: positioner}\n", bench=bench)
    write_picture(tmp_path / "plan.svg", plan, estimate(plan, bench), bench)
    assert {"table", "other"} <= set(texts(tmp_path / "plan.svg"))


def test_a_page_has_the_picture_the_parameters_and_every_step(tmp_path):
    plan = load_plan(ROOT / "sequences/tumble_static.yaml", BENCH, preset="quick")
    write_picture(tmp_path / "plan.html", plan, estimate(plan, BENCH), BENCH)
    page = (tmp_path / "plan.html").read_text("utf-8")
    assert page.count("<svg ") == page.count("</svg>") == 1
    assert "tumble_static.yaml, preset quick" in page
    assert "<dt>Parameter warm_up</dt><dd>2 h</dd>" in page
    assert page.count("/acquire\n") == 72
    assert not re.search(r'(?:src|href)="(?!#)', page), "nothing refers to elsewhere"


def test_a_picture_has_a_form_and_a_place(tree, tmp_path):
    with pytest.raises(InputError, match=r"plan.png: a picture is written as .svg or .html"):
        write_picture(tmp_path / "plan.png", *tree, BENCH)
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be written"):
        write_picture(tmp_path / "file" / "plan.svg", *tree, BENCH)


def test_every_step_says_what_a_resumed_run_does_with_it(tree):
    plan, expected = tree
    content = timeline_json(expected, BENCH)
    found = {planned.id: step["if_resumed"] for planned, step in zip(plan, content["steps"], strict=True)}
    assert set(found.values()) == {"restored", "in full", "again", "anew", "asked"}
    table = list(plan_table(plan, expected, BENCH))
    assert "resumed" in table[0]
    assert re.search(r"asked +steps/prompt$", "\n".join(table), re.M)


def test_a_group_says_where_a_resumed_run_begins_again(tmp_path):
    plan = plan_of(tmp_path, steps("{group: order, restart_at: begin, steps: [{wait: 1 s}]}"))
    table = list(plan_table(plan, estimate(plan, BENCH), BENCH))
    assert table[1].endswith("group steps/order, if interrupted: again from its begin")


def test_what_making_safe_does_and_how_long_it_may_take():
    lines = list(safe_states(TABLE))
    (table,) = (line for line in lines if line.startswith("table"))
    entry = TABLE.devices["table"]
    stop_s = entry.limits.rate.max / entry.options.acceleration
    assert table.endswith(f"at rest where it is  within {stop_s + 5:.3g} s")
    assert not [line for line in lines if line.startswith("counter")]
