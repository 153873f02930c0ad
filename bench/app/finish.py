"""What is written when a run is over: its manifest, its results, and at last the report of it all."""

from __future__ import annotations

from contextlib import ExitStack, suppress
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from bench.app.laboratory import Laboratory
from bench.app.truth import truth_of
from bench.clock import Stopwatch
from bench.engine.ending import Outcome
from bench.errors import StoreError, in_words
from bench.report.calibration import calibration_files
from bench.report.findings import Results
from bench.report.stored import StoredRun
from bench.runner import manifest
from bench.runner.signals import Dropped, Signals
from bench.store.chain import Link
from bench.store.reader import RunReader, digest_of
from bench.store.runs import RunDirectory
from bench.store.seal import close_record
from bench.store.verify import changed_files, examine

RESULTS, TRUTH = "results.json", "truth.json"


class Finish:
    """Completes a run directory and seals it.

    Problems are added to the outcome. A signal drops the report, but not the results
    and the manifest.
    """

    def __init__(
        self, directory: RunDirectory, record: dict[str, Any], outcome: Outcome, signals: Signals, watch: Stopwatch
    ) -> None:
        self._directory, self._record, self._outcome = directory, record, outcome
        self._signals, self._watch = signals, watch
        self._signals_before = len(signals.received)
        self.report: Path | None = None
        """The report, once it is written."""

    def results(self, laboratory: Laboratory | None, end: Link) -> Results | None:
        """Reduces the run and writes results, manifest and report; None where it cannot be reduced."""
        outcome, record, path = self._outcome, self._record, self._directory.path
        with suppress(OSError):  # a full disk shows in the writes that follow
            self._directory.use_reserve()
        stored, results = None, None
        with ExitStack() as stack:
            try:
                record["digest"] = record["digest"] or digest_of(path)
                self._expect_unchanged()
                stored = StoredRun(path, {**record, "state": outcome.how}, stack.enter_context(RunReader(path)))
                results = stored.evaluate()
                self._write_results(stored, results, laboratory)
                record["verdict"] = results.verdict
            except Exception as problem:  # noqa: BLE001  what was measured is on the disk; the run says how it ended
                outcome.failed(in_words(problem))
                record["verdict"] = "ERROR"
                results = None if results is None else replace(results, verdict="ERROR")
            self._close(end)
            if stored is not None:
                stored.manifest = {**stored.manifest, **record}
                stored.record = examine(path, thoroughly=False)
                self._report(stored)
        return results

    def _expect_unchanged(self) -> None:
        """Raise StoreError where the files that the run was made of are not those that it wrote when it began."""
        if changed := list(changed_files(self._directory.path, self._record["hashes"])):
            raise StoreError(f"{'; '.join(changed)}. The run is not reduced, because that is not what was run")

    def _write_results(self, stored: StoredRun, results: Results, laboratory: Laboratory | None) -> None:
        contents = {} if laboratory is None else {TRUTH: truth_of(stored, laboratory)}
        contents[RESULTS] = results.to_json()
        contents |= dict(calibration_files(results.units, self._record, stored.bench))
        for name, content in contents.items():
            self._directory.write_json(name, content)
            self._record["hashes"][name] = manifest.file_hash(self._directory.path / name)

    def _close(self, end: Link) -> None:
        """Write the final manifest and the seal; a failure is added to the outcome."""
        outcome, elapsed_s = self._outcome, self._watch.elapsed_s()
        ended = datetime.fromisoformat(self._record["started"]) + timedelta(seconds=elapsed_s)
        self._record |= {
            "state": outcome.how,
            "problems": outcome.problems,
            "unsafe": outcome.unsafe,
            "not_reached": outcome.not_reached,
            "ended_by": None if outcome.ended_by is None else outcome.ended_by.by,
            "ended": ended.isoformat(timespec="seconds"),
            "wall_s": elapsed_s,
            "sealed": True,
        }
        try:
            close_record(self._directory, self._record, end, self._record["digest"])
        except StoreError as problem:
            outcome.failed(str(problem))
        except OSError as problem:
            outcome.problems.append(
                f"the ledger of this computer cannot be written ({problem}); the run itself is sealed"
            )

    def _report(self, stored: StoredRun) -> None:
        """Write the report; a failure is added to the outcome and affects nothing else."""
        again = f"'bench report {stored.folder}' tries again"
        try:
            with self._signals.dropping(self._signals_before):
                from bench.report.write import write_report  # and matplotlib with it, which a run needs only here

                self.report = write_report(stored)
        except Dropped:
            self._outcome.problems.append(f"no report was written, because a signal arrived meanwhile; {again}")
        except Exception as problem:  # noqa: BLE001  the run is over, and its results are on the disk
            self._outcome.problems.append(f"no report could be written ({problem}); {again}")
