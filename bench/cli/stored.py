"""runs, report, export: what is done with runs that are on the disk."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer

from bench.cli.exits import BENCH_ERROR

Run = Annotated[str, typer.Argument(metavar="RUN", help="A run directory, its id, a beginning of it, or last.")]
Runs = Annotated[Path, typer.Option(metavar="DIR", help="Where the run directories are.")]
RUNS = Path("runs")

group = typer.Typer(help="List and verify runs.", invoke_without_command=True, rich_markup_mode=None)


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    app.add_typer(group, name="runs")
    app.command()(report)
    app.command()(export)


@group.callback()
def runs_of(context: typer.Context, runs: Runs = RUNS) -> None:
    """List the runs."""
    context.obj = runs
    if context.invoked_subcommand is None:
        list_runs(runs)


@group.command("list")
def list_runs(runs: Runs = RUNS) -> None:
    """List the runs, oldest first, with their states."""
    from bench.store.runs import list_runs as found

    for run in found(runs):
        units = ", ".join(unit["uut"] for unit in run.manifest.get("units", []))
        verdict = run.manifest.get("verdict") or "-"
        sys.stdout.write(f"{run.id}  {run.state:<11}  {verdict:<10}  {units}\n")


@group.command()
def digest(run: Run, runs: Runs = RUNS) -> None:
    """Print the digest of a run's data: equal for equal runs."""
    from bench.store.reader import digest_of
    from bench.store.runs import find_run

    sys.stdout.write(digest_of(find_run(run, runs)) + "\n")


@group.command()
def verify(run: Run, runs: Runs = RUNS) -> None:
    """Check a run's files against the hashes and the digest in its manifest."""
    from bench.report.verify import verify as check
    from bench.store.runs import find_run

    path = find_run(run, runs)
    damage = check(path)
    for problem in damage:
        sys.stdout.write(f"{problem}\n")
    if damage:
        raise typer.Exit(BENCH_ERROR)
    sys.stdout.write(f"{path}: as written\n")


def report(
    run: Run,
    form: Annotated[
        str,
        typer.Option("--format", metavar="html|pdf|json|csv", help="The page, its print, or the results alone."),
    ] = "html",
    lang: Annotated[str, typer.Option("--lang", metavar="en|zh", help="The language of the page.")] = "en",
    runs: Runs = RUNS,
) -> None:
    """Write the report of a run, of an interrupted one too."""
    from bench.report.languages import LANGUAGES
    from bench.report.stored import open_run
    from bench.report.write import FORMS, write_report
    from bench.store.runs import find_run

    _expect_one_of("--format", FORMS, form)
    _expect_one_of("--lang", LANGUAGES, lang)
    with open_run(find_run(run, runs)) as stored:
        sys.stdout.write(f"{write_report(stored, form, lang)}\n")


def export(
    run: Run,
    form: Annotated[
        str, typer.Option("--format", metavar="csv|candump|parquet|matlab|hdf5", help="What other programs read.")
    ] = "csv",
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where the files go.")] = Path(),
    runs: Runs = RUNS,
) -> None:
    """Write a run's data as files that other programs read."""
    from bench.report.export import FORMATS
    from bench.report.stored import open_run
    from bench.store.runs import find_run

    _expect_one_of("--format", FORMATS, form)
    with open_run(find_run(run, runs)) as stored:
        for path in FORMATS[form](stored, out):
            sys.stdout.write(f"{path}\n")


def _expect_one_of(option: str, known: Iterable[str], given: str) -> None:
    """Raises InputError for a value that an option does not have."""
    from bench.errors import InputError
    from drivers.suggest import did_you_mean

    if given not in known:
        raise InputError(f"{option} {given}: unknown, expected {', '.join(known)}{did_you_mean(given, known)}")
