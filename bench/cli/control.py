"""pause, resume, stop, abort: what is told to a run that is under way."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from bench.cli.stored import RUNS, Run, Runs


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    for command in (pause, resume, stop, abort):
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


def _tell(run: str, runs: Path, command: str) -> None:
    from bench.runner.control import tell
    from bench.store.runs import find_run

    path = find_run(run, runs)
    sys.stdout.write(f"{path.name}: {tell(path, command)}\n")
