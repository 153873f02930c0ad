"""A step that a plug-in brings: found by its entry point, validated by its own model, done by its own function."""

from __future__ import annotations

import pytest

from bench.errors import InputError
from bench.sequence.steps.custom import known_steps
from bench.store.reader import RunReader
from tests.support.runs import run_short
from tests.support.sequences import BENCH, TAIL, plan_of, problems_of, steps

MODULE = '''
import asyncio
from bench.sequence.steps.custom import StepDescription
from drivers.schema.fields import Seconds, StrictModel


class Shake(StrictModel):
    """Settings of a shake."""

    times: int
    pause: Seconds = 1.0


async def shake(settings, bench):
    if not settings.times:
        raise SystemExit(0)
    for _ in range(settings.times):
        await asyncio.sleep(settings.pause)
    bench.notice("shaken")
    return {"shaken": settings.times, "on": bench.role}


SHAKE = StepDescription("shake", "Shakes the unit", "toy_plugin:shake", Shake, takes_s=lambda s: s.times * s.pause)
ROCK = SHAKE._replace(name="rock", capability="positioner")
'''


@pytest.fixture
def plugin(tmp_path, monkeypatch):
    folder = tmp_path / "site"
    info = folder / "toy_plugin-1.0.dist-info"
    info.mkdir(parents=True)
    (folder / "toy_plugin.py").write_text(MODULE, "utf-8")
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: toy-plugin\nVersion: 1.0\n", "utf-8")
    (info / "entry_points.txt").write_text(
        "[inertial_test_bench.steps]\nshake = toy_plugin:SHAKE\nrock = toy_plugin:ROCK\n", "utf-8"
    )
    monkeypatch.syspath_prepend(str(folder))
    known_steps.cache_clear()
    yield
    known_steps.cache_clear()


def test_a_plugin_s_step_is_done_in_a_run_and_recorded(tmp_path, plugin):
    path = tmp_path / "s.yaml"
    path.write_text(steps("{custom: rock, role: head, with: {times: 3, pause: 2 s}}") + TAIL, "utf-8")
    result = run_short(tmp_path / "runs", sequence=str(path))
    assert result.outcome.how == "completed"
    with RunReader(result.path) as reader:
        (begin,) = [event.at_s for event in reader.events("step_begins") if event.step == "steps/custom"]
        (end,) = [event for event in reader.events("step_ended") if event.step == "steps/custom"]
    assert end.data == {"shaken": 3, "on": "head"}
    assert end.at_s - begin == pytest.approx(6.0)


def test_its_settings_are_checked_by_its_own_model_before_the_run(tmp_path, plugin):
    assert problems_of(tmp_path, steps("{custom: shake, with: {times: many}}")) == [
        "2:21: with.times: is 'many', expected a whole number"
    ]


def test_a_step_that_no_plugin_brings_is_refused(tmp_path, plugin):
    assert problems_of(tmp_path, steps("{custom: shak}")) == [
        "2:6: there is no plug-in with a step 'shak'; did you mean 'shake'?"
    ]
    assert len(plan_of(tmp_path, steps("{custom: shake, with: {times: 1}}"), bench=BENCH)) == 1


def test_without_the_plugin_the_step_is_unknown(tmp_path):
    with pytest.raises(InputError, match="there is no plug-in with a step 'shake'"):
        plan_of(tmp_path, steps("{custom: shake, with: {times: 1}}"))


def test_a_step_that_wants_to_end_the_program_ends_the_run_safely(tmp_path, plugin):
    path = tmp_path / "s.yaml"
    path.write_text(steps("{custom: shake, with: {times: 0}}") + "teardown: [wait: 1 s]\n" + TAIL, "utf-8")
    result = run_short(tmp_path / "runs", sequence=str(path))
    assert (result.outcome.how, result.outcome.unsafe) == ("error", {})
    assert "toy_plugin.py:16: wants to end the program (SystemExit(0))" in result.problems[0]
    with RunReader(result.path) as reader:
        assert [event.step for event in reader.events("step_ended")] == ["teardown/wait"]


def test_so_does_a_driver_that_wants_to(tmp_path, monkeypatch):
    async def end(*_, **__):
        raise SystemExit("no licence")

    monkeypatch.setattr("drivers.kinds.head.driver.Head.move_to", end)
    result = run_short(tmp_path / "runs", sequence="smoke")
    assert (result.outcome.how, result.outcome.unsafe) == ("error", {})
    assert "wants to end the program (SystemExit('no licence'))" in result.problems[0]
