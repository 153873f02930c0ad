"""check, plan, run: what is done with a sequence."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from bench.cli.exits import BENCH_ERROR, OF_VERDICT

Sequence = Annotated[str, typer.Argument(help="A sequence file, or the name of a shipped one such as smoke.")]
BenchOption = Annotated[
    str | None,
    typer.Option("--bench", metavar="FILE", envvar="BENCH_FILE", help="The bench file; the shipped simulated bench."),
]
Preset = Annotated[str | None, typer.Option(help="A preset of the sequence.")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="A parameter of the sequence; may be given again."),
]
Simulate = Annotated[bool, typer.Option("--simulate", help="Put the simulator at the other end of every wire.")]


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    app.command()(check)
    app.command()(plan)
    app.command()(run)


def check(sequence: Sequence, bench: BenchOption = None, preset: Preset = None, set_: Settings = None) -> None:
    """Check a sequence against a bench; nothing is opened."""
    from bench.app.request import RunRequest, load_plan_and_bench

    request = RunRequest(sequence, bench=bench, preset=preset, settings=tuple(set_ or ()))
    checked, loaded = load_plan_and_bench(request)
    sys.stdout.write(f"{checked.document.path}: {len(checked)} steps, no problem on {loaded.document.path}\n")


def plan(sequence: Sequence, bench: BenchOption = None, preset: Preset = None, set_: Settings = None) -> None:
    """List the steps of a sequence with their durations; nothing is opened."""
    from bench.app.request import RunRequest, load_plan_and_bench
    from bench.report.shown import duration
    from bench.report.text import plan_table
    from bench.sequence.estimate import estimate

    request = RunRequest(sequence, bench=bench, preset=preset, settings=tuple(set_ or ()))
    planned, loaded = load_plan_and_bench(request)
    expected = estimate(planned, loaded.bench)
    for line in plan_table(planned, expected):
        sys.stdout.write(line + "\n")
    sys.stdout.write(
        f"{len(planned)} steps, about {duration(expected.total_s)}, about {expected.size_bytes / 1e6:.0f} MB\n"
    )


def run(
    sequence: Sequence,
    bench: BenchOption = None,
    simulate: Simulate = False,
    speed: Annotated[
        str | None,
        typer.Option(metavar="max|N", help="Bench seconds a second: max on a simulated bench, else 1."),
    ] = None,
    preset: Preset = None,
    set_: Settings = None,
    uut_model: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Truth of the simulated unit."),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the simulation.")] = None,
    uut: Annotated[
        list[str] | None,
        typer.Option(metavar="[PLACE=]SERIAL", help="The unit under test; again for each place."),
    ] = None,
    operator: Annotated[str, typer.Option(metavar="NAME", help="Who runs it.")] = "",
    runs: Annotated[Path, typer.Option(metavar="DIR", help="Where run directories are made.")] = Path("runs"),
    attended: Annotated[
        bool, typer.Option("--attended", help="Somebody stays with the bench; needed with real connections.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the results as JSON, alone on stdout.")] = False,
) -> None:
    """Run a sequence on a bench."""
    from bench.app.execute import execute
    from bench.app.request import RunRequest, prepare
    from bench.report.text import results_text
    from bench.runner.progress import TerminalProgress

    if bench is None:
        sys.stderr.write("No --bench given: running on the shipped simulated bench.\n")
    prepared = prepare(
        RunRequest(
            sequence=sequence,
            bench=bench,
            simulate=simulate,
            speed=speed,
            preset=preset,
            settings=tuple(set_ or ()),
            uut_model=uut_model,
            seed=seed,
            units=tuple(uut or ()),
            operator=operator or os.environ.get("USER", ""),
            runs=runs,
            attended=attended,
        )
    )
    with TerminalProgress(prepared.plan) as progress:
        result = execute(prepared, progress)
    if as_json:
        content = {"run": str(result.path), "results": result.results.to_json() if result.results else None}
        sys.stdout.write(json.dumps(content, ensure_ascii=False) + "\n")
    else:
        sys.stdout.write(results_text(result.results))
    for problem in result.problems:
        if problem not in progress.said:
            sys.stderr.write(f"\n{problem}\n")
    sys.stderr.write(
        f"\n{result.bench_s:.0f} s of bench time in {result.wall_s:.1f} s, {result.bench_s / result.wall_s:.0f} times "
        f"real time\nrun    {result.path}\nreport {result.path / 'report.html'}\n"
    )
    raise typer.Exit(OF_VERDICT[result.results.verdict] if result.results else BENCH_ERROR)
