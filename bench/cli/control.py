"""pause, resume, stop, abort, skip, repeat, answer, status: what is told to a run that is under way, and asked."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from bench.cli.stored import RUNS, Run, Runs


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    for command in (pause, resume, stop, abort, skip, repeat, answer, status):
        app.command()(command)


def pause(run: Run, runs: Runs = RUNS) -> None:
    """Hold a run before its next step; its devices stay as they are."""
    _tell(run, runs, "pause")


def resume(run: Run, runs: Runs = RUNS) -> None:
    """Let a paused run go on."""
    _tell(run, runs, "resume")


def stop(
    run: Run,
    after_step: Annotated[bool, typer.Option("--after-step", help="Let the step under way come to its end.")] = False,
    runs: Runs = RUNS,
) -> None:
    """End a run: the step under way ends, teardown runs."""
    _tell(run, runs, "stop_after_step" if after_step else "stop")


def abort(run: Run, runs: Runs = RUNS) -> None:
    """End a run at once: no teardown, all devices are made safe."""
    _tell(run, runs, "abort")


def skip(run: Run, runs: Runs = RUNS) -> None:
    """End the step under way and go on with the next; what it leaves moving comes to rest."""
    _tell(run, runs, "skip")


def repeat(run: Run, runs: Runs = RUNS) -> None:
    """Begin the step under way anew, or, while the run is paused, the one before."""
    _tell(run, runs, "repeat")


def answer(
    run: Run,
    text: Annotated[str, typer.Argument(metavar="ANSWER", help="One of the choices, or the value that is asked for.")],
    step: Annotated[str, typer.Option(metavar="ID", help="Which one, when several are open: a step, or head#3.")] = "",
    by: Annotated[str, typer.Option(metavar="NAME", help="Who answers.")] = "",
    runs: Runs = RUNS,
) -> None:
    """Answer the question that a run asks."""
    _tell(run, runs, "answer", answer=text, step=step, by=by or os.environ.get("USER", ""))


def status(run: Run, runs: Runs = RUNS) -> None:
    """Print what a run is doing and has measured, as JSON; of one that is over, what it came to."""
    from bench.runner.control import tell
    from bench.store.runs import find_run, summary

    path = find_run(run, runs)
    found = summary(path)
    if found.state == "running":
        sys.stdout.write(tell(path, "status") + "\n")
        return
    from bench.engine.state import replayed
    from bench.runner.commands import state_to_json
    from bench.store.reader import RunReader

    with RunReader(path) as reader:
        came_to = {"state": found.state, "verdict": found.manifest.get("verdict")}
        sys.stdout.write(json.dumps(came_to | state_to_json(replayed(reader.events())), ensure_ascii=False) + "\n")


def _tell(run: str, runs: Path, command: str, **arguments: str) -> None:
    from bench.runner.control import tell
    from bench.store.runs import find_run

    path = find_run(run, runs)
    sys.stdout.write(f"{path.name}: {tell(path, command, **arguments)}\n")
