"""Copies of the database of a station, while the station has it open and when it does not run."""

from __future__ import annotations

import os
import threading
import uuid
from pathlib import Path

from bench.clock import Stopwatch
from bench.errors import BenchError, InUseError
from bench.files import make_folder
from bench.station.part import Part
from bench.station.storage.database import Database

FOLDER = "snapshots"
WANTED, COPY = ".wanted", ".db"
ANSWERS_WITHIN_S = 15.0
_BETWEEN_LOOKS_S = 0.1
_pause = threading.Event().wait


class Snapshots(Part):
    """Part that copies the database for each file `*.wanted` in a folder of the station.

    Only who may write to that folder, which is the user of the station, can ask for a copy.
    """

    def __init__(self, database: Database) -> None:
        super().__init__()
        self._database = database

    async def look(self) -> None:
        """Make the copies that are wanted. Raises StoreError and OSError."""
        for wanted in sorted((self._database.path.parent / FOLDER).glob(f"*{WANTED}")):
            self._database.copy_to(wanted.with_suffix(COPY))
            wanted.unlink(missing_ok=True)


def snapshot(folder: Path) -> Path:
    """Return a new copy of the database of the station in a folder; the caller removes it.

    Raises StoreError, and BenchError if a station that runs there does not make the copy in time.
    """
    wanted = folder / FOLDER / f"{uuid.uuid4().hex}{WANTED}"
    copy = wanted.with_suffix(COPY)
    make_folder(wanted.parent)
    try:
        database = Database(folder)
    except InUseError:
        _ask(wanted)
    else:
        try:
            database.copy_to(copy)
        finally:
            database.close()
    return copy


def _ask(wanted: Path) -> None:
    watch = Stopwatch()
    os.close(os.open(wanted, os.O_CREAT | os.O_EXCL | os.O_WRONLY | os.O_CLOEXEC, 0o600))
    while wanted.exists():
        if watch.elapsed_s() > ANSWERS_WITHIN_S:
            wanted.unlink(missing_ok=True)
            raise BenchError(
                f"{wanted.parent.parent}: the station that runs there has made no copy of its database within "
                f"{ANSWERS_WITHIN_S:g} s; see its messages, or stop it and try again"
            )
        _pause(_BETWEEN_LOOKS_S)
