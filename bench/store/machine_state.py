"""Records of what is on, and who works at a bench, that concern all users of this computer.

Where the administrator has made a folder for them (config/services/bench.tmpfiles.conf), of a group and mode 2770, they
are written there by whoever may; else to the folder of the user. Both are read. Members of the group are trusted with
the benches; what stands in the folder is all the same read with care: it may be a link, a folder or nonsense.
"""

from __future__ import annotations

import os
import secrets
import stat
from collections.abc import Iterator
from pathlib import Path

from bench.errors import StoreError
from bench.files import DRAFT, append_line, sync_folder
from bench.store.user_state import state_folder

VARIABLE, STANDARD = "INERTIAL_TEST_BENCH_MACHINE", "/var/lib/inertial-test-bench/machine"
FOLDERS = ("energised", "lockouts", "unsafe")
MODE = 0o660  # for the group of the folder, whatever the umask of the user


def machine_folder() -> Path | None:
    """The folder for all users of this computer; None where nobody has made one."""
    folder = Path(os.environ.get(VARIABLE) or STANDARD)
    try:
        os.lstat(folder)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError:  # it may be there: this user may not look
        return folder
    return folder


def problem_to_write() -> str:
    """Why this user cannot write to the folder of the machine; "" where that works, or there is none."""
    return _problem(os.R_OK | os.W_OK | os.X_OK, "write to")


def problem_to_read() -> str:
    """Why this user cannot read the records of all users; "" where that works, or there are none."""
    return _problem(os.R_OK | os.X_OK, "read")


def folder_to_write(name: str) -> Path:
    """Where records of a kind (one of FOLDERS) are written; made for the user if missing. Raises OSError."""
    machine = machine_folder()
    if machine is not None and not problem_to_write():
        return machine / name
    folder = state_folder() / name
    folder.mkdir(exist_ok=True)
    return folder


def folders_to_read(name: str) -> list[Path]:
    """Where records of a kind are that this user can read: those of all users, then its own. Raises OSError."""
    machine, own = machine_folder(), state_folder() / name
    folders = [machine / name] if machine is not None and not problem_to_read() else []
    return [*folders, *([own] if own.is_dir() and own not in folders else [])]


def records(name: str) -> Iterator[Path]:
    """The files of records of a kind that this user can read. Raises OSError."""
    for folder in folders_to_read(name):
        yield from sorted(path for path in folder.iterdir() if path.suffix == ".json")


def write_record(path: Path, data: bytes) -> None:
    """Put a file in the place of whatever has this name, durably; it follows no link. Raises StoreError."""
    draft = path.with_name(f"{path.name}.{secrets.token_hex(8)}{DRAFT}")  # two users may write at once
    try:
        try:
            file = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
            with os.fdopen(file, "wb") as stream:
                stream.write(data)
                stream.flush()
                os.fchmod(stream.fileno(), MODE)
                os.fsync(stream.fileno())
            draft.replace(path)
        finally:
            draft.unlink(missing_ok=True)
        sync_folder(path.parent)
    except OSError as problem:
        raise StoreError(f"{path}: cannot be written ({problem})") from problem


def append_record(name: str, text: str) -> None:
    """Append a line to a log of the machine, or of the user, durably. Raises OSError."""
    machine = machine_folder()
    if machine is not None and not problem_to_write():
        append_line(machine / name, text, MODE)
    else:
        append_line(state_folder() / name, text)


def remove_record(path: Path) -> None:
    """Raises StoreError."""
    try:
        path.unlink(missing_ok=True)
    except OSError as problem:
        raise StoreError(f"{path}: cannot be removed ({problem})") from problem


def printable(text: str) -> str:
    """Text that anybody may have written, without what a terminal obeys."""
    return "".join(each if each.isprintable() else "\N{REPLACEMENT CHARACTER}" for each in text)


def _problem(access: int, what: str) -> str:
    machine = machine_folder()
    if machine is None:
        return ""
    for folder in (machine, *(machine / name for name in FOLDERS)):
        try:
            found = folder.stat() if folder == machine else os.lstat(folder)  # the group can put links into it
        except FileNotFoundError:
            return f"{folder} is missing: make it with 'systemd-tmpfiles --create', as config/services describes"
        except OSError:
            return _no_right(machine, what)
        if not stat.S_ISDIR(found.st_mode):
            return f"{folder} is no folder"
        if not os.access(folder, access, effective_ids=True):
            return _no_right(machine, what)
    return ""


def _no_right(machine: Path, what: str) -> str:
    return f"this user may not {what} {machine}, where this computer has the records of all users: join its group"
