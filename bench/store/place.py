"""Location of the directory of a running run, even if it is moved, renamed or truncated meanwhile."""

from __future__ import annotations

import contextlib
import os
import sqlite3
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from bench.clock import Stopwatch
from bench.errors import StoreError
from bench.files import make_folder
from bench.store.chain import Link, check_rows
from bench.store.user_state import state_folder

RESCUED = "rescued"  # subfolder for records of runs whose directory was removed
LOOK_EVERY_S = 1.0


class Loss(NamedTuple):
    """A folder or file that is missing from its path, or a file that was truncated."""

    path: Path
    is_truncated: bool = False


class WatchedFiles:
    """Files of a folder, identified by inode; the folder is found again wherever it is moved.

    The first file never shrinks in normal operation: SQLite does not vacuum a database unless asked, while it rewrites
    its log from the beginning. The files themselves are never opened, since closing one would release the locks that
    SQLite holds on it.
    """

    def __init__(self, folder: Path, names: Iterable[str]) -> None:
        self._path, self._inodes = folder, {name: _inode(folder / name) for name in names}
        self._files = {str(folder / name): inode for name, inode in self._inodes.items()}
        self._first, self._size = next(iter(self._files.items())), 0
        self._folder = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        self._looked = Stopwatch()

    def lost(self) -> Loss | None:
        """Return the folder or file that is missing from its path, or a truncated first file; None if there is none.

        A file that was replaced is missing. Truncated means shorter than at the last call. Each call checks the first
        file, and thus the path of the folder; the other files are checked every second. Checking the log in every
        commit makes a commit a tenth slower: since Linux 6.13, the write that follows `stat` of a file has to update
        its time stamps.
        """
        path, inode = self._first
        found = _stat(path)
        is_there = found is not None and (found.st_dev, found.st_ino) == inode
        if not is_there or self._looked.elapsed_s() >= LOOK_EVERY_S:
            self._looked = Stopwatch()
            gone = [each for each, known in self._files.items() if _inode(each) != known]
            if gone:
                return Loss(self._path if len(gone) == len(self._files) else Path(gone[0]))
        if found is None:  # it was there again a moment later
            return None
        if found.st_size < self._size:
            return Loss(Path(path), is_truncated=True)
        self._size = found.st_size
        return None

    def found(self) -> Path | None:
        """Return the present path of the folder, or None if one of the files has been deleted."""
        with contextlib.suppress(OSError):
            folder = Path(os.readlink(f"/proc/self/fd/{self._folder}"))
            if all(_inode(folder / name) == inode for name, inode in self._inodes.items()):
                return folder
        return None

    def close(self) -> None:
        """Stop tracking the folder; closing twice is harmless."""
        if self._folder >= 0:
            os.close(self._folder)
            self._folder = -1


def rescue(database: sqlite3.Connection, run: str, file: str) -> Path:
    """Copy a deleted database that is still open; return the folder of the copy. Raises StoreError."""
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


def rescue_database(database: sqlite3.Connection, run: str, file: str, last: Link) -> Path:
    """Copy a database with lost pages; return the folder of the copy, which is complete up to the link `last`.

    The copy includes pages that are only in the log or in memory. Raises StoreError, with the number of intact rows, if
    the copy is incomplete.
    """
    folder = rescue(database, run, file)
    with contextlib.closing(sqlite3.connect(folder / file)) as copy:
        walked = check_rows(copy)
    if walked.damage or walked.links[-1:] != (last,):
        rows = 0 if walked.intact is None else walked.intact.total
        raise StoreError(
            f"not all of it could be kept: {folder / file} is a copy of what could be read, intact up to row {rows} of "
            f"{last.total}"
        )
    return folder


def _inode(path: Path | str) -> tuple[int, int] | None:
    found = _stat(path)
    return None if found is None else (found.st_dev, found.st_ino)


def _stat(path: Path | str) -> os.stat_result | None:
    try:
        return os.stat(path)
    except OSError:
        return None
