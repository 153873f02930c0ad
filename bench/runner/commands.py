"""What a run under way is told over its control socket, and what it tells of itself."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from typing import Any

from bench.engine.ending import EndRequest
from bench.engine.engine import Engine
from bench.engine.journal import Journal
from bench.engine.monitor import Monitor
from bench.engine.state import RunState
from bench.errors import InputError, StoreError
from bench.quality import Fresh, Invalid, Latest, Stale
from bench.runner.control import STOPS, Arguments, Handlers
from bench.sequence.language.values import in_words


def commands_of(  # noqa: C901  one small function for each command
    engine: Engine, monitor: Monitor, notice: Callable[[str], None], *, can_pause: bool
) -> Handlers:
    """Every command by its name, as a function that does it and says so.

    Who gave which command is in the journal, and told to `notice`. What is answered is on the disk by then, except of
    what ends the run, which no disk holds up.
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
        return "it goes on"

    def stop(said: Arguments) -> str:
        engine.stop(_by(said, "stop"))
        return "the current step is interrupted, then the teardown runs"

    def stop_after_step(said: Arguments) -> str:
        engine.stop_after_step(_by(said, "stop --after-step"))
        return "the teardown runs after the current step"

    def abort(said: Arguments) -> str:
        engine.abort(_by(said, "abort"))
        return "no teardown; all devices are made safe"

    def skip(_: Arguments) -> str:
        return f"skipped: {engine.skip()}"

    def repeat(_: Arguments) -> str:
        return f"done again: {engine.repeat()}"

    def answer(said: Arguments) -> str:
        if "answer" not in said:
            raise InputError("an answer is missing")
        question = engine.desk.answer(said["answer"], said["by"], said.get("step") or None)
        return f"answered: {question.text}"

    async def status(_: Arguments) -> str:
        told = {"state": "running"} | state_to_json(engine.journal.state) | _now(engine, monitor)
        await _kept(engine.journal, "the state of the run could not be written to the disk")
        return json.dumps(told, ensure_ascii=False)

    def command(name: str, act: Callable[[Arguments], str]) -> Callable[[Arguments], Awaitable[str]]:
        async def done(said: Arguments) -> str:
            told = act(said)
            engine.journal.try_to_write("command", command=name, **said)
            notice(f"{name.replace('_', ' ')} by {said['by']}: {told}")
            if name not in STOPS:
                await _kept(engine.journal, f"{told}, which is not on the disk")
            return told

        return done

    acts = (pause, resume, stop, stop_after_step, abort, skip, repeat, answer)
    return {act.__name__: command(act.__name__, act) for act in acts} | {"status": status}


async def _kept(journal: Journal, otherwise: str) -> None:
    """Returns when all that was written is on the disk; InputError when it cannot be."""
    try:
        await journal.commit()
    except StoreError as problem:
        raise InputError(f"{otherwise}: {problem}") from problem


def _by(said: Arguments, command: str) -> EndRequest:
    """Who ends the run by a command."""
    return EndRequest("command", f"ended by {said['by']} with 'bench {command}'")


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
    """State that only a run under way has: its bench time, open questions and the newest readings."""
    return {
        "now_s": asyncio.get_running_loop().time(),
        "questions": [
            {"step": question.step, "text": question.text, "expected": question.expected}
            for question in engine.desk.questions
        ],
        "readings": {name: _latest_to_json(latest, unit) for name, (latest, unit) in monitor.newest().items()},
    }


def _latest_to_json(latest: Latest, unit: str) -> dict[str, Any]:
    """A reading with its quality; "value" and "at_s" only of one that is valid and not stale."""
    match latest:
        case Fresh(reading, age_s):
            found = {"quality": "valid", "value": reading.value, "unit": unit, "at_s": reading.at_s, "age_s": age_s}
            return found | {"number": reading.number}
        case Invalid():
            return {"quality": "invalid", "why": latest.why, "number": latest.number}
        case Stale():
            return {"quality": "stale", "why": latest.why}
