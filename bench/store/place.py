"""Where the directory of a run is, whatever somebody does to its names and its files while the run goes on."""

from __future__ import annotations

import contextlib
import os
import sqlite3
from collections.abc import Iterable
from pathlib import Path

from bench.errors import StoreError
from bench.files import make_folder
from bench.store.chain import Link, walk
from bench.store.user_state import state_folder

RESCUED = "rescued"  # records of runs whose directory was removed, in the folder of states


class Place:
    """Files in a folder, all as they were when this was made; the folder is followed wherever it is moved to.

    The first of them never becomes smaller: SQLite gives no page of a database back unless it is told to, and writes
    its log, another one, from the beginning as it likes. The files themselves are never opened: closing one would let
    go of the locks that SQLite has on it.
    """

    def __init__(self, folder: Path, names: Iterable[str]) -> None:
        self._path, self._inodes = folder, {name: _inode(folder / name) for name in names}
        self._grows, self._size = folder / next(iter(self._inodes)), 0
        self._folder = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)

    def missing(self) -> Path | None:
        """What is not any more where it was: the folder, or a file in it; None where all are."""
        gone = [name for name, inode in self._inodes.items() if _inode(self._path / name) != inode]
        if not gone:
            return None
        return self._path if len(gone) == len(self._inodes) else self._path / gone[0]

    def truncated(self) -> Path | None:
        """The first file, where it has become smaller than it was at an earlier look; None where it has not."""
        with contextlib.suppress(OSError):  # it is missing
            size = self._grows.stat().st_size
            if size < self._size:
                return self._grows
            self._size = size
        return None

    def found(self) -> Path | None:
        """The folder with the files, wherever it is now; None where one of them has no name any more."""
        with contextlib.suppress(OSError):
            folder = Path(os.readlink(f"/proc/self/fd/{self._folder}"))
            if all(_inode(folder / name) == inode for name, inode in self._inodes.items()):
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


def rescue_whole(database: sqlite3.Connection, run: str, file: str, last: Link) -> Path:
    """Copy a database of which pages are lost; the folder with the copy, which has all up to the link `last`.

    What the log beside it, or memory, still has is in the copy. Raises StoreError, with how much is in the copy, where
    that is not all.
    """
    folder = rescue(database, run, file)
    with contextlib.closing(sqlite3.connect(folder / file)) as copy:
        walked = walk(copy)
    if walked.damage or walked.links[-1:] != (last,):
        rows = 0 if walked.intact is None else walked.intact.total
        raise StoreError(
            f"not all of it could be kept: {folder / file} is a copy of what could be read, intact up to row {rows} of "
            f"{last.total}"
        )
    return folder


def _inode(path: Path) -> tuple[int, int] | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino
