"""A run directory for reduction and reports, finished or not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

from bench.config.bench import load_kept_bench
from bench.errors import StoreError
from bench.metrology.run_data import RunData, UnitUnderTest
from bench.reduce.acquisitions import run_data
from bench.reduce.corrections import correction_lines
from bench.reduce.evaluate import Results, evaluate
from bench.reduce.gaps import MissedIn, missed_in_run
from bench.reduce.journal import JournalRecords, journal_records
from bench.sequence.load import load_sequence
from bench.sequence.method import CountsAt, known_methods
from bench.sequence.plan.result_settings import as_chosen
from bench.store.kept_json import LIMIT_BYTES, read_kept
from bench.store.manifest_form import WHOLE_FORM
from bench.store.reader import RunReader
from bench.store.runs import BENCH_COPY, MANIFEST, SEAL, SEQUENCE_COPY, released_copy, summary
from bench.store.verify import Record, examine
from drivers.schema.bounded import UnfitFileError, expect_bounded

MOST_SHOWN = 3  # places of damage in a message


class StoredRun:
    """Manifest, kept files and data of a run; raises InputError or StoreError for missing ones."""

    def __init__(
        self, folder: Path, manifest: Mapping[str, Any], reader: RunReader, record: Record | None = None
    ) -> None:
        self.folder, self.manifest, self.reader = folder, manifest, reader
        self.record = record
        self.bench = load_kept_bench(folder / BENCH_COPY)
        self.document, as_kept = load_sequence(folder / SEQUENCE_COPY)
        self.sequence = as_chosen(as_kept, manifest.get("parameters", {}))
        self.serials = {unit["place"]: unit["uut"] for unit in manifest["units"]}
        self._data: dict[str, RunData] = {}
        self._evaluated: dict[str, Results] = {}  # by the state of the run

    @property
    def damage(self) -> tuple[str, ...]:
        """Damage of the record; empty for a record that was not examined."""
        return self.record.damage if self.record is not None else ()

    @property
    def began(self) -> datetime:
        """The UTC instant at which bench time began."""
        event = next(self.reader.events("run_begins"), None)
        return datetime.fromisoformat(event.data["utc"] if event else self.manifest["started"])

    def data(self, label: str) -> RunData:
        """Acquisitions under a label."""
        if label not in self._data:
            counted = {known_methods()[each.method].counts_at for each in self.sequence.results if label in each.labels}
            windows = counted == {"windows"}
            data = run_data(self.reader, self.bench, self.serials, label, windows=windows)
            self._data[label] = replace(data, units=tuple(map(self._with_calibration, data.units)))
        return self._data[label]

    def _with_calibration(self, unit: UnitUnderTest) -> UnitUnderTest:
        """A unit with the released calibration that was given to the run, if any."""
        if unit.place not in self.manifest.get("released", {}):
            return unit
        from bench.offline.calibration_file import read_calibration  # most runs have none

        known = read_calibration(self.folder / released_copy(unit.place))
        if known.run == self.manifest["run"]:
            raise StoreError(
                f"{released_copy(unit.place)} in {self.folder} is the calibration that this run itself found: data to "
                "which a model was fitted cannot verify it. Give the calibration to a new run of the unit instead"
            )
        return replace(unit, released=known.released())

    def counted_at(self, what: CountsAt) -> list[RunData]:
        """Acquisitions of methods with one of these layouts."""
        entries = [entry for entry in self.sequence.results if known_methods()[entry.method].counts_at == what]
        return [self.data(label) for label in dict.fromkeys(label for entry in entries for label in entry.labels)]

    def evaluate(self) -> Results:
        """Findings of the methods of the sequence; computed once for a state of the run."""
        state = str(self.manifest["state"])
        if state not in self._evaluated:
            found = evaluate(self.sequence, self.data, state, self.journal_records)
            self._evaluated[state] = replace(
                found,
                verdict="ERROR" if self.damage else found.verdict,
                corrections=tuple(self.corrections()),
                past_due=self.bench.past_due(self.began.date()),
                missed=self.missed(),
            )
        return self._evaluated[state]

    @property
    def journal_records(self) -> JournalRecords:
        """Contents of its journal."""
        places = self.bench.places
        return journal_records(self.reader, [place for place in self.serials if not places[place].has_power_cycles])

    def corrections(self) -> Iterator[str]:
        """A line for each instrument whose readings are corrected in the reduction of this run."""
        return correction_lines(self.bench, self._reduced())

    def missed(self) -> tuple[MissedIn, ...]:
        """Lost frames of the units, by acquisition."""
        return missed_in_run(self.reader, self.bench, self.serials, self._reduced())

    def _reduced(self) -> list[RunData]:
        """Acquisitions that methods reduce."""
        labels = dict.fromkeys(label for entry in self.sequence.results for label in entry.labels)
        return [self.data(label) for label in labels]


def _without_manifest(folder: Path) -> str:
    """Advice on a manifest that cannot be read."""
    if (folder / SEAL).exists():
        return "it existed when the run was sealed: restore it from a copy"
    return "without it the run cannot be read: restore it from a copy; a run killed at its start has none"


@contextmanager
def _damage_as_store_error(record: Record) -> Iterator[None]:
    """Raise StoreError instead of any error that altered contents of a damaged record cause in their readers."""
    try:
        yield
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as problem:
        if not record.damage:
            raise
        raise StoreError(
            f"{record.folder}: {record.in_words}. What is left of it cannot be read ({type(problem).__name__}: "
            f"{problem}). Restore it from a copy"
        ) from problem


@contextmanager
def open_run(folder: Path, *, damaged: bool = False) -> Iterator[StoredRun]:
    """Open a run directory in any state; an interrupted run holds the acknowledged data.

    A damaged record is refused with StoreError, unless `damaged` is true.
    """
    try:
        expect_bounded(folder / MANIFEST, LIMIT_BYTES)
    except UnfitFileError as problem:
        raise StoreError(f"{folder / MANIFEST}: {problem}; {_without_manifest(folder)}") from problem
    record = examine(folder, thoroughly=False)
    if record.damage and not damaged:
        raise StoreError(
            f"{folder}: {record.in_words}. {'; '.join(record.damage[:MOST_SHOWN])}. It is not read, to avoid "
            "results from altered data. Restore it from a copy, or read it with --damaged, which marks everything "
            "written from it"
        )
    manifest = read_kept(folder / MANIFEST, WHOLE_FORM)
    state = summary(folder).state
    with _damage_as_store_error(record), RunReader(folder) as reader:
        yield StoredRun(
            folder, {**manifest, "state": manifest["state"] if state == "damaged" else state}, reader, record
        )
