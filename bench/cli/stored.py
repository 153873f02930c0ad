"""runs, report, export: commands for stored runs."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from bench.cli.collection import uncollected
from bench.cli.commands import Command, argument, flag, option, whole_number
from bench.cli.exits import BENCH_ERROR, PASS
from bench.cli.streams import remark, say, say_json

if TYPE_CHECKING:
    from bench.certificates.signature import Key

RUN = argument("RUN", "A run directory, an id, its first characters, or last.")
RUNS = option("--runs DIR", "Directory that holds the run directories.", read=Path, default=Path("runs"))
DAMAGED = flag("--damaged", "Read the run even if it is damaged, and mark everything written from it.")
DCC = "dcc"
_SEPARATORS = re.compile("[-_ ]+")  # between words of a verdict, which a shell accepts without quotes


def list_runs(
    runs: Path, state: str | None, verdict: str | None, uut: str | None, last: int | None, *, as_json: bool
) -> None:
    """List the runs, oldest first; a run must match every filter."""
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
        say_json([run.to_json() for run in shown])
        return
    say(*runs_table(shown) if shown else [f"{runs}: no run" + (" like this" if last is None else "")])


def digest(run: str, runs: Path, *, damaged: bool) -> None:
    """Print the digest of a run's data: equal for equal runs."""
    from bench.reduce.stored_run import open_run
    from bench.store.runs import find_run

    with open_run(find_run(run, runs), damaged=damaged) as stored:
        if stored.damage:
            remark("the run is damaged: this is the digest of what is left of it")
        say(stored.reader.digest())


def verify(run: str, runs: Path) -> int:
    """Verify a run by its chain, its seal and the ledger: sealed, intact up to a row, or damaged, and where."""
    from bench.report.revision import examined
    from bench.store.runs import find_run

    record = examined(find_run(run, runs))
    remarks = (*record.damage, *record.remarks)
    say(f"{record.folder}: {record.in_words}", *(f"  {line}" for line in remarks))
    return BENCH_ERROR if record.damage else PASS


def report(
    run: str,
    runs: Path,
    form: str,
    lang: str,
    out: Path | None,
    sign: Path | None,
    dcc_version: str | None,
    *,
    damaged: bool,
) -> None:
    """Write the report of a run, even of an interrupted one; or the certificate of an approved one.

    Beside an approved report no other is written; --out FILE writes a copy elsewhere. The format dcc is a Digital
    Calibration Certificate, with the approved report inside.
    """
    with uncollected():
        from bench.errors import InputError
        from bench.figures.languages import LANGUAGES
        from bench.optional import imported
        from bench.reduce.stored_run import open_run
        from bench.report.dcc.versions import DEFAULT, VERSIONS
        from bench.report.write import FORMS, write_report
        from bench.store.runs import find_run

    _expect_one_of("--format", (*FORMS, DCC), form)
    _expect_one_of("--lang", LANGUAGES, lang)
    if sign is not None and form != DCC:
        raise InputError("--sign is for --format dcc; the station signs a PDF when it is approved")
    if dcc_version is not None:
        _expect_one_of("--dcc-version", VERSIONS, dcc_version)
        if form != DCC:
            raise InputError("--dcc-version is for --format dcc")
    key = _key(sign) if sign is not None else None
    with open_run(find_run(run, runs), damaged=damaged) as stored:
        if form == DCC:
            imported("lxml", DCC)
            from bench.report.dcc.write import write_certificate

            say(write_certificate(stored, lang, out, key, dcc_version or DEFAULT))
        else:
            say(write_report(stored, form, lang, out))


def _key(station: Path) -> Key:
    """Return the key of a station. Raises InputError if it has none, or one that cannot sign."""
    from bench.config.load import load_file
    from bench.errors import InputError
    from bench.optional import imported
    from bench.station.settings import StationFile
    from bench.station.signoff.key import key_files

    imported("signxml", DCC)
    entry = load_file(station, StationFile).signature
    if entry is None:
        raise InputError(f"{station}: has no signature; state the key of the laboratory there")
    from bench.certificates.signature import Key
    from bench.station.signoff.loaded_key import loaded_key

    return Key(*loaded_key(key_files(entry, station.absolute().parent)))


def export(run: str, runs: Path, form: str, out: Path, every_frame: Path | None, *, damaged: bool) -> None:
    """Write a run's data in formats that other programs read.

    The format candump has the frames of acquisitions, not the whole bus. A run started with --trace FILE has recorded
    the whole bus in FILE: --all FILE writes all frames of that.
    """
    from bench.errors import InputError
    from bench.reduce.stored_run import open_run
    from bench.report.export.candump import export_trace
    from bench.report.export.export import FORMATS, mark_damage
    from bench.store.runs import find_run

    _expect_one_of("--format", FORMATS, form)
    if every_frame is not None and form != "candump":
        raise InputError("--all is for --format candump")
    with open_run(find_run(run, runs), damaged=damaged) as stored:
        written = FORMATS[form](stored, out) if every_frame is None else export_trace(stored, every_frame, out)
        say(*written, *mark_damage(stored, out))


def _expect_one_of(option: str, known: Iterable[str], given: str) -> None:
    """Raise InputError if the value is not one of the known ones."""
    from bench.errors import InputError
    from drivers.schema.suggest import nearest

    if given not in known:
        hint = f"; did you mean '{close}'?" if (close := nearest(given, known)) else ""
        raise InputError(f"{option} {given}: unknown, expected {', '.join(known)}{hint}")


LIST = (
    RUNS,
    option("--state STATE", "Only runs in this state: running, completed, interrupted, …"),
    option("--verdict VERDICT", "Only runs with this verdict: PASS, FAIL, …"),
    option("--uut SERIAL", "Only runs of this unit."),
    option("--last N", "Only the newest N.", read=whole_number(1)),
    flag("--json", "Print the runs as JSON.", to="as_json"),
)
COMMANDS = (
    Command("runs", list_runs, LIST),
    Command("runs list", list_runs, LIST),
    Command("runs digest", digest, (RUN, RUNS, DAMAGED)),
    Command("runs verify", verify, (RUN, RUNS)),
    Command("report", report, (
        RUN,
        RUNS,
        option(
            "--format html|pdf|json|csv|dcc",
            "html or pdf: the full report; json or csv: only the results; dcc: the certificate of an approved run.",
            to="form", default="html",
        ),
        option("--lang en|zh", "The language of the report.", default="en"),
        option("--out FILE", "The file to write; default: in the directory of the run.", read=Path),
        option("--sign STATION.yaml", "With dcc: sign it with the key of this station.", read=Path),
        option("--dcc-version VERSION", "With dcc: version of its schema, 3.1.2 (default), 3.2.1 or 3.3.0."),
        DAMAGED,
    )),
    Command("export", export, (
        RUN,
        RUNS,
        option("--format csv|candump|parquet|matlab|hdf5", "The file format.", to="form", default="csv"),
        option("--out DIR", "Directory for the files.", read=Path, default=Path()),
        option(
            "--all FILE", "candump: all CAN frames of the run's trace, also those between acquisitions.",
            read=Path, to="every_frame",
        ),
        DAMAGED,
    )),
)  # fmt: skip
