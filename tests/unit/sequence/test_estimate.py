"""How long a plan takes and how much it writes, worked out by hand for the shipped benches."""

from __future__ import annotations

import math

import pytest
from pydantic import BaseModel

from bench.config.bench import load_bench
from bench.sequence.estimate.estimate import ANSWER_S, COMMAND_S, estimate
from bench.sequence.plan.motion import REST_S, SEEN_AFTER_S, travel_s
from bench.sequence.steps.custom import StepDescription
from drivers.can import options
from tests.support.sequences import BENCH, ROOT, load_plan, plan_of, steps

RAMP_S = 20 / 40  # the head's 20 °/s at 40 °/s²
HOLD_S = 1.0  # its settle.hold
TABLE = load_bench(ROOT / "config/rate_table.yaml").bench
NEEDS_TABLE = (
    "schema: itb-sequence/1\ntitle: T\nneeds: {table: rate_table, counter: pulse_counter, supply: power_supply}\n"
)


def estimated(folder, *lines, bench=BENCH):
    return estimate(plan_of(folder, steps(*lines)), bench)


def estimated_on_table(folder, *lines):
    return estimate(plan_of(folder, steps(*lines), tail=NEEDS_TABLE, bench=TABLE), TABLE)


def steps_s(expected):
    """Duration of each step, executed once."""
    return tuple(span.duration_s for span in expected.spans)


@pytest.mark.parametrize(
    ("lines", "seconds"),
    [
        (["wait: 90 s"], [90]),
        (["{acquire: counter, for: 5 s, label: a}"], [5]),
        (["{set: supply, output: off}"], [COMMAND_S]),
        (["{soak: unit_temperature, at_least: 5 min}"], [300]),
        (["{measure: unit_temperature, for: 10 s, as: t}", "{measure: unit_temperature, as: u}"], [10, COMMAND_S]),
        (["{tare: counter.x, for: 10 s}"], [10]),
        (["note: It begins.", "alarm: Look!"], [COMMAND_S, COMMAND_S]),
        (["prompt: Do it.", "{prompt: Quickly., give_up_after: 20 s}"], [ANSWER_S, 20]),
        (["{move: head, to: 90°, settle: 2 s}"], [90 / 20 + RAMP_S + SEEN_AFTER_S + HOLD_S + 2]),
    ],
)
def test_what_says_how_long_it_takes_takes_that(tmp_path, lines, seconds):
    assert steps_s(estimated(tmp_path, *lines)) == pytest.approx(seconds)


@pytest.mark.parametrize(
    ("way_deg", "seconds"), [(0, 0), (10, 1.0), (-10, 1.0), (2.5, 2 * math.sqrt(2.5 / 40)), (90, 90 / 20 + 0.5)]
)
def test_a_way_is_a_trapezoid_of_rate_or_a_triangle(way_deg, seconds):
    assert travel_s(way_deg, 20, 40) == pytest.approx(seconds)


def test_a_move_begins_where_the_last_one_ended_and_goes_beyond_only_when_it_comes_from_the_other_side(tmp_path):
    back_s = 2 * math.sqrt(2 / 40)  # 2° is too short for the full rate
    moves = estimated(
        tmp_path,
        "{move: head, to: 90°}",
        "{move: head, to: 90°}",
        "{move: head, by: -90°}",
        "{move: head, to: 90°, approach: from_below}",
        "{move: head, to: 90°, approach: from_above}",
    )
    assert steps_s(moves) == pytest.approx([
        90 / 20 + RAMP_S + SEEN_AFTER_S + HOLD_S,
        SEEN_AFTER_S + HOLD_S,
        90 / 20 + RAMP_S + SEEN_AFTER_S + HOLD_S,
        90 / 20 + RAMP_S + SEEN_AFTER_S + HOLD_S,
        2 * (back_s + SEEN_AFTER_S) + HOLD_S,
    ])  # fmt: skip
    assert [span.state.angles_deg["head"] for span in moves.spans] == [90, 90, 0, 90, 90]


