"""runs, report, export: what is done with runs that are on the disk."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer

from bench.cli.exits import BENCH_ERROR

Run = Annotated[str, typer.Argument(metavar="RUN", help="A run directory, an id, its first characters, or last.")]
Runs = Annotated[Path, typer.Option(metavar="DIR", help="Directory that holds the run directories.")]
RUNS = Path("runs")
_SEPARATORS = re.compile("[-_ ]+")  # between the words of a verdict, as a shell takes them without quotes
State = Annotated[
    str | None, typer.Option(metavar="STATE", help="Only runs in this state: running, completed, interrupted, …")
]
Verdict = Annotated[str | None, typer.Option(metavar="VERDICT", help="Only runs with this verdict: PASS, FAIL, …")]
Unit = Annotated[str | None, typer.Option(metavar="SERIAL", help="Only runs of this unit.")]
Last = Annotated[int | None, typer.Option(min=1, metavar="N", help="Only the newest N.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the runs as JSON.")]

Damaged = Annotated[
    bool, typer.Option("--damaged", help="Read the run even if it is damaged, and mark everything written from it.")
]

group = typer.Typer(help="List or verify runs.", invoke_without_command=True, rich_markup_mode=None)


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    app.add_typer(group, name="runs")
    app.command()(report)
    app.command()(export)


@group.callback()
@group.command("list")
def list_runs(
    context: typer.Context,
    runs: Runs = RUNS,
    state: State = None,
    verdict: Verdict = None,
    uut: Unit = None,
    last: Last = None,
    as_json: AsJson = False,
) -> None:
    """List the runs, oldest first; a run must match every filter."""
    if context.invoked_subcommand is not None:
        return
    from bench.report.status_text import runs_table
    from bench.store.manifest_form import SHOWN_STATES, VERDICTS
    from bench.store.runs import list_runs as found

    if state is not None:
        _expect_one_of("--state", SHOWN_STATES, state := state.lower())
    if verdict is not None:
        _expect_one_of("--verdict", VERDICTS, verdict := _SEPARATORS.sub(" ", verdict.upper()))

    matching = [
        run
        for run in found(runs)
        if (state is None or run.state == state)
        and (verdict is None or run.manifest.get("verdict") == verdict)
        and (uut is None or uut in run.units)
    ]
    shown = matching if last is None else matching[-last:]
    if as_json:
        sys.stdout.write(json.dumps([run.to_json() for run in shown], ensure_ascii=False) + "\n")
        return
    for line in runs_table(shown) if shown else [f"{runs}: no run" + (" like this" if last is None else "")]:
        sys.stdout.write(line + "\n")


@group.command()
def digest(run: Run, damaged: Damaged = False, runs: Runs = RUNS) -> None:
    """Print the digest of a run's data: equal for equal runs."""
    from bench.report.stored import open_run
    from bench.store.runs import find_run

    with open_run(find_run(run, runs), damaged=damaged) as stored:
        if stored.damage:
            sys.stderr.write("the run is damaged: this is the digest of what is left of it\n")
        sys.stdout.write(stored.reader.digest() + "\n")


@group.command()
def verify(run: Run, runs: Runs = RUNS) -> None:
    """Check a run against its chain, its seal and the ledger: sealed, intact up to a row, or damaged, and where."""
    from bench.report.verify import examined
    from bench.store.runs import find_run

    record = examined(find_run(run, runs))
    sys.stdout.write(f"{record.folder}: {record.in_words}\n")
    for line in (*record.damage, *record.remarks):
        sys.stdout.write(f"  {line}\n")
    if record.damage:
        raise typer.Exit(BENCH_ERROR)


def report(
    run: Run,
    form: Annotated[
        str,
        typer.Option(
            "--format", metavar="html|pdf|json|csv", help="html or pdf: the full report; json or csv: only the results."
        ),
    ] = "html",
    lang: Annotated[str, typer.Option("--lang", metavar="en|zh", help="The language of the report.")] = "en",
    damaged: Damaged = False,
    runs: Runs = RUNS,
) -> None:
    """Write the report of a run, even of an interrupted one."""
    from bench.report.languages import LANGUAGES
    from bench.report.stored import open_run
    from bench.report.write import FORMS, write_report
    from bench.store.runs import find_run

    _expect_one_of("--format", FORMS, form)
    _expect_one_of("--lang", LANGUAGES, lang)
    with open_run(find_run(run, runs), damaged=damaged) as stored:
        sys.stdout.write(f"{write_report(stored, form, lang)}\n")


def export(
    run: Run,
    form: Annotated[
        str, typer.Option("--format", metavar="csv|candump|parquet|matlab|hdf5", help="The file format.")
    ] = "csv",
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Directory for the files.")] = Path(),
    damaged: Damaged = False,
    runs: Runs = RUNS,
) -> None:
    """Write a run's data as files that other programs read.

    The format candump has the frames of acquisitions, not the whole bus: frames between acquisitions are not recorded.
    """
    from bench.report.export import FORMATS, mark_damage
    from bench.report.stored import open_run
    from bench.store.runs import find_run

    _expect_one_of("--format", FORMATS, form)
    with open_run(find_run(run, runs), damaged=damaged) as stored:
        for path in (*FORMATS[form](stored, out), *mark_damage(stored, out)):
            sys.stdout.write(f"{path}\n")


def _expect_one_of(option: str, known: Iterable[str], given: str) -> None:
    """Raises InputError for a value that an option does not have."""
    from bench.errors import InputError
    from drivers.suggest import nearest

    if given not in known:
        hint = f"; did you mean '{close}'?" if (close := nearest(given, known)) else ""
        raise InputError(f"{option} {given}: unknown, expected {', '.join(known)}{hint}")
