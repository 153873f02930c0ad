"""How long a plan takes and how much it writes, worked out by hand for the shipped bench."""

from __future__ import annotations

import pytest

from bench.sequence.estimate import COMMAND_S, estimate
from tests.support.sequences import BENCH, plan_of, steps

RAMP_S = 20 / 40  # the head's 20 °/s at 40 °/s²
HOLD_S = 1.0  # its settle.hold


def estimated(folder, *lines, bench=BENCH):
    return estimate(plan_of(folder, steps(*lines)), bench)


@pytest.mark.parametrize(
    ("lines", "seconds"),
    [
        (["wait: 90 s"], [90]),
        (["{acquire: counter, for: 5 s, label: a}"], [5]),
        (["{set: supply, output: off}"], [COMMAND_S]),
        (["{soak: unit_temperature, at_least: 5 min}"], [300]),
        (["{wait_until: unit_temperature, above: 5 °C, hold: 1 min, give_up_after: 1 h}"], [60]),
        (["note: It begins."], [COMMAND_S]),
        (
            ["{soak: unit_temperature, at_least: 5 s, until_stable: {band: 1 °C, slope: 1 °C/h, hold: 10 min}, "
             "give_up_after: 1 h}"],
            [600],
        ),
        (
            ["{soak: unit_temperature, at_least: 30 min, until_stable: {band: 1 °C, slope: 1 °C/h, hold: 10 min}, "
             "give_up_after: 1 h}"],
            [1800],
        ),
    ],
)  # fmt: skip
def test_waiting_and_counting_take_what_they_say(tmp_path, lines, seconds):
    assert estimated(tmp_path, *lines).steps_s == pytest.approx(seconds)


def test_a_move_takes_its_way_its_ramp_and_its_settling_from_where_the_last_one_ended(tmp_path):
    assert estimated(
        tmp_path,
        "{move: head, to: 90°}",
        "{move: head, to: 90°}",
        "{move: head, to: 0°, settle: 5 s}",
        "{move: head, to: 90°, approach: from_below}",
        "{move: head, to: 90°, approach: from_above}",
    ).steps_s == pytest.approx([
        90 / 20 + RAMP_S + HOLD_S,
        HOLD_S,
        90 / 20 + RAMP_S + HOLD_S + 5,
        88 / 20 + RAMP_S + 2 / 20 + RAMP_S + HOLD_S,
        2 / 20 + RAMP_S + 2 / 20 + RAMP_S + HOLD_S,
    ])  # fmt: skip


def test_a_ramp_begins_at_the_set_point_that_the_last_one_left(tmp_path):
    assert estimated(
        tmp_path,
        "{ramp: chamber, to: 30 °C, at: 2 °C/min}",  # from 20 °C, where the simulated chamber starts
        "{ramp: chamber, to: 30 °C, at: 2 °C/min}",
        "{ramp: chamber, to: -30 °C, at: 3 °C/min}",
    ).steps_s == pytest.approx([5 * 60 + COMMAND_S, COMMAND_S, 20 * 60 + COMMAND_S])


def test_the_total_is_the_sum_of_the_phases(tmp_path):
    plan = plan_of(tmp_path, "setup: [wait: 1 s]\nsteps: [wait: 2 s, wait: 3 s]\nteardown: [wait: 4 s]\n")
    expected = estimate(plan, BENCH)
    assert [expected.of_phase(phase) for phase in ("setup", "steps", "teardown")] == [1, 5, 4]
    assert expected.total_s == 10


@pytest.mark.parametrize(
    ("line", "size_bytes"),
    [
        # each second the two channels of the counter, which a named reading is from; the six of the others every 10 s
        ("wait: 1000 s", 100_000 + 1000 * (2 + 6 / 10) * 40),
        # ten latches of three axes a second besides
        ("{acquire: counter, for: 1000 s, label: a}", 100_000 + 1000 * (2 + 6 / 10) * 40 + 10_000 * 12),
    ],
)
def test_the_size_is_that_of_the_readings_and_of_the_latches(tmp_path, line, size_bytes):
    assert estimated(tmp_path, line).size_bytes == pytest.approx(size_bytes, abs=1)


def test_a_bench_without_the_role_takes_the_time_that_the_step_itself_says(tmp_path):
    plan = plan_of(tmp_path, steps("{move: head, to: 90°, settle: 5 s}", "{acquire: counter, for: 9 s, label: a}"))
    bare = BENCH.model_copy(update={"devices": {}, "readings": {}})
    expected = estimate(plan, bare)
    assert expected.steps_s == (5, 9)
    assert expected.size_bytes == 100_000 + 9 * 12  # one latch a second where no counter says otherwise
