"""Whole runs on a bench whose head is turned by hand: who typed what, who turned otherwise, and who went away."""

from __future__ import annotations

import asyncio
import json

import pytest

from bench.app.drawn_faults import draw_faults
from bench.config.bench import load_bench
from bench.config.models import BenchFile
from bench.errors import InputError
from bench.report.plan_view.timeline import turned_by_hand
from bench.sequence.estimate.estimate import estimate
from bench.store.reader import RunReader
from tests.support.engines import run_plan
from tests.support.runs import ROOT, SHORT, run_short
from tests.support.sequences import TAIL, plan_of, steps

FILE = ROOT / "config/by_hand.yaml"
BENCH: BenchFile = load_bench(FILE).bench
POWER = "{set: supply, voltage: 15 V, current_limit: 120 mA, output: on}"
OFF = "{set: supply, output: off}"
UP, BACK = "{move: head, to: 90°}", "{move: head, to: 0°}"
COUNT = "{measure: counter.x, for: 5 s, as: rate}"
IN_WORDS = "When it is there and locked, type the angle that it shows, in ° or deg."


def ran(tmp_path, *lines, answers=None, teardown=(OFF,), **options):
    tmp_path.mkdir(exist_ok=True)
    path = tmp_path / "s.yaml"
    path.write_text(steps(*lines) + "teardown:\n" + "".join(f"  - {line}\n" for line in teardown) + TAIL, "utf-8")
    return run_by_hand(tmp_path, answers, sequence=str(path), **options)


def run_by_hand(tmp_path, answers=None, **options):
    if answers is not None:
        options["answers"] = tmp_path / "answers.yaml"
        options["answers"].write_text("schema: itb-answers/1\nanswers: " + json.dumps(answers) + "\n", "utf-8")
    return run_short(tmp_path / "runs", **({"bench": FILE} | options))


def events(result, *kinds):
    with RunReader(result.path) as reader:
        return list(reader.events(*kinds))


def ended(result):
    return {event.step: event.data for event in events(result, "step_ended")}


def message(result):
    """Each answer to a question of the head: its id, what was typed, and by whom."""
    return [(each.step, each.data["answer"], each.data["by"]) for each in events(result, "answered")]


def test_a_tumble_runs_to_its_end_and_the_record_says_who_turned_the_head_when(tmp_path):
    script = {"head": {"by": "A. Turner"}, "head#2": {"by": "B. Turner", "after": "10 min"}}
    four = "positions=[0°, 90°, 180°, 270°]"
    result = run_by_hand(tmp_path, script, settings=(*SHORT, four), no_report=False)
    assert result.outcome.how == "completed"
    assert result.results.verdict in ("PASS", "INCOMPLETE")
    asked, answered = events(result, "asked"), events(result, "answered")
    assert [event.step for event in asked] == [f"head#{number}" for number in range(1, 15)]
    assert [event.step for event in answered] == [event.step for event in asked]
    assert [event.data["by"] for event in answered] == ["A. Turner", "B. Turner", *["A. Turner"] * 12]
    waited_s = [after.at_s - before.at_s for before, after in zip(asked, answered, strict=True)]
    assert waited_s == pytest.approx([120, 600, *[120] * 12])
    assert answered[2].data["question"] == (
        f"Turn head by hand to 91°, from 1° up by 90°, coming to it from below. {IN_WORDS}"
    )
    report = (result.path / "report.html").read_text("utf-8")
    assert "A. Turner" in report
    assert "Turn head by hand to 91°, from 1° up by 90°" in report
    assert "After the start" in report


def test_a_run_takes_as_long_as_was_planned(tmp_path):
    moves = (UP, "{move: head, to: 90°}", "{move: head, to: 90°, approach: from_above, settle: 3 s}", BACK)
    result = ran(tmp_path, *moves)
    expected = estimate(plan_of(tmp_path, steps(*moves), bench=BENCH), BENCH)
    assert [round(span.duration_s) for span in expected.spans] == [120, 0, 123, 120]
    assert turned_by_hand(expected, BENCH) == {"head": 3}
    assert [answer for _, answer, _ in message(result)] == ["90 °", "90 °", "0 °"]
    assert result.bench_s == pytest.approx(363, abs=4)


def test_an_angle_that_was_misread_is_asked_for_again_and_is_never_taken(tmp_path):
    result = ran(tmp_path, POWER, UP, COUNT, answers={"head#1": {"answer": "93 deg", "by": "A. Hurry"}})
    assert message(result) == [("head#1", "93 °", "A. Hurry"), ("head#1~2", "90 °", "scripted technician")]
    again = events(result, "asked")[1].data["text"]
    assert again.startswith("93° was typed, 90° was asked for: it is +3° off, at most ±0.01° may be. Turn head")
    assert ended(result)["steps/move"]["angle_deg"] == 90
    assert result.outcome.how == "completed"


def test_a_head_that_was_turned_elsewhere_is_found_out_by_the_reading_alone(tmp_path):
    honest = ran(tmp_path / "a", POWER, UP, COUNT)
    wrong = ran(tmp_path / "b", POWER, UP, COUNT, answers={"head#1": {"does": {"turn": "270°"}}})
    nothing = ran(tmp_path / "c", POWER, UP, COUNT, answers={"head": {"does": {}}})
    assert message(wrong) == message(nothing) == message(honest) == [("head#1", "90 °", "scripted technician")]
    rates = [ended(result)["steps/measure"]["value"] for result in (honest, wrong, nothing)]
    assert rates[0] > 10_000
    assert rates[1] < -10_000
    assert abs(rates[2]) < 1_000


