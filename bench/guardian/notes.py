"""Output of the guardian during a rescue; a blocked disk or terminal does not delay the rescue."""

from __future__ import annotations

import json
import os
import queue
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

from bench.clock import boot_id, since_boot_s, wall_utc
from bench.errors import StoreError
from bench.files import append_line
from bench.store.machine_state import append_record

WRITTEN_WITHIN_S, SHOWN_WITHIN_S = 5.0, 1.0  # time limits for writing
STDERR = 2


class Notes:
    """Lines for the terminal and entries of a record; a blocked terminal does not delay the record.

    The record is written to the directory of the run and to the records of the machine, or of this user; without a run
    only to the latter. `marks` are added to every entry.
    """

    def __init__(self, run: Path | None, file: str, **marks: str) -> None:
        self._run, self._file, self._marks = run, file, {"run": "" if run is None else str(run), **marks}
        self._terminal, self._records = _Worker(SHOWN_WITHIN_S), _Worker(WRITTEN_WITHIN_S)

    def line(self, text: str) -> None:
        """Show a line to a person."""
        self._terminal.do(partial(_show, text if self._run is None else f"{self._run.name}: {text}"))

    def entry(self, event: str, **facts: object) -> None:
        """Append an entry durably to both files, with the time of day and the time since the start of the computer."""
        since = {"boot": boot_id(), "up_s": round(since_boot_s(), 3)}  # the time of day may be set meanwhile
        at = wall_utc().isoformat(timespec="milliseconds")
        entry = {"at": at, **since, **self._marks, "event": event, **facts}
        self.do(partial(self._append, json.dumps(entry, ensure_ascii=False)))

    def do(self, work: Callable[[], object]) -> None:
        """Queue a function that writes a record."""
        self._records.do(work)

    def close(self) -> None:
        """Wait until everything is written, for at most the time limit; more may follow."""
        self._records.close()
        self._terminal.close()

    def _append(self, text: str) -> None:
        with suppress(OSError):
            if self._run is not None and self._run.is_dir():
                append_line(self._run / self._file, text)
        append_record(self._file, text)


class _Worker:
    """Worker thread that runs functions in order; it starts with the first one."""

    def __init__(self, within_s: float) -> None:
        self._within_s = within_s
        self._work: queue.SimpleQueue[Callable[[], object] | None] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None

    def do(self, work: Callable[[], object]) -> None:
        """Queue a function."""
        if self._thread is None:
            self._thread = threading.Thread(target=_write, args=(self._work,), name="notes", daemon=True)
            self._thread.start()
        self._work.put(work)

    def close(self) -> None:
        """Wait until the queue is empty, for at most the time limit; later functions run in another thread."""
        if self._thread is not None:
            self._work.put(None)
            self._thread.join(self._within_s)
            self._work, self._thread = queue.SimpleQueue(), None


def _write(works: queue.SimpleQueue[Callable[[], object] | None]) -> None:
    while (work := works.get()) is not None:
        with suppress(OSError, ValueError, StoreError):  # no disk, or the terminal is gone
            work()


def _show(text: str) -> None:
    os.write(STDERR, f"{text}\n".encode())
