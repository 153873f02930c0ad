"""Where the directory of a run is, whatever somebody does to its name while the run goes on."""

from __future__ import annotations

import contextlib
import os
import sqlite3
from pathlib import Path

from bench.errors import StoreError
from bench.files import make_folder
from bench.store.user_state import state_folder

RESCUED = "rescued"  # records of runs whose directory was removed, in the folder of states


class Place:
    """A file in a folder, both as they were when this was made; the folder is followed wherever it is moved to.

    The file itself is never opened: closing it would let go of the locks that SQLite has on it.
    """

    def __init__(self, file: Path) -> None:
        self._file, self._inode = file, _inode(file)
        self._folder = os.open(file.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)

    def is_left(self) -> bool:
        """Whether the file is not any more where it was."""
        return _inode(self._file) != self._inode

    def found(self) -> Path | None:
        """The folder with the file, wherever it is now; None where the file has no name any more."""
        with contextlib.suppress(OSError):
            folder = Path(os.readlink(f"/proc/self/fd/{self._folder}"))
            if _inode(folder / self._file.name) == self._inode:
                return folder
        return None

    def close(self) -> None:
        """Follow it no longer; closing twice is harmless."""
        if self._folder >= 0:
            os.close(self._folder)
            self._folder = -1


def rescue(database: sqlite3.Connection, run: str, file: str) -> Path:
    """Copy a database that has no name any more; the folder with the copy. Raises StoreError."""
    try:
        folder = state_folder() / RESCUED / run
        make_folder(folder)
        with contextlib.closing(sqlite3.connect(folder / file)) as copy:
            copy.execute("PRAGMA synchronous=FULL")
            database.backup(copy)
            copy.execute("PRAGMA journal_mode=DELETE")
    except (OSError, sqlite3.Error) as problem:
        raise StoreError(f"nothing of it could be kept ({problem})") from problem
    return folder


def _inode(path: Path) -> tuple[int, int] | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino
