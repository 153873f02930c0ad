"""check, plan, run: what is done with a sequence."""

from __future__ import annotations

import gc
import json
import os
import sys
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bench.cli.exits import INPUT_ERROR, of_run
from bench.errors import InputError

if TYPE_CHECKING:  # `bench --help` loads none of it
    from bench.app.execute import RunResult
    from bench.sequence.plan import Plan
    from bench.sequence.remarks import Remark

Sequence = Annotated[
    str, typer.Argument(metavar="SEQUENCE", help="A sequence file, or the name of a shipped one such as smoke.")
]
BenchOption = Annotated[
    str | None,
    typer.Option(
        "--bench", metavar="FILE", envvar="BENCH_FILE", help="The bench file; default: the shipped simulated bench."
    ),
]
Preset = Annotated[str | None, typer.Option(help="A preset of the sequence.")]
Parameters = Annotated[
    Path | None,
    typer.Option("--params", metavar="FILE", help="A YAML file of parameters, one NAME: VALUE on each line."),
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="A parameter of the sequence; repeatable."),
]
NotAfter = Annotated[
    str | None,
    typer.Option(
        "--not-after", metavar="INSTANT", help="Warn if the run would end later than this, such as 2026-01-31T07:00Z."
    ),
]
Calibrations = Annotated[
    list[str] | None,
    typer.Option(
        "--calibration", metavar="[PLACE=]FILE",
        help="The released calibration to check the unit in a place against; one for each place.",
    ),
]  # fmt: skip
Scenario = Annotated[
    Path | None,
    typer.Option("--scenario", metavar="FILE", help="Faults of the simulated instruments, and when they happen."),
]
Simulate = Annotated[bool, typer.Option("--simulate", help="Replace every instrument by its simulator.")]


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    app.command()(check)
    app.command()(plan)
    app.command()(run)


class PastDue(StrEnum):
    """What becomes of a run on an instrument whose calibration is not valid any more."""

    REFUSE = "refuse"
    MARK = "mark"


class Format(StrEnum):
    """Output format of the findings of a check."""

    TEXT = "text"
    JSON = "json"
    SARIF = "sarif"
    GITHUB = "github"


@contextmanager
def _uncollected() -> Iterator[None]:
    """Nothing is collected meanwhile: a short command needs what it builds, and looking takes a fifth of its time."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


@_uncollected()
def check(
    sequence: Sequence,
    bench: BenchOption = None,
    preset: Preset = None,
    params: Parameters = None,
    set_: Settings = None,
    not_after: NotAfter = None,
    calibration: Calibrations = None,
    strict: Annotated[bool, typer.Option("--strict", help="Treat warnings as errors.")] = False,
    format_: Annotated[
        Format,
        typer.Option(
            "--format",
            metavar="text|json|sarif|github",
            help="text: warnings on stderr; other formats: only that format on stdout.",
        ),
    ] = Format.TEXT,
) -> None:
    """Check a sequence against a bench; nothing is opened."""
    from bench.app.request import RunRequest, load_checked
    from bench.report.remarks import RENDERERS, Shown

    request = RunRequest(
        sequence, bench=bench, preset=preset, parameters=params, settings=tuple(set_ or ()), not_after=not_after,
        calibrations=tuple(calibration or ()),
    )  # fmt: skip
    try:
        checked = load_checked(request)
        document, warnings = checked.plan.document, checked.warnings
        if strict and warnings:
            own = [warning for warning in warnings if warning.elsewhere is None]
            others = [each for each in warnings if each.elsewhere is not None]
            raise InputError(
                *(f"{each.document(document).where(each.place)}: {each.text}" for each in others),
                *document.told((warning.place, warning.text) for warning in own),
            )
    except InputError as error:
        if format_ is Format.TEXT:
            raise
        sys.stdout.write(RENDERERS[format_]([Shown.of_error(problem) for problem in error.problems]) + "\n")
        raise typer.Exit(INPUT_ERROR) from None
    if format_ is not Format.TEXT:
        found = RENDERERS[format_]([Shown.of_remark(warning, document) for warning in warnings])
        sys.stdout.write(f"{found}\n" if found else "")
        return
    warn(checked.plan, warnings)
    told = _counted(len(warnings), "warning") if warnings else "no problem"
    steps = _counted(len(checked.plan), "step")
    sys.stdout.write(f"{document.path}: {steps}, {told} on {checked.loaded.document.path}\n")


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def warn(plan: Plan, warnings: Iterable[Remark]) -> None:
    """Writes what a person should know before a run, a line for each."""
    from bench.report.remarks import warning_line

    for warning in warnings:
        sys.stderr.write(warning_line(warning, plan.document) + "\n")


def plan(
    sequence: Sequence,
    bench: BenchOption = None,
    preset: Preset = None,
    params: Parameters = None,
    set_: Settings = None,
    not_after: NotAfter = None,
    calibration: Calibrations = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw the plan against time, as FILE.svg or FILE.html.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print only JSON on stdout.")] = False,
) -> None:
    """List the steps of a sequence: when each begins, how long it takes, the bench after it; nothing is opened."""
    from bench.app.request import RunRequest, load_checked
    from bench.report.timeline import plan_table, timeline_json, turned_by_hand
    from bench.report.times_and_sizes import duration, megabytes

    request = RunRequest(
        sequence, bench=bench, preset=preset, parameters=params, settings=tuple(set_ or ()), not_after=not_after,
        calibrations=tuple(calibration or ()),
    )  # fmt: skip
    checked = load_checked(request)
    warn(checked.plan, checked.warnings)
    expected = checked.expected
    if picture is not None:
        from bench.report.picture import write_picture  # and matplotlib with it

        write_picture(picture, checked.plan, expected, checked.bench)
    if as_json:
        sys.stdout.write(json.dumps(timeline_json(expected), ensure_ascii=False) + "\n")
        return
    for line in plan_table(checked.plan, expected, checked.bench):
        sys.stdout.write(line + "\n")
    for role, times in turned_by_hand(expected, checked.bench).items():
        sys.stdout.write(f"{role}: turned by hand {times} times\n")
    sys.stdout.write(
        f"{len(checked.plan)} steps, about {duration(expected.total_s)}, about {megabytes(expected.size_bytes)}\n"
    )


def run(
    sequence: Sequence,
    bench: BenchOption = None,
    simulate: Simulate = False,
    speed: Annotated[
        str | None,
        typer.Option(metavar="max|N", help="Bench seconds per real second; default: max on a simulated bench, else 1."),
    ] = None,
    preset: Preset = None,
    params: Parameters = None,
    set_: Settings = None,
    not_after: NotAfter = None,
    uut_model: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Truth of the simulated unit."),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the simulation.")] = None,
    uut: Annotated[
        list[str] | None,
        typer.Option(metavar="[PLACE=]SERIAL", help="Serial number of the unit under test; one for each place."),
    ] = None,
    calibration: Calibrations = None,
    operator: Annotated[str, typer.Option(metavar="NAME", help="Who runs it.")] = "",
    order: Annotated[
        str, typer.Option(metavar="TEXT", help="The order that the run is for; shown in the report.")
    ] = "",
    procedure: Annotated[
        str, typer.Option(metavar="TEXT", help="The test procedure and its revision; shown in the report.")
    ] = "",
    runs: Annotated[Path, typer.Option(metavar="DIR", help="Directory in which run directories are created.")] = Path(
        "runs"
    ),
    attended: Annotated[
        bool,
        typer.Option("--attended", help="Confirm that somebody stays with the bench; required with real connections."),
    ] = False,
    answers: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Scripted answers to prompts, on a simulated bench.")
    ] = None,
    past_due: Annotated[
        PastDue,
        typer.Option(
            metavar="refuse|mark", help="If a calibration is past due: refuse to run, or run and mark the results."
        ),
    ] = PastDue.REFUSE,
    trace: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Record every byte on the connections of the bench in a new file."),
    ] = None,
    scenario: Scenario = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print only the results, as JSON, on stdout.")] = False,
) -> None:
    """Run a sequence on a bench."""
    from bench.app.execute import execute
    from bench.app.request import RunRequest, prepare
    from bench.runner.output import lasting_output
    from bench.runner.progress import TerminalProgress
    from bench.runner.signals import Signals

    with lasting_output():
        if bench is None:
            sys.stderr.write("No --bench given: running on the shipped simulated bench.\n")
        prepared = prepare(
            RunRequest(
                sequence=sequence, bench=bench, simulate=simulate, speed=speed, preset=preset, parameters=params,
                settings=tuple(set_ or ()), uut_model=uut_model, seed=seed, units=tuple(uut or ()), order=order,
                procedure=procedure, operator=operator or os.environ.get("USER", ""), runs=runs, attended=attended,
                answers=answers, not_after=not_after, past_due=past_due.value, calibrations=tuple(calibration or ()),
                trace=trace, scenario=scenario,
            )
        )  # fmt: skip
        warn(prepared.plan, prepared.warnings)
        with Signals() as signals:
            with TerminalProgress(prepared.plan, prepared.loaded.bench, prepared.speed) as progress:
                result = execute(prepared, progress, signals)
            with signals.not_waiting():
                _show(result, progress.said, as_json=as_json)
    raise typer.Exit(of_run(result))


def _show(result: RunResult, said: Collection[str], *, as_json: bool) -> None:
    """Writes the results, and the problems that were not `said` before."""
    from bench.report.text import results_text

    if as_json:
        content = {"run": str(result.path), "results": result.results.to_json() if result.results else None}
        sys.stdout.write(json.dumps(content, ensure_ascii=False) + "\n")
    else:
        sys.stdout.write(results_text(result.results))
    for problem in result.problems:
        if problem not in said:
            sys.stderr.write(f"\n{problem}\n")
    sys.stderr.write(
        f"\n{result.bench_s:.0f} s of bench time in {result.wall_s:.1f} s, {result.bench_s / result.wall_s:.0f} times "
        f"real time\nrun    {result.path}\n"
    )
    if result.report is not None:
        sys.stderr.write(f"report {result.report}\n")
