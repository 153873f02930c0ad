"""Commands and queries that a running run accepts over its control socket."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from typing import Any

from bench.engine.ending import EndRequest
from bench.engine.engine import Engine
from bench.engine.journal import Journal
from bench.engine.monitor import Monitor
from bench.engine.pulse import NO_GUARDIAN, Pulse
from bench.engine.questions import Question
from bench.engine.state import RunState
from bench.errors import InputError, StoreError
from bench.quality import Fresh, Invalid, Latest, Stale
from bench.runner.control import STOPS, Arguments, Handler, Handlers
from bench.sequence.language.values import in_words


def commands_of(  # noqa: C901  one small function for each command
    engine: Engine, monitor: Monitor, notice: Callable[[str], None], *, can_pause: bool, pulse: Pulse | None = None
) -> Handlers:
    """Return the handlers of all commands by name.

    The sender of each command is recorded in the journal and passed to `notice`. Answers are sent when their effect is
    on the disk, except for commands that end the run, which no disk may delay.
    """

    def pause(_: Arguments) -> str:
        if not can_pause:
            raise InputError("a run at full speed cannot be paused; start it with --speed 60, for example")
        if engine.in_teardown:
            raise InputError("the teardown is running and cannot be paused")
        engine.pause()
        return "the run pauses before its next step"

    def resume(_: Arguments) -> str:
        engine.resume()
        return "the run continues"

    def stop(request: Arguments) -> str:
        engine.stop(_by(request, "stop"))
        return "the current step is interrupted, then the teardown runs"

    def stop_after_step(request: Arguments) -> str:
        engine.stop_after_step(_by(request, "stop --after-step"))
        return "the teardown runs after the current step"

    def abort(request: Arguments) -> str:
        engine.abort(_by(request, "abort"))
        return "no teardown; all devices are made safe"

    def skip(_: Arguments) -> str:
        return f"skipped: {engine.skip()}"

    def repeat(_: Arguments) -> str:
        return f"repeated: {engine.repeat()}"

    def answer(request: Arguments) -> str:
        if "answer" not in request:
            raise InputError("an answer is missing")
        question = engine.prompts.answer(request["answer"], request["by"], request.get("step") or None)
        return f"answered: {question.text}"

    async def status(_: Arguments) -> str:
        guardian = {"guardian": pulse.guardian if pulse is not None else NO_GUARDIAN}
        state = {"state": "running", **state_to_json(engine.journal.state), **guardian, **_now(engine, monitor)}
        await durable(engine.journal, "the state of the run could not be written to the disk")
        return json.dumps(state, ensure_ascii=False)

    acts = (pause, resume, stop, stop_after_step, abort, skip, repeat, answer)
    return {act.__name__: recorded(act, engine.journal, notice) for act in acts} | {"status": status}


def recorded(act: Callable[[Arguments], str], journal: Journal, notice: Callable[[str], None]) -> Handler:
    """Return the handler of a command that has the name of its function: recorded, with its sender, once it is done."""
    name = act.__name__

    async def done(request: Arguments) -> str:
        reply = act(request)
        journal.try_to_write("command", command=name, **request)
        notice(f"{name.replace('_', ' ')} by {request['by']}: {reply}")
        if name not in STOPS:
            await durable(journal, f"{reply}; this is not recorded on the disk")
        return reply

    return done


async def durable(journal: Journal, otherwise: str) -> None:
    """Wait until the journal is on the disk. Raises InputError if that fails."""
    try:
        await journal.commit()
    except StoreError as problem:
        raise InputError(f"{otherwise}: {problem}") from problem


def _by(request: Arguments, command: str) -> EndRequest:
    """Return the request to end the run, with its sender."""
    return EndRequest("command", f"ended by {request['by']} with 'bench {command}'")


def state_to_json(state: RunState) -> dict[str, Any]:
    """Return a run's state as plain JSON types."""
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
    """Return state that only a running run has: bench time, holds, manual control, open questions, newest readings."""
    return {
        "now_s": asyncio.get_running_loop().time(),
        "holds": engine.holds,
        "manual": engine.manual.to_json(),
        "questions": [_question_to_json(question) for question in engine.prompts.questions],
        "readings": {name: _latest_to_json(latest, unit) for name, (latest, unit) in monitor.newest().items()},
    }


def _question_to_json(question: Question) -> dict[str, Any]:
    """Return an open question; `choices` is empty for a typed answer, which has a unit or is a text."""
    return {
        "step": question.step,
        "text": question.text,
        "expected": question.expected,
        "choices": list(question.choices),
        "unit": question.input.unit or "" if question.input is not None else "",
        "picture": str(question.picture.absolute()) if question.picture is not None else "",
    }


def _latest_to_json(latest: Latest, unit: str) -> dict[str, Any]:
    """Return a reading with its quality; "value" and "at_s" only if it is valid and not stale."""
    match latest:
        case Fresh(reading, age_s):
            found = {"quality": "valid", "value": reading.value, "unit": unit, "at_s": reading.at_s, "age_s": age_s}
            return found | {"number": reading.number}
        case Invalid():
            return {"quality": "invalid", "why": latest.why, "number": latest.number}
        case Stale():
            return {"quality": "stale", "why": latest.why}
