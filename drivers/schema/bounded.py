"""Reading of external files, only if they are regular files of an expected size."""

from __future__ import annotations

import os
import stat
from pathlib import Path


class UnfitFileError(ValueError):
    """A file that is not read, with the reason but without its name; `size_bytes` if it is too large, else 0."""

    def __init__(self, problem: str, size_bytes: int = 0) -> None:
        super().__init__(problem)
        self.size_bytes = size_bytes


def read_bounded(path: Path, limit_bytes: int) -> bytes:
    """Read a regular file; UnfitFileError before reading if it is none, or larger than `limit_bytes`."""
    try:
        with open(path, "rb", opener=_not_waiting) as file:
            _expect_bounded(os.fstat(file.fileno()), limit_bytes)
            data = file.read(limit_bytes + 1)
    except (OSError, ValueError) as problem:
        raise _unfit(problem) from None
    if len(data) > limit_bytes:  # the file has grown meanwhile
        raise UnfitFileError("grows while it is read", len(data))
    return data


def expect_bounded(path: Path, limit_bytes: int) -> None:
    """Raise UnfitFileError unless there is a regular file of at most `limit_bytes`; for other readers."""
    try:
        _expect_bounded(path.stat(), limit_bytes)
    except (OSError, ValueError) as problem:
        raise _unfit(problem) from None


def _not_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NONBLOCK)  # waiting for the writer of a pipe


def _expect_bounded(found: os.stat_result, limit_bytes: int) -> None:
    if stat.S_ISDIR(found.st_mode):
        raise UnfitFileError("is a folder")
    if not stat.S_ISREG(found.st_mode):
        raise UnfitFileError("is not a regular file")
    if found.st_size > limit_bytes:
        problem = f"has {found.st_size} bytes, at most {limit_bytes} are read; is it the right file?"
        raise UnfitFileError(problem, found.st_size)


def _unfit(problem: Exception) -> UnfitFileError:
    if isinstance(problem, UnfitFileError):
        return problem
    if isinstance(problem, FileNotFoundError):
        return UnfitFileError("there is no such file")
    return UnfitFileError("is a folder" if isinstance(problem, IsADirectoryError) else f"cannot be read ({problem})")
