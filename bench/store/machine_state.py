"""Records for all users of this computer: energised instruments and lockouts.

If the administrator has created a shared folder (config/services/bench.tmpfiles.conf; mode 2770, with a group), users
with write permission write there; otherwise records go to the folder of the user. Both are read. Members of the group
are trusted with the benches, but the content is validated all the same: it may be a link, a folder or malformed.
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
MODE = 0o660  # explicit, since the umask of the user would exclude the group


def machine_folder() -> Path | None:
    """Return the folder for all users of this computer, or None if there is none."""
    folder = Path(os.environ.get(VARIABLE) or STANDARD)
    try:
        os.lstat(folder)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError:  # it exists, but this user has no permission
        return folder
    return folder


def problem_to_write() -> str:
    """Return the reason why this user cannot write to the shared folder; "" if writing works or there is none."""
    return _problem(os.R_OK | os.W_OK | os.X_OK, "write to")


def problem_to_read() -> str:
    """Return the reason why this user cannot read the shared folder; "" if reading works or there is none."""
    return _problem(os.R_OK | os.X_OK, "read from")


def folder_to_write(name: str) -> Path:
    """Return the folder to which records of a kind (one of FOLDERS) are written, created if missing. Raises OSError."""
    machine = machine_folder()
    if machine is not None and not problem_to_write():
        return machine / name
    folder = state_folder() / name
    folder.mkdir(exist_ok=True)
    return folder


def folders_to_read(name: str) -> list[Path]:
    """Return the folders with records of a kind: that of all users first, then that of this user. Raises OSError."""
    machine, own = machine_folder(), state_folder() / name
    folders = [machine / name] if machine is not None and not problem_to_read() else []
    return [*folders, *([own] if own.is_dir() and own not in folders else [])]


def records(name: str) -> Iterator[Path]:
    """Yield the files of records of a kind that this user can read. Raises OSError."""
    for folder in folders_to_read(name):
        yield from sorted(path for path in folder.iterdir() if path.suffix == ".json")


def write_record(path: Path, data: bytes) -> None:
    """Write a file atomically and durably in place of an existing one; links are not followed. Raises StoreError."""
    draft = path.with_name(f"{path.name}.{secrets.token_hex(8)}{DRAFT}")  # random: two users may write
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
    """Append a line to a log, of the machine or of the user, durably. Raises OSError."""
    machine = machine_folder()
    if machine is not None and not problem_to_write():
        append_line(machine / name, text, MODE)
    else:
        append_line(state_folder() / name, text)


def remove_record(path: Path) -> None:
    """Delete a record; a missing one is ignored. Raises StoreError."""
    try:
        path.unlink(missing_ok=True)
    except OSError as problem:
        raise StoreError(f"{path}: cannot be removed ({problem})") from problem


def printable(text: str) -> str:
    """Return text from an untrusted source with control characters replaced."""
    return "".join(each if each.isprintable() else "\N{REPLACEMENT CHARACTER}" for each in text)


def _problem(access: int, what: str) -> str:
    machine = machine_folder()
    if machine is None:
        return ""
    for folder in (machine, *(machine / name for name in FOLDERS)):
        try:
            found = folder.stat() if folder == machine else os.lstat(folder)  # the group can place links there
        except FileNotFoundError:
            return f"{folder} is missing: make it with 'systemd-tmpfiles --create', as config/services describes"
        except OSError:
            return _no_right(machine, what)
        if not stat.S_ISDIR(found.st_mode):
            return f"{folder} is not a folder"
        if not os.access(folder, access, effective_ids=True):
            return _no_right(machine, what)
    return ""


def _no_right(machine: Path, what: str) -> str:
    return f"this user may not {what} {machine}, where this computer has the records of all users: join its group"
