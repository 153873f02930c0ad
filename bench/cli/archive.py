"""archive: publication of runs, and questions to all of them."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from bench.cli.commands import Command, argument, arguments, flag, option, whole_number
from bench.cli.exits import BENCH_ERROR, PASS
from bench.cli.stored import RUNS
from bench.cli.streams import remark, say, say_json
from bench.errors import BenchError, InputError

if TYPE_CHECKING:  # keeps the libraries out of `bench --help`
    from bench.archive.query import Archive

ARCHIVE = option(
    "--archive DEST", "The archive: a folder, s3://BUCKET/PREFIX or azure://CONTAINER/PREFIX.",
    variable="BENCH_ARCHIVE", is_required=True,
)  # fmt: skip
JSON = flag("--json", "Print JSON.", to="as_json")


def push(runs_and_dest: tuple[str, ...], runs: Path, *, pending: bool, approved: bool) -> int:
    """Publish sealed runs to an archive; a run that is there already is left as it is.

    Without RUN, --pending publishes every ended run of the folder --runs that the archive does not have yet. A push
    that was interrupted is completed by the next one. Exit code 3 if a run could not be published; the others are.
    """
    from bench.archive.destination import Destination
    from bench.archive.pending import pending_runs
    from bench.archive.publish import push as pushed
    from bench.store.runs import find_run

    *names, dest = runs_and_dest
    if pending == bool(names):
        raise InputError("bench archive push: give RUN and DEST, or --pending and DEST")
    destination = Destination(dest)
    chosen = [find_run(name, runs) for name in names] if names else pending_runs(runs, destination, approved=approved)
    failed = 0
    for run in chosen:
        try:
            found = pushed(run, destination)
        except BenchError as problem:
            if len(chosen) == 1:
                raise
            remark(problem)
            failed += 1
        else:
            say(f"{run.name}: version {found.number} " + (
                "is there already" if found.was_there
                else f"published to {destination.url}/{found.folder}, {found.objects} files, {found.bytes} bytes"
            ))  # fmt: skip
    if not chosen:
        say(f"{runs}: nothing to publish")
    return BENCH_ERROR if failed else PASS


def query(sql: str, archive: str, out: Path | None, *, as_json: bool) -> None:
    """Answer a question in SQL (that of DuckDB).

    Views: runs, findings, budgets, instruments, certificates; with all_ before the name every version of each run.
    """
    from bench.archive.shown import table_lines, written

    opened = _opened(archive)
    if out is not None:
        say(written(opened, sql, out))
        return
    found = opened.query(sql)
    if as_json:
        import json

        say(json.dumps(found.records(), ensure_ascii=False, default=str))
        return
    say(*table_lines(found))


def units(serial: str, archive: str, *, as_json: bool) -> None:
    """Show all calibrations of a unit, with E_n between them and the drift of each result."""
    from bench.archive.shown import history_lines
    from bench.archive.units import unit_history

    found = unit_history(_opened(archive), serial)
    if as_json:
        say(found.model_dump_json())
        return
    say(*history_lines(found))


def compare(first: str, second: str, archive: str, *, as_json: bool) -> None:
    """Compare the results of two runs; ! marks a difference beyond its expanded uncertainty."""
    from bench.archive.shown import compared_lines
    from bench.archive.units import compared

    found = compared(_opened(archive), first, second)
    if as_json:
        say_json([each._asdict() | {"difference": each.difference} for each in found])
        return
    say(*compared_lines(found))


def due(archive: str, within: int, *, simulated: bool, as_json: bool) -> None:
    """List the instruments and units that are to be calibrated again."""
    from bench.archive.shown import due_lines
    from bench.archive.units import due as found_due

    found = found_due(_opened(archive), within, simulated=simulated)
    if as_json:
        say_json([each._asdict() | {"when": each.when.isoformat()} for each in found])
        return
    say(*due_lines(found) if found else [f"nothing is due within {within} days"])


def fetch(run: str, archive: str, into: Path, version: int | None) -> None:
    """Restore a run directory from an archive and verify it."""
    from bench.archive.fetch import fetch as fetched

    say(fetched(_opened(archive), run, into, version))


def reduce(run: str, archive: str, *, publish: bool) -> None:
    """Reduce an archived run again with this program, and list what changes; `bench campaign reduce` does all runs.

    With --publish, changed results become a new version; a certificate remains that of the results it was approved for.
    """
    import tempfile

    from bench.archive.reduction import candidates, reduce_again
    from bench.archive.units import run_of
    from bench.campaign.program import present

    opened = _opened(archive)
    uuid = run_of(opened, run)
    with tempfile.TemporaryDirectory() as scratch:
        version = next(each.version for each in candidates(opened, present()) if each.uuid == uuid)
        found, number = reduce_again(opened, uuid, version, Path(scratch), program=present(), publish=publish)
    say(*found.in_words())
    if number is not None:
        say(f"{found.run}: version {number} published, beside version {version}")


def export(archive: str, url: str) -> None:
    """Write runs and findings to a SQL database: new runs and new versions, by tables itb_runs and itb_findings.

    An interrupted export is completed by the next one. A URL with a password is given by the variable BENCH_SQL_URL,
    which other users of the computer do not see.
    """
    from bench.archive.database import SqlDatabase

    with closing(SqlDatabase(url)) as database:
        say(f"{database.name}: {database.upsert(_opened(archive))} runs written")


def tidy(archive: str) -> None:
    """Merge the small files of the tables, so that queries stay fast; runs can be published meanwhile."""
    from bench.archive.destination import Destination
    from bench.archive.tables import Tables

    destination = Destination(archive)
    destination.expect()
    say(*(f"{name}: {before} files, now {now}" for name, (before, now) in Tables(destination).tidy().items()))


def _opened(archive: str) -> Archive:
    from bench.archive.query import opened

    return opened(archive)


COMMANDS = (
    Command("archive push", push, (
        arguments("RUN|DEST", "Runs, and last the archive: a folder, s3://BUCKET/PREFIX or azure://CONTAINER/PREFIX.",
                  to="runs_and_dest", least=1),
        flag("--pending", "All runs that the archive does not have."),
        flag("--approved", "With --pending: only runs whose report is approved."),
        RUNS,
    )),
    Command("archive query", query, (
        argument("SQL", "The question."),
        ARCHIVE,
        option("--out FILE", "Write the answer as .csv or .parquet.", read=Path),
        JSON,
    )),
    Command("archive units", units, (argument("SERIAL", "Serial number of the unit."), ARCHIVE, JSON)),
    Command("archive compare", compare, (
        argument("FIRST", "A run: its name, its UUID or a unique beginning."),
        argument("SECOND", "Another run."),
        ARCHIVE,
        JSON,
    )),
    Command("archive due", due, (
        ARCHIVE,
        option("--within DAYS", "Days from today.", read=whole_number(0), default=30),
        flag("--simulated", "Also simulated instruments and units."),
        JSON,
    )),
    Command("archive fetch", fetch, (
        argument("RUN", "A run: its name, its UUID or a unique beginning."),
        ARCHIVE,
        option("--into DIR", "Folder that gets the run directory.", read=Path, default=Path("runs")),
        option("--version N", "An earlier version instead of the latest.", read=whole_number(1)),
    )),
    Command("archive reduce", reduce, (
        argument("RUN", "A run: its name, its UUID or a unique beginning."),
        ARCHIVE,
        flag("--publish", "Changed results become a new version."),
    )),
    Command("archive export", export, (
        ARCHIVE,
        option("--url URL", "The database, as SQLAlchemy has it: postgresql+psycopg://USER@HOST/NAME, sqlite:///FILE.",
               variable="BENCH_SQL_URL", is_required=True),
    )),
    Command("archive tidy", tidy, (ARCHIVE,)),
)  # fmt: skip
