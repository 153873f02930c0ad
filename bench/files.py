"""Files that are complete or absent after a crash or power cut, with durable directory entries."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bench.errors import InputError, StoreError

DRAFT = ".draft"


def mark_of(path: Path) -> tuple[int, int] | None:
    """Return time of change in ns and size of a file, which a change of it changes; None if it is not there."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size


def content_hash(data: bytes) -> str:
    """Return the SHA-256 of a content, with the prefix `sha256:`."""
    return f"sha256:{hashlib.sha256(data).hexdigest()}"


def expect_private(path: Path, what: str, others: int = 0o077, *, is_own: bool = False) -> None:
    """Raise InputError unless a file with a secret is there and is not open to others; `is_own`: and is of this user.

    `what` names it in the message; `others` are the permissions that nobody else may have, 0 where it holds no secret.
    """
    try:
        found = path.stat()
    except OSError as problem:
        raise InputError(f"{what}: {path} cannot be read ({problem.strerror})") from None
    if not stat.S_ISREG(found.st_mode):
        raise InputError(f"{what}: {path} is no file")
    if found.st_mode & others:
        raise InputError(f"{what}: {path} can be read by others; chmod 600 {path}; make a new secret if they may have")
    if is_own and found.st_uid != os.geteuid():
        raise InputError(f"{what}: {path} belongs to another user, who can read it; chown it to yourself")


def write_atomically(path: Path, data: bytes) -> None:
    """Replace a file atomically and durably. Raises StoreError."""
    try:
        with _replacing(path) as draft:
            draft.write_bytes(data)
    except OSError as problem:
        raise StoreError(f"{path}: cannot be written ({problem})") from problem


def write_both(first: Path, first_data: bytes, second: Path, second_data: bytes) -> None:
    """Replace two files, `first` before `second`; neither if the disk has no space for both. Raises StoreError."""
    try:
        with _replacing(second) as draft:
            draft.write_bytes(second_data)
            write_atomically(first, first_data)
    except OSError as problem:
        raise StoreError(f"{second}: cannot be written ({problem})") from problem


def append_line(path: Path, text: str, mode: int | None = None, permissions: int = 0o600) -> None:
    """Append a line durably, on a new line if a power cut has truncated the last one. Raises OSError.

    A new file gets the `permissions`, less the umask. With a `mode`, for files that other users may write, links and
    devices are refused and the mode is set whatever the umask.
    """
    shared = 0 if mode is None else os.O_NOFOLLOW | os.O_NONBLOCK
    lines = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC | shared, permissions)
    try:
        found = os.fstat(lines)
        if mode is not None:
            if not stat.S_ISREG(found.st_mode):
                raise OSError(f"{path} is not a regular file")
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


def is_locked(path: Path) -> bool:
    """Return True if another process holds the lock, flock(2), of a file or folder; False if it cannot be opened.

    The shared lock of the test does not block others. Raises OSError where the file system has no locks.
    """
    try:
        lock = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    else:
        return False
    finally:
        os.close(lock)


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Yield a draft file that replaces `path` if the block ends without an error.

    Missing folders are created. Raises InputError if the file cannot be written.
    """
    try:
        make_folder(path.parent)
        with _replacing(path) as draft:
            yield draft
    except OSError as problem:
        raise InputError(f"{path}: cannot be written ({problem})") from problem


@contextmanager
def written_new(path: Path) -> Iterator[Path]:
    """Yield a draft file that becomes `path` if the block ends without an error; FileExistsError if `path` exists.

    Missing folders are created. Raises OSError if the file cannot be written.
    """
    make_folder(path.parent)
    with _draft_of(path) as draft:
        yield draft
        _sync(draft)
        try:
            os.link(draft, path)  # unlike a rename, a link never replaces a file
        except FileExistsError:
            raise
        except OSError:  # a file system without links
            if path.exists():
                raise FileExistsError(path) from None
            draft.rename(path)
    sync_folder(path.parent)


@contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Yield a draft folder that becomes `path` if the block ends without an error. Raises OSError.

    Raises FileExistsError if `path` exists. Missing parent folders are created.
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
    """Create a folder and its parents, with durable directory entries. Raises OSError."""
    missing = []
    while not path.is_dir():
        missing.append(path)
        path = path.parent
    for folder in reversed(missing):
        folder.mkdir(exist_ok=True)
        sync_folder(folder.parent)


def sync_folder(path: Path) -> None:
    """Make the entries of a folder durable. Raises OSError."""
    folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


@contextmanager
def _replacing(path: Path) -> Iterator[Path]:
    target = Path(os.path.realpath(path))  # a symbolic link keeps leading to the file
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
    """Yield an unused name beside `path`; remove the file at the end."""
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
