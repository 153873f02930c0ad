"""Location of the directory of a running run, even if it is moved, renamed or truncated meanwhile."""

from __future__ import annotations

import contextlib
import os
import sqlite3
from collections.abc import Iterable
from pathlib import Path

from bench.clock import Stopwatch, wall_utc
from bench.errors import StoreError
from bench.files import make_folder
from bench.store.chain import Link, check_rows
from bench.store.user_state import state_folder

RESCUED = "rescued"  # subfolder for records of runs whose directory was removed
LOOK_EVERY_S = 1.0
SAME_TICK_S = 0.05  # two changes of a folder within a tick of the clock of the kernel may have the same time


class WatchedFiles:
    """Files of a folder, identified by inode; the folder is found again wherever it is moved.

    The first file never shrinks in normal operation: SQLite does not vacuum a database unless asked, while it rewrites
    its log from the beginning. The files themselves are never opened, since closing one would release the locks that
    SQLite holds on it.
    """

    def __init__(self, folder: Path, names: Iterable[str]) -> None:
        self._path, self._inodes = folder, {name: _inode(folder / name) for name in names}
        self._files = {str(folder / name): inode for name, inode in self._inodes.items()}
        self._grows, self._size = next(iter(self._files)), 0
        self._folder = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        self._unchanged: tuple[int, int, int] | None = None  # `_entries` of the folder when all files were last there
        self._looked = Stopwatch()

    def missing(self) -> Path | None:
        """Return the folder or file that is no longer at its path, or None if all are there.

        The files are checked when the folder has changed, and every second. Checking the log in every commit makes a
        commit a tenth slower: since Linux 6.13, the write that follows `stat` of a file has to update its time stamps.
        """
        folder = _entries(self._path)
        if folder is not None and folder == self._unchanged and self._looked.elapsed_s() < LOOK_EVERY_S:
            return None
        gone = [path for path, inode in self._files.items() if _inode(path) != inode]
        is_conclusive = folder is not None and not gone and wall_utc().timestamp() - folder[2] / 1e9 > SAME_TICK_S
        self._unchanged, self._looked = folder if is_conclusive else None, Stopwatch()
        if not gone:
            return None
        return self._path if len(gone) == len(self._files) else Path(gone[0])

    def truncated(self) -> Path | None:
        """Return the first file if it has shrunk since the last call, else None."""
        found = _stat(self._grows)
        if found is None:  # reported by `missing`
            return None
        size = found.st_size
        if size < self._size:
            return Path(self._grows)
        self._size = size
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


def _entries(folder: Path) -> tuple[int, int, int] | None:
    """Device and inode of a folder, and when an entry of it last changed, in ns; None if it is gone."""
    found = _stat(folder)
    return None if found is None else (found.st_dev, found.st_ino, found.st_mtime_ns)


def _stat(path: Path | str) -> os.stat_result | None:
    try:
        return os.stat(path)
    except OSError:
        return None