def test_a_head_that_sticks_is_found_out_by_the_reading_alone(tmp_path):
    result = ran(tmp_path, POWER, UP, COUNT, bench=with_fault(tmp_path, "stuck"))
    assert message(result) == [("head#1", "90 °", "scripted technician")]
    assert abs(ended(result)["steps/measure"]["value"]) < 1_000


def test_where_nobody_answers_the_move_fails_and_the_teardown_goes_on(tmp_path):
    result = ran(tmp_path, POWER, UP, teardown=(BACK, OFF), bench=with_fault(tmp_path, "silent"))
    assert result.outcome.how == "error"
    assert "head: nobody has answered within 10 min: 'Turn head by hand to 90°." in result.problems[0]
    assert [event.step for event in events(result, "unanswered")] == ["head#1", "head#2"]
    assert "teardown/set" in ended(result)
    assert events(result, "made_safe")[0].data == {"unsafe": {}}


def with_fault(tmp_path, kind):
    """The bench with a fault of its head from the beginning, for those of little patience."""
    text = FILE.read_text("utf-8").replace("turn_time: 2 min}", "turn_time: 2 min, give_up_after: 10 min}")
    folder = tmp_path / "config"
    folder.mkdir()
    for name in ("if_counter.dbc", "uut/quartz_flexure.yaml"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes((FILE.parent / name).read_bytes())
    (folder / "bench.yaml").write_text(f"{text}  faults: [{{device: head, kind: {kind}, at: 0 s}}]\n", "utf-8")
    return folder / "bench.yaml"


def test_an_attitude_is_not_asked_twice_for_and_an_unknown_angle_is_looked_at(tmp_path):
    by = "{move: head, by: 90°}"
    result = ran(tmp_path, by, by)
    assert [(step, answer) for step, answer, _ in message(result)] == [
        ("head#1", "0 °"), ("head#2", "90 °"), ("head#3", "180 °"),
    ]  # fmt: skip
    assert events(result, "asked")[0].data["text"].startswith("Leave head as it is, and type the angle")


@pytest.mark.parametrize(
    ("answers", "problem"),
    [
        ({"haed": {}}, "the plan has no step 'haed'"),
        ({"supply": {}}, "'supply' asks no questions: it is connected by tcp"),
        ({"head#one": {}}, "'head#one' is not a question of 'head'; its questions are head#1, head#2, …"),
        ({"head#3": {"answer": "done"}}, "answer: 'done'"),
        ({"head#3~2": {"answer": "91"}}, "expected a value in °"),
        (
            {"head": {"does": {"mount": "inverted"}}},
            "the answer to a head is an angle; mount is for prompts of a sequence",
        ),
        ({"steps/prompt": {"does": {"turn": "9°"}}}, "is for a head turned by hand"),
    ],
)
def test_a_script_that_does_not_fit_the_bench_is_refused_before_the_run(tmp_path, answers, problem):
    with pytest.raises(InputError) as caught:
        ran(tmp_path, UP, "{prompt: Go on?}", answers=answers)
    assert problem in str(caught.value)
    assert "answers.yaml:2:" in str(caught.value)


@pytest.mark.parametrize("ending", ["stop", "abort"])
def test_ending_a_run_leaves_no_question_open(tmp_path, ending):
    plan = plan_of(tmp_path, steps(UP) + f"teardown:\n  - {OFF}\n", bench=BENCH)

    async def script(engine):
        await asyncio.sleep(30)
        assert [question.step for question in engine.prompts.questions] == ["head#1"]
        getattr(engine, ending)()
        await asyncio.sleep(0.5)
        assert engine.prompts.questions == ()
        with pytest.raises(InputError, match="no question is open"):
            engine.prompts.answer("90 deg", "A. Late")

    run = run_plan(tmp_path / "run", plan, BENCH, script)
    assert run.outcome.how == "aborted"
    assert run.state.questions == run.state.under_way == ()
    assert run.steps("unanswered") == ["head#1"]
    assert ("teardown/set" in run.steps()) == (ending == "stop")
    assert run.made_safe == {}
    assert f"No longer needed: Turn head by hand to 90°. {IN_WORDS}" in run.notices


def test_a_step_is_skipped_and_repeated_as_any_other(tmp_path):
    plan = plan_of(tmp_path, steps(UP, BACK), bench=BENCH)

    async def script(engine):
        for wish in ("repeat", "skip"):
            await asyncio.sleep(60)
            getattr(engine, wish)()
        await asyncio.sleep(60)
        engine.prompts.answer("0 deg", "A. Person")

    run = run_plan(tmp_path / "run", plan, BENCH, script)
    assert run.outcome.how == "completed"
    assert run.steps("asked") == ["head#1", "head#2", "head#3"]
    assert run.steps("unanswered") == ["head#1", "head#2"]
    assert run.state.left_out == ("steps/move~2",)
    assert run.ended("steps/move#2").data["angle_deg"] == 0


def test_a_person_breaks_in_the_ways_of_a_person():
    drawn = [fault for seed in range(60) for fault in draw_faults(BENCH, 3600, seed) if fault.device == "head"]
    assert {fault.kind for fault in drawn} == {"silent", "stuck"}
