"""pause, resume, stop, abort, skip, repeat, answer, status: commands and queries for a running run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.cli.commands import Command, argument, flag, option
from bench.cli.stored import RUN, RUNS
from bench.cli.streams import say, say_json
from bench.cli.through import Meant, meant, tell

if TYPE_CHECKING:  # keeps imports out of `bench --help`
    from bench.store.runs import RunSummary


def pause(run: str, runs: Path) -> None:
    """Pause a run before its next step; its devices stay as they are."""
    tell(run, runs, "pause")


def resume(run: str, runs: Path, *, interrupted: bool, pending: bool) -> int | None:
    """Continue a paused run, or an interrupted one from where it was."""
    from bench.errors import InputError
    from bench.store.runs import summary

    if pending:
        if run:
            raise InputError("--pending takes all runs that may go on by themselves; leave RUN out")
        from bench.cli.running import resume_pending

        return resume_pending(runs)
    if not run:
        raise InputError("give the RUN to resume")
    path = meant(run, runs).path
    if path is None or summary(path).state != "interrupted":
        tell(run, runs, "resume")
        return None
    from bench.cli.running import resume_interrupted

    return resume_interrupted(path, confirmed=interrupted)


def stop(run: str, runs: Path, *, after_step: bool) -> None:
    """Stop a run: the current step is interrupted, then the teardown runs."""
    tell(run, runs, "stop_after_step" if after_step else "stop")


def abort(run: str, runs: Path) -> None:
    """Abort a run at once: no teardown, all devices are made safe."""
    tell(run, runs, "abort")


def skip(run: str, runs: Path) -> None:
    """Interrupt the current step, bring moving axes to rest, and continue with the next step."""
    tell(run, runs, "skip")


def repeat(run: str, runs: Path) -> None:
    """Restart the current step or, while the run is paused, repeat the previous one."""
    tell(run, runs, "repeat")


def answer(run: str, runs: Path, text: str, step: str, by: str) -> None:
    """Answer the question that a run asks."""
    tell(run, runs, "answer", answer=text, step=step, by=by)


def status(run: str, runs: Path, *, as_json: bool) -> None:
    """Print what a run is doing and has measured or, if it has ended, how it ended."""
    from bench.report.status_text import status_lines
    from bench.store.runs import summary

    at = meant(run, runs)
    if at.path is None:
        _status_there(at, as_json=as_json)
        return
    found = summary(at.path)
    state = _state_of(found)
    if as_json:
        say_json(state)
        return
    say(*status_lines(found, state))


def _status_there(at: Meant, *, as_json: bool) -> None:
    """Print the status of a run on another computer, as its station knows it."""
    from bench.cli.watching import state_text

    assert at.station is not None  # noqa: S101  only a station knows it
    run = at.station.run(at.name)
    state = at.station.live(at.name) if run["state"] == "running" else None
    if as_json:
        say_json(run | (state or {}))
        return
    say(f"{at.name}: {run['state']}{', ' + run['verdict'] if run['verdict'] else ''}")
    if state is not None:
        say(f"  {state_text(state)}")


def _state_of(run: RunSummary) -> dict[str, Any]:
    """Return the status of a run as JSON: queried from a running run, or read from the journal."""
    if run.state == "running":
        from bench.runner.tell import send_command

        asked: dict[str, Any] = json.loads(send_command(run.path, "status"))
        return asked
    from bench.engine.state import replayed
    from bench.errors import StoreError
    from bench.figures.after_run import last_states
    from bench.runner.commands import state_to_json
    from bench.store.latch import latch
    from bench.store.reader import RunReader
    from bench.store.verify import examine

    if damage := examine(run.path, thoroughly=False).damage:
        raise StoreError(
            f"{run.path}: is DAMAGED: {'; '.join(damage[:3])}; 'bench runs verify {run.id}' lists everything"
        )
    latched = latch(run)
    with RunReader(run.path) as reader:
        over = {"state": run.state, "verdict": run.manifest.get("verdict")}
        over |= {"latched": latched.why} if latched is not None else {}
        over |= {"made_safe": made_safe} if (made_safe := last_states(run.path)) else {}
        return over | state_to_json(replayed(reader.events()))


def acknowledge(run: str, runs: Path, reason: str, by: str) -> None:
    """Acknowledge a run that did not end by itself with everything safe, after a person has inspected the bench."""
    import getpass

    from bench.runner.held import is_followed
    from bench.store.latch import acknowledge as acknowledged
    from bench.store.runs import find_run

    path = find_run(run, runs)
    why = acknowledged(path, by or getpass.getuser(), reason, is_followed)
    say(f"{path.name}: acknowledged: {why}")


COMMANDS = (
    Command("pause", pause, (RUN, RUNS)),
    Command("resume", resume, (
        argument("RUN", "A run directory, an id, its first characters, or last.", default=""),
        RUNS,
        flag("--interrupted", "Continue an interrupted run without asking; needed without a terminal."),
        flag(
            "--pending",
            "After a start of the computer: continue every run that it has interrupted, as its bench file allows.",
        ),
    )),
    Command("skip", skip, (RUN, RUNS)),
    Command("repeat", repeat, (RUN, RUNS)),
    Command("abort", abort, (RUN, RUNS)),
    Command("stop", stop, (RUN, RUNS, flag("--after-step", "Complete the current step first."))),
    Command("answer", answer, (
        RUN,
        argument("ANSWER", "One of the choices, or the requested value.", to="text"),
        RUNS,
        option(
            "--step ID",
            "The question to answer when several are open: a step id, or a device request such as head#3.",
            default="",
        ),
        option("--by NAME", "Who answers; default: $USER.", variable="USER", default=""),
    )),
    Command("acknowledge", acknowledge, (
        RUN,
        RUNS,
        option("--reason TEXT", "What was found, and what was done.", is_required=True),
        option("--by NAME", "Who acknowledges it; default: $USER.", variable="USER", default=""),
    )),
    Command("status", status, (RUN, RUNS, flag("--json", "Print the status as JSON.", to="as_json"))),
)  # fmt: skip
