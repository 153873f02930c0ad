"""Completion of a run: results, final manifest, seal and report."""

from __future__ import annotations

import shutil
from contextlib import ExitStack, suppress
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench.app.laboratory import Laboratory
from bench.clock import Stopwatch
from bench.engine.ending import Outcome
from bench.errors import StoreError, error_message
from bench.offline.calibration_content import calibration_files
from bench.runner.signals import Dropped, Signals
from bench.store.chain import Link, beginning
from bench.store.reader import RunReader, digest_of
from bench.store.runs import MANIFEST, RunDirectory
from bench.store.seal import close_record, file_hash
from bench.store.verify import changed_files, examine

if TYPE_CHECKING:  # a run starts without loading what only its results need
    from bench.reduce.evaluate import Results
    from bench.reduce.stored_run import StoredRun

RESULTS, TRUTH = "results.json", "truth.json"
FOREIGN = ".found"  # suffix of a file that was in the way of one of the run


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
        """Report, once it is written."""

    def results(
        self, laboratory: Laboratory | None, begun: bytes, end: Link, *, no_report: bool = False
    ) -> Results | None:
        """Reduce the run and write results, manifest and report; return None if it cannot be reduced.

        `begun` is the head of the first link of its chain, `end` the last link.
        """
        outcome, record, path = self._outcome, self._record, self._directory.path
        with suppress(OSError):  # a full disk shows in the later writes
            self._directory.free_reserve()
        stored, results = None, None
        with ExitStack() as stack:
            try:
                from bench.reduce.stored_run import StoredRun  # what a run needs only here

                record["digest"] = record["digest"] or digest_of(path)
                self._expect_unchanged()
                stored = StoredRun(path, {**record, "state": outcome.how}, stack.enter_context(RunReader(path)))
                results = stored.evaluate()
                self._write_results(stored, results, laboratory)
                record["verdict"] = results.verdict
            except Exception as problem:  # noqa: BLE001  the outcome of the run must be written all the same
                outcome.failed(error_message(problem))
                record["verdict"] = "ERROR"
                results = None if results is None else replace(results, verdict="ERROR")
            if beginning(path / MANIFEST) != begun:
                self._set_aside(MANIFEST)
            self._close(begun, end)
            if stored is not None and not no_report:
                stored.manifest = {**stored.manifest, **record}
                stored.record = examine(path, thoroughly=False)
                self._report(stored)
                if self.report is None:
                    self._close(begun, end)  # the manifest states the reason
        return results

    def _set_aside(self, name: str) -> None:
        """Rename a foreign file whose name the run needs, and record it in the manifest."""
        path = self._directory.path / name
        kept = path.with_name(f"{name}{FOREIGN}")
        try:
            shutil.copyfile(path, kept)
            what_became = f"what was there is kept in {kept.name}, which is not under the seal"
        except OSError as problem:
            what_became = f"what was there could not be kept ({problem})"
        self._outcome.problems.append(
            f"{path}: another program wrote or removed this file during the run. The run wrote its own; {what_became}"
        )

    def _expect_unchanged(self) -> None:
        """Raise StoreError if the input files differ from those written at the beginning of the run."""
        if changed := list(changed_files(self._directory.path, self._record["hashes"])):
            raise StoreError(f"{'; '.join(changed)}. The run is not reduced, because that is not what was run")

    def _write_results(self, stored: StoredRun, results: Results, laboratory: Laboratory | None) -> None:
        contents: dict[str, Any] = {}
        if laboratory is not None:
            from bench.app.truth import truth_of  # what only simulated runs need

            contents[TRUTH] = truth_of(stored, laboratory)
        contents[RESULTS] = results.to_json()
        contents |= dict(calibration_files(results.units, self._record, stored.bench))
        for name, content in contents.items():
            if (self._directory.path / name).exists():
                self._set_aside(name)
            self._directory.write_json(name, content)
            self._record["hashes"][name] = file_hash(self._directory.path / name)

    def _close(self, begun: bytes, end: Link) -> None:
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
            close_record(self._directory, self._record, begun, end, self._record["digest"])
        except StoreError as problem:
            outcome.failed(str(problem))
        except OSError as problem:
            text = f"the ledger of this computer cannot be written ({problem}); the run itself is sealed"
            if text not in outcome.problems:
                outcome.problems.append(text)

    def _report(self, stored: StoredRun) -> None:
        """Write the report; a failure is added to the outcome and affects nothing else."""
        again = f"'bench report {stored.folder}' tries again"
        try:
            with self._signals.dropping(self._signals_before):
                from bench.report.write import write_report  # imports matplotlib, which a run needs only here

                self.report = write_report(stored)
        except Dropped:
            received = self._signals.received[-1].name
            self._outcome.problems.append(
                f"no report was written, because a signal arrived meanwhile ({received}); {again}"
            )
        except Exception as problem:  # noqa: BLE001  the run is over, and its results are on the disk
            self._outcome.problems.append(f"no report could be written ({problem}); {again}")
