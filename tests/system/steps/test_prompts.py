"""Questions to people: answered by a script on simulated instruments, over the socket in paced runs."""

from __future__ import annotations

import json
import re

import pytest

from bench.errors import InputError
from bench.store.reader import RunReader
from tests.support.runs import run_short
from tests.support.sequences import TAIL, steps

POWER = "{set: supply, voltage: 15 V, current_limit: 120 mA, output: on}"
OFF = "teardown:\n  - {set: supply, output: off}\n  - {move: head, to: 0°}\n"
TURN = "{prompt: Fix the unit upside down., expect: {mount: inverted}, as: done}"
UP = "{move: head, to: 90°}"
COUNT = "{measure: counter.x, for: 5 s, as: rate, limits: {max: 0 pulse/s}}"


def ran(tmp_path, *lines, answers=None, **options):
    path = tmp_path / "s.yaml"
    path.write_text(steps(*lines) + OFF + TAIL, "utf-8")
    if answers is not None:
        options["answers"] = tmp_path / "answers.yaml"
        options["answers"].write_text("schema: itb-answers/1\nanswers: " + json.dumps(answers) + "\n", "utf-8")
    return run_short(tmp_path / "runs", sequence=str(path), **options)


def ended(result):
    with RunReader(result.path) as reader:
        return {event.step: event for event in reader.events("step_ended")}


def test_a_technician_who_does_what_he_is_asked_turns_the_unit_and_the_reading_proves_it(tmp_path):
    result = ran(tmp_path, POWER, UP, TURN, COUNT)
    assert result.outcome.how == "completed"
    prompt = ended(result)["steps/prompt"].data
    assert (prompt["value"], prompt["by"], prompt["mount"]) == ("done", "scripted technician", "inverted")
    assert ended(result)["steps/measure"].data["value"] < -10_000
    assert result.results.verdict == "PASS"


def test_a_technician_who_says_done_and_does_nothing_is_found_out_by_the_reading(tmp_path):
    result = ran(tmp_path, POWER, UP, TURN, COUNT, answers={"steps/prompt": {"does": {}, "by": "A. Hurry"}})
    assert ended(result)["steps/prompt"].data["by"] == "A. Hurry"
    assert ended(result)["steps/measure"].data["value"] > 10_000
    assert result.results.verdict == "FAIL"


def test_an_answer_takes_its_time_and_is_known_to_expressions(tmp_path):
    ask = "{prompt: How warm is the room?, input: {unit: °C, min: 10 °C, max: 40 °C}, as: room}"
    wait = "{if: '${room > ''21 °C''}', then: [note: 'warm, ${room}'], else: [note: cold]}"
    result = ran(tmp_path, ask, wait, answers={"steps/prompt": {"answer": "21.5 °C", "after": "10 min"}})
    done = ended(result)
    assert done["steps/prompt"].at_s == pytest.approx(600, abs=5)
    assert done["steps/then/note"].data == {"note": "warm, 21.5 °C"}


def test_at_full_speed_nobody_can_type_so_that_a_script_must(tmp_path):
    ask = "{prompt: How warm is the room?, input: {unit: °C}, as: room}"
    with pytest.raises(InputError, match="at full speed nobody can answer steps/prompt"):
        ran(tmp_path, ask)


@pytest.mark.parametrize(
    ("answers", "problem"),
    [
        ({"steps/promt": {}}, "the plan has no step 'steps/promt'; did you mean 'steps/prompt'?"),
        ({"steps/prompt": {"answer": "perhaps"}}, "answer: 'perhaps' is not a possible answer; expected done"),
        ({"steps/prompt": {"does": {"mount": "invertd"}}}, "no mount 'invertd'; did you mean 'inverted'?"),
        ({"steps/prompt": {"answr": "done"}}, "unknown key; did you mean 'answer'?"),
    ],
)  # fmt: skip
def test_a_script_that_does_not_fit_the_plan_is_refused_before_the_run(tmp_path, answers, problem):
    with pytest.raises(InputError) as caught:
        ran(tmp_path, TURN, answers=answers)
    assert problem in str(caught.value)
    assert "answers.yaml:2:" in str(caught.value)


@pytest.mark.leaves("a person who has not answered yet when the run ends")
def test_a_question_that_nobody_answers_in_time_fails_its_step(tmp_path):
    ask = "{prompt: Is anybody there?, give_up_after: 5 min}"
    result = ran(tmp_path, ask, answers={"steps/prompt": {"after": "10 min"}})
    assert "nobody has answered within 5 min" in result.problems[0]
    assert "teardown/set" in ended(result)


def test_a_person_decides_what_follows_a_failure_when_the_sequence_asks_him(tmp_path):
    hot = "{wait_until: unit_temperature, above: 80 °C, give_up_after: 1 min, on_failure: ask}"
    asked = {"steps/wait_until?": {"answer": "continue"}}
    result = ran(tmp_path, hot, "note: It goes on.", answers=asked)
    assert result.outcome.how == "completed"
    assert "steps/note" in ended(result)
    assert result.results.verdict == "INCOMPLETE"
    assert [found.step for found in result.results.journal_records.left_out] == ["steps/wait_until"]


def test_nobody_told_what_to_do_after_a_failure_stops_the_run(tmp_path):
    hot = "{wait_until: unit_temperature, above: 80 °C, give_up_after: 1 min, on_failure: ask}"
    result = ran(tmp_path, hot, "note: It goes on.")
    assert result.outcome.how == "error"
    assert "steps/note" not in ended(result)


@pytest.mark.integration
def test_the_report_counts_from_the_start_also_in_real_time(tmp_path):
    ask = {"steps/prompt": {"after": "1 s", "by": "A. Quick"}}
    result = ran(tmp_path, "note: Here.", "{prompt: Ready?}", answers=ask, speed="1", no_report=False)
    report = (result.path / "report.html").read_text("utf-8")
    assert re.search(r"Here\. \(\d\d? s after the start\)", report)
    assert re.search(r"A\. Quick</td><td class=\"n whole\">0:00:\d\d</td>", report)
    with RunReader(result.path) as reader:
        assert 0 <= reader.span_s()[0] < 30  # whatever the computer's uptime is
