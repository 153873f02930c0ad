"""What a run under way is told over its control socket, and what it tells of itself."""

from __future__ import annotations

import json
from typing import Any

from bench.engine.engine import Engine
from bench.engine.monitor import Monitor
from bench.engine.state import RunState
from bench.errors import InputError
from bench.runner.control import Arguments, Handlers
from bench.sequence.values import in_words


def commands_of(  # noqa: C901  one small function for each command
    engine: Engine, monitor: Monitor, *, can_pause: bool
) -> Handlers:
    """Every command by its name, as a function that does it and says so."""

    def pause(_: Arguments) -> str:
        if not can_pause:
            raise InputError("in virtual time at full speed nothing can be paused; run it with --speed 60, say")
        if engine.in_teardown:
            raise InputError("the teardown is under way, which is not paused")
        engine.pause()
        return "it pauses before its next step"

    def resume(_: Arguments) -> str:
        engine.resume()
        return "it goes on"

    def stop(_: Arguments) -> str:
        engine.stop()
        return "the step under way ends, teardown runs"

    def stop_after_step(_: Arguments) -> str:
        engine.stop_after_step()
        return "teardown runs after the step under way"

    def abort(_: Arguments) -> str:
        engine.abort()
        return "the teardown is dropped, all devices are made safe"

    def skip(_: Arguments) -> str:
        return f"skipped: {engine.skip()}"

    def repeat(_: Arguments) -> str:
        return f"done again: {engine.repeat()}"

    def answer(said: Arguments) -> str:
        if "answer" not in said:
            raise InputError("an answer is missing")
        by = said.get("by") or "operator"
        if not by.isprintable():
            raise InputError("who answers is told in characters that cannot be printed")
        question = engine.desk.answer(said["answer"], by, said.get("step") or None)
        return f"answered: {question.text}"

    def status(_: Arguments) -> str:
        told = {"state": "running"} | state_to_json(engine.journal.state) | _now(engine, monitor)
        return json.dumps(told, ensure_ascii=False)

    return {
        "pause": pause, "resume": resume, "stop": stop, "stop_after_step": stop_after_step, "abort": abort,
        "skip": skip, "repeat": repeat, "answer": answer, "status": status,
    }  # fmt: skip


def state_to_json(state: RunState) -> dict[str, Any]:
    """A run's state as plain JSON types."""
    return {
        "under_way": list(state.under_way),
        "done": state.done,
        "held_by": sorted(state.held),
        "variables": {name: in_words(value) for name, value in state.variables.items()},
        "left_out": list(state.left_out),
        "limits_failed": list(state.limits_failed),
        "dropped": dict(state.dropped),
        "lost": dict(state.lost),
        "problems": list(state.problems),
    }


def _now(engine: Engine, monitor: Monitor) -> dict[str, Any]:
    """What only a run under way can tell: open questions, and the newest readings."""
    return {
        "questions": [
            {"step": question.step, "text": question.text, "expected": question.expected}
            for question in engine.desk.questions
        ],
        "readings": {
            name: {"value": reading.value, "unit": unit, "at_s": reading.at_s}
            for name, (reading, unit) in monitor.newest().items()
        },
    }