def test_a_ramp_begins_at_the_set_point_that_the_last_one_left(tmp_path):
    ramps = estimated(
        tmp_path,
        "{ramp: chamber, to: 30 °C, at: 2 °C/min}",  # from 20 °C, where the simulated chamber starts
        "{ramp: chamber, to: 30 °C, at: 2 °C/min}",
        "{ramp: chamber, to: -30 °C, at: 3 °C/min}",
    )
    assert steps_s(ramps) == pytest.approx([5 * 60 + COMMAND_S, COMMAND_S, 20 * 60 + COMMAND_S])
    assert [span.state.set_point_c for span in ramps.spans] == [30, 30, -30]


def test_the_bench_after_each_step_has_the_outputs_that_are_on(tmp_path):
    body = steps(
        "{set: supply, voltage: 15 V, current_limit: 120 mA, output: on}",
        "{set: source, acceleration: 2 g, place: a, compliance: 5 V, output: on}",  # K1 is 1.13 mA/g
    )
    off = "teardown:\n  - {set: supply, output: off}\n  - {set: source, output: off}\n"
    spans = estimate(plan_of(tmp_path, body + off), BENCH).spans
    assert [dict(span.state.outputs) for span in spans] == [
        {"supply": 15}, {"supply": 15, "source": pytest.approx(2.26e-3)}, {"source": pytest.approx(2.26e-3)}, {}
    ]  # fmt: skip


def test_a_table_takes_its_time_to_reach_its_rate_and_to_stop_and_what_is_inside_begins_at_the_rate(tmp_path):
    change_s = 30 / 400  # options.acceleration of the table
    inner = "{acquire: counter, turns: 2, of: table, label: a}"
    expected = estimated_on_table(tmp_path, f"{{rotate: table, at: 30 °/s, during: [{inner}]}}", "wait: 1 s")
    around, inside, after = expected.spans
    assert (inside.begin_s, inside.duration_s) == pytest.approx((REST_S + change_s, 2 * 360 / 30))
    assert around.duration_s == after.begin_s == pytest.approx(REST_S + 24 + 2 * change_s)
    assert dict(inside.state.rates_dps) == {"table": 30}
    assert dict(after.state.rates_dps) == {}
    assert after.state.angles_deg["table"] == pytest.approx(30 * (24 + change_s))


def test_turns_are_counted_on_where_the_table_stands(tmp_path):
    expected = estimated_on_table(
        tmp_path, "{move: table, to: 90°}", "{rotate: table, at: -400 °/s, acceleration: 200 °/s², turns: 5}"
    )
    assert steps_s(expected)[1] == pytest.approx(REST_S + 5 * 360 / 400 + 2 * 2)
    assert expected.spans[1].state.angles_deg["table"] == pytest.approx(90 - 5 * 360 - 400 * 2)


def test_each_frequency_of_a_sweep_takes_its_time_to_grow_and_the_table_goes_back_between_them(tmp_path):
    one, swept = steps_s(estimated_on_table(
        tmp_path,
        "{oscillate: table, amplitude: 1°, frequency: 0.5 Hz, for: 10 s}",
        "{oscillate: table, amplitude: 1°, sweep: {from: 4 Hz, to: 8 Hz}, for: 60 s}",  # an octave, in six steps
    ))  # fmt: skip
    assert one == pytest.approx(10 + REST_S + 4 / 0.5)
    back_s = REST_S + 2 * (1 / 400) ** 0.5 + SEEN_AFTER_S + 1  # over 1° at 400 °/s², then it stands for a second
    assert swept == pytest.approx(60 + 7 * (REST_S + 2) + 6 * back_s)


IF = "{{if: \"${{t > '30 °C'}}\", then: [{}], else: [{}]}}"
TIME = "${'1 min' * (t / t)}"
MEASURE = "{measure: unit_temperature, as: t}"


