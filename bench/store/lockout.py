"""Lockouts of benches while a person works there: no run starts, and make-safe only switches off and stops."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Collection, Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import NamedTuple, NoReturn

from bench.errors import InputError, StoreError
from bench.store.kept_json import TEXT, named, object_of, one_of
from bench.store.kept_records import kept_records
from bench.store.machine_state import (
    append_record,
    folder_to_write,
    folders_to_read,
    printable,
    problem_to_read,
    remove_record,
    write_record,
)
from bench.store.runs import json_text
from bench.store.signed import check_signed

SCHEMA = "itb-lockout/1"
FOLDER, LOG = "lockouts", "lockouts.jsonl"
_UNUSABLE = "the records of lockouts cannot be used"
_FIELDS = {"bench": TEXT, "since": TEXT, "by": TEXT, "reason": TEXT, "connections": named(TEXT)}
_FORM = object_of({"schema": one_of(SCHEMA), **_FIELDS}, required=("schema", *_FIELDS))


class Lockout(NamedTuple):
    """Lockout of a bench: path of the bench file, addresses by role, and who locked it out, when and why."""

    bench: str
    since: str
    by: str
    reason: str
    connections: Mapping[str, str]

    @property
    def in_words(self) -> str:
        """Name, time and reason of the lockout as a sentence."""
        return printable(f"locked out by {self.by} since {self.since}: {self.reason}")


def lock_out(bench: Path, at: datetime, by: str, reason: str, connections: Mapping[str, str]) -> Lockout:
    """Record a lockout durably; it replaces an earlier one of the same bench. Raises InputError, StoreError."""
    check_signed(by, reason)
    found = Lockout(str(bench.resolve()), at.isoformat(timespec="seconds"), by, reason, connections)
    try:
        folder = folder_to_write(FOLDER)
    except OSError as problem:
        raise StoreError(f"{_UNUSABLE} ({problem})") from problem
    write_record(folder / _name(bench), json_text({"schema": SCHEMA, **found._asdict()}).encode())
    _log("set", at, found.bench, by, reason)
    return found


def lift(bench: Path, at: datetime, by: str, reason: str) -> None:
    """Lift the lockout of a bench. Raises InputError if there is none, and StoreError."""
    check_signed(by, reason)
    try:
        found = [path for folder in folders_to_read(FOLDER) if os.path.lexists(path := folder / _name(bench))]
    except OSError as problem:
        raise StoreError(f"{_UNUSABLE} ({problem})") from problem
    if not found:
        raise InputError(f"{bench}: is not locked out")
    _log("lifted", at, str(bench.resolve()), by, reason)
    for path in found:
        remove_record(path)


def lockouts() -> Iterator[Lockout]:
    """Yield all lockouts. Raises StoreError if one, or the folder of other users, cannot be read."""
    if unknown := problem_to_read():
        raise StoreError(unknown)
    for _, content in kept_records(FOLDER, _FORM, _UNUSABLE, _refuse):
        yield Lockout(**{name: content[name] for name in _FIELDS})


def locked_out(connections: Collection[str]) -> str:
    """Return the reason why these instruments are locked out, "" if they are not.

    Unreadable records lock out every bench.
    """
    try:
        return next((each.in_words for each in lockouts() if set(each.connections.values()) & set(connections)), "")
    except StoreError as problem:
        return f"whether it is locked out is not known ({problem})"


def _refuse(problem: StoreError) -> NoReturn:
    raise problem


def _name(bench: Path) -> str:
    resolved = bench.resolve()
    return f"{resolved.stem}.{hashlib.sha256(str(resolved).encode()).hexdigest()[:8]}.json"


def _log(what: str, at: datetime, bench: str, by: str, reason: str) -> None:
    line = {"at": at.isoformat(timespec="seconds"), "what": what, "bench": bench, "by": by, "reason": reason}
    try:
        append_record(LOG, json.dumps(line, ensure_ascii=False))
    except OSError as problem:
        raise StoreError(f"the lockout cannot be recorded ({problem})") from problem
