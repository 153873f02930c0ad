"""Files that are whole or not there after a crash or a power cut, with the names that lead to them."""

from __future__ import annotations

import contextlib
import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bench.errors import InputError, StoreError

DRAFT = ".draft"


def write_whole(path: Path, data: bytes) -> None:
    """Replace a file so that after a crash there is the old or the new one, never a part; raises StoreError."""
    try:
        with _replacing(path) as draft:
            draft.write_bytes(data)
    except OSError as problem:
        raise StoreError(f"{path}: cannot be written ({problem})") from problem


def write_both(first: Path, first_data: bytes, second: Path, second_data: bytes) -> None:
    """Replace two files, `first` before `second`; none where one of them has no room on the disk. Raises StoreError."""
    try:
        with _replacing(second) as draft:
            draft.write_bytes(second_data)
            write_whole(first, first_data)
    except OSError as problem:
        raise StoreError(f"{second}: cannot be written ({problem})") from problem


def append_line(path: Path, text: str, mode: int | None = None) -> None:
    """Append a line, durably, after a new line where a power cut has torn the last one. Raises OSError.

    With a `mode`, which others may have to the file, it is no link and no device, and has that mode whatever the umask.
    """
    shared = 0 if mode is None else os.O_NOFOLLOW | os.O_NONBLOCK
    lines = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC | shared, 0o600)
    try:
        found = os.fstat(lines)
        if mode is not None:
            if not stat.S_ISREG(found.st_mode):
                raise OSError(f"{path} is no file")
            if found.st_uid == os.geteuid():
                os.fchmod(lines, mode)
        size = found.st_size
        torn = size > 0 and os.pread(lines, 1, size - 1) != b"\n"
        data = f"{os.linesep * torn}{text}\n".encode()
        if os.write(lines, data) != len(data):
            raise OSError("the disk is full")
        os.fsync(lines)
    finally:
        os.close(lines)


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """A draft to write to, which takes the place of `path` when the block ends without an error.

    Missing folders are made. Raises InputError where the file cannot be written.
    """
    try:
        make_folder(path.parent)
        with _replacing(path) as draft:
            yield draft
    except OSError as problem:
        raise InputError(f"{path}: cannot be written ({problem})") from problem


@contextmanager
def written_new(path: Path) -> Iterator[Path]:
    """A draft to write to, which becomes `path` when the block ends without an error; FileExistsError if that exists.

    Missing folders are made. Raises OSError where the file cannot be written.
    """
    make_folder(path.parent)
    with _draft_of(path) as draft:
        yield draft
        _sync(draft)
        try:
            os.link(draft, path)  # which, unlike a renaming, never replaces a file
        except FileExistsError:
            raise
        except OSError:  # a file system without links
            if path.exists():
                raise FileExistsError(path) from None
            draft.rename(path)
    sync_folder(path.parent)


@contextmanager
def folder_made_whole(path: Path) -> Iterator[Path]:
    """A draft folder to fill, which becomes `path` when the block ends without an error; raises OSError.

    FileExistsError if there is something of that name. Missing folders above it are made.
    """
    make_folder(path.parent)
    if path.exists():
        raise FileExistsError(path)
    draft = path.with_name(path.name + DRAFT)
    try:
        draft.mkdir()
        yield draft
        for made in (draft, *draft.rglob("*")):
            (sync_folder if made.is_dir() else _sync)(made)
        draft.rename(path)
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    sync_folder(path.parent)


def make_folder(path: Path) -> None:
    """Make a folder and those above it; the name of each new one is durable. Raises OSError."""
    missing = []
    while not path.is_dir():
        missing.append(path)
        path = path.parent
    for folder in reversed(missing):
        folder.mkdir(exist_ok=True)
        sync_folder(folder.parent)


def sync_folder(path: Path) -> None:
    """Make the names in a folder durable; raises OSError."""
    folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


@contextmanager
def _replacing(path: Path) -> Iterator[Path]:
    target = Path(os.path.realpath(path))  # a link goes on leading to the file
    if target.exists() and not target.is_file():
        raise OSError("it is not a regular file")
    with _draft_of(target) as draft:
        yield draft
        if target.exists():
            shutil.copymode(target, draft)
        _sync(draft)
        draft.replace(target)
    sync_folder(target.parent)


@contextmanager
def _draft_of(path: Path) -> Iterator[Path]:
    """A name beside `path`; nothing is left there."""
    draft = path.with_name(path.name + DRAFT)
    try:
        yield draft
    finally:
        with contextlib.suppress(OSError):
            draft.unlink(missing_ok=True)


def _sync(path: Path) -> None:
    file = os.open(path, os.O_RDONLY)
    try:
        os.fsync(file)
    finally:
        os.close(file)