def test_of_alternatives_the_longer_one_counts_and_what_follows_begins_with_its_bench(tmp_path):
    to_40, to_30 = (f"{{ramp: chamber, to: {there} °C, at: 1 °C/min}}" for there in (40, 30))
    expected = estimated(tmp_path, MEASURE, IF.format(to_30, to_40), to_30)
    _, then, otherwise, after = expected.spans
    assert (then.begin_s, otherwise.begin_s) == (COMMAND_S, COMMAND_S)
    assert after.begin_s == otherwise.end_s == pytest.approx(COMMAND_S + 20 * 60 + COMMAND_S)
    assert after.duration_s == pytest.approx(10 * 60 + COMMAND_S)


def test_a_loop_counts_as_often_as_it_may_be_gone_through(tmp_path):
    loop = "{while: \"${t > '30 °C'}\", at_most: 10, steps: [wait: 1 min]}"
    expected = estimated(tmp_path, MEASURE, loop, "wait: 1 s")
    assert [(span.begin_s, span.times) for span in expected.spans] == [
        (0, 1), (COMMAND_S, 10), (pytest.approx(600 + COMMAND_S), 1)
    ]  # fmt: skip
    assert expected.total_s == expected.of_phase("steps") == pytest.approx(601 + COMMAND_S)


def test_branches_begin_together_and_the_longest_counts(tmp_path):
    expected = estimated(tmp_path, "{parallel: {heat: [wait: 10 s, wait: 10 s], turn: [wait: 15 s]}}", "wait: 1 s")
    assert [span.begin_s for span in expected.spans] == [0, 10, 0, 20]


def test_attempts_count_once_and_a_group_with_its_teardown(tmp_path):
    expected = estimated(
        tmp_path,
        "{retry: 3, delay: 10 s, steps: [wait: 5 s]}",
        "{group: g, steps: [wait: 1 s], teardown: [wait: 2 s]}",
        "{acquire: counter, label: a, during: [wait: 3 s, wait: 4 s]}",
    )
    assert [(span.begin_s, span.end_s) for span in expected.spans] == [
        (0, 5), (5, 6), (6, 8), (8, 15), (8, 11), (11, 15)
    ]  # fmt: skip


def test_a_plug_in_tells_from_its_settings_how_long_its_step_takes(tmp_path, monkeypatch):
    class Settings(BaseModel):
        seconds: float

    steps_known = {"degauss": StepDescription("degauss", "T", "m:f", Settings, takes_s=lambda wish: wish.seconds)}
    for user in ("checks.steps", "estimate.estimate"):
        monkeypatch.setattr(f"bench.sequence.{user}.known_steps", lambda: steps_known)
    lines = ("{custom: degauss, with: {seconds: 12}}", "{custom: degauss, with: {seconds: 0}}")
    assert steps_s(estimated(tmp_path, *lines)) == (12, COMMAND_S)


def test_a_step_that_waits_for_a_measurement_is_known_by_what_is_known_of_it(tmp_path):
    expected = estimated(
        tmp_path,
        MEASURE,
        '{ramp: chamber, to: "${t}", at: 1 °C/min}',
        "{move: head, to: \"${'0°' * (t / t)}\", settle: 5 s}",
        '{soak: unit_temperature, at_least: 1 min, until_stable: {band: "${t - t}", slope: 1 °C/h, hold: 10 min}, '
        "give_up_after: 1 h}",
        f'{{wait_until: unit_temperature, above: "${{t}}", hold: 1 min, give_up_after: "{TIME}"}}',
        f'{{wait: "{TIME}"}}',
    )
    assert steps_s(expected) == (COMMAND_S, 0, 5, 600, 60, 0)
    assert expected.spans[-1].state.set_point_c == 20


def test_a_table_whose_motion_a_measurement_will_tell_goes_on_with_the_rest(tmp_path):
    expected = estimated_on_table(
        tmp_path,
        "{measure: counter.Temperatures.Unit, as: t}",
        "{rotate: table, at: \"${'1 °/s' * (t / t)}\", during: [wait: 5 s]}",
        f'{{rotate: table, at: 10 °/s, for: "{TIME}"}}',
        "{oscillate: table, amplitude: 1°, sweep: {from: \"${'1 Hz' * (t / t)}\", to: 2 Hz}, for: 10 s}",
        "wait: 1 s",
    )
    assert [span.duration_s for span in expected.spans[-3:]] == [0, pytest.approx(10 + REST_S + 2), 1]
    assert expected.total_s < 30


def test_the_total_is_the_sum_of_the_phases(tmp_path):
    plan = plan_of(tmp_path, "setup: [wait: 1 s]\nsteps: [wait: 2 s, wait: 3 s]\nteardown: [wait: 4 s]\n")
    expected = estimate(plan, BENCH)
    assert [expected.of_phase(phase) for phase in ("setup", "steps", "teardown")] == [1, 5, 4]
    assert expected.total_s == 10


@pytest.mark.parametrize(
    ("line", "size_bytes"),
    [
        # each second the two channels of the counter, which a named reading is from; the six of the others every 10 s
        ("wait: 1000 s", 25_000 + 250 + 1000 * (2 + 6 / 10) * 25),
        # ten latches of three axes a second besides
        ("{acquire: counter, for: 1000 s, label: a}", 25_000 + 250 + 1000 * (2 + 6 / 10) * 25 + 10_000 * 36),
    ],
)
def test_the_size_is_that_of_the_readings_and_of_the_latches(tmp_path, line, size_bytes):
    assert estimated(tmp_path, line).size_bytes == pytest.approx(size_bytes, abs=1)


def test_a_loop_writes_as_often_as_it_may_be_gone_through(tmp_path):
    acquire = "{acquire: counter, for: 10 s, label: a}"
    loop = f"{{while: \"${{t > '30 °C'}}\", at_most: 10, steps: [{acquire}]}}"
    readings = (100 + COMMAND_S) * 2.6 * 25
    assert estimated(tmp_path, MEASURE, loop).size_bytes == pytest.approx(
        25_000 + 11 * 250 + 1000 * 36 + readings, abs=1
    )


def test_a_bench_without_the_role_takes_the_time_that_the_step_itself_says(tmp_path):
    plan = plan_of(tmp_path, steps("{move: head, to: 90°, settle: 5 s}", "{acquire: counter, for: 9 s, label: a}"))
    bare = BENCH.model_copy(update={"devices": {}, "readings": {}})
    expected = estimate(plan, bare)
    assert steps_s(expected) == (5, 9)
    assert expected.size_bytes == 25_000 + 2 * 250 + 9 * 36  # one latch a second where no counter says otherwise


@pytest.mark.parametrize(
    ("preset", "bench_s", "run_db_bytes"), [(None, 118_272, 11_583_488), ("quick", 59_980, 5_406_720)]
)
def test_the_long_sequence_takes_and_writes_what_its_run_on_the_simulated_bench_did(preset, bench_s, run_db_bytes):
    """The figures are those of `bench run tumble_static`, which takes half a minute."""
    expected = estimate(load_plan(ROOT / "sequences/tumble_static.yaml", BENCH, preset=preset), BENCH)
    assert expected.total_s == pytest.approx(bench_s, rel=0.005)
    assert expected.size_bytes == pytest.approx(run_db_bytes, rel=0.05)


def test_a_dbc_is_read_no_more_often_for_many_soaks_than_for_one(tmp_path, monkeypatch):
    soak = (
        "{soak: unit_temperature, at_least: 1 min, until_stable: {band: 0.2 °C, slope: 1 °C/h, hold: 10 min}, "
        "give_up_after: 2 h}"
    )
    one, many = plan_of(tmp_path, steps(soak)), plan_of(tmp_path, steps(*[soak] * 5))
    read, text_of = [], options.text_of
    monkeypatch.setattr(options, "text_of", lambda dbc: read.append(dbc) or text_of(dbc))
    estimate(one, BENCH)
    of_one = len(read)
    estimate(many, BENCH)
    assert len(read) == 2 * of_one > 0
