"""Benches at which a person works: no run begins there, and what makes them safe only switches off and stops."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from bench.errors import InputError, StoreError
from bench.files import append_line, write_whole
from bench.store.kept_json import TEXT, an_object, named, one_of, read_kept
from bench.store.runs import json_text
from bench.store.signed import check_signed
from bench.store.user_state import state_folder

SCHEMA = "itb-lockout/1"
FOLDER, LOG = "lockouts", "lockouts.jsonl"
_FIELDS = {"bench": TEXT, "since": TEXT, "by": TEXT, "reason": TEXT, "connections": named(TEXT)}
_FORM = an_object({"schema": one_of(SCHEMA), **_FIELDS}, required=("schema", *_FIELDS))


class Lockout(NamedTuple):
    """A bench at which somebody works: the path of its file, and the addresses of its instruments by role."""

    bench: str
    since: str
    by: str
    reason: str
    connections: Mapping[str, str]

    @property
    def in_words(self) -> str:
        """Who has locked it out, and why."""
        return f"locked out by {self.by} since {self.since}: {self.reason}"


def lock_out(bench: Path, at: datetime, by: str, reason: str, connections: Mapping[str, str]) -> Lockout:
    """Record a lockout durably, in place of an earlier one of the same bench. Raises InputError, StoreError."""
    check_signed(by, reason)
    found = Lockout(str(bench.resolve()), at.isoformat(timespec="seconds"), by, reason, connections)
    write_whole(_path(bench), json_text({"schema": SCHEMA, **found._asdict()}).encode())
    _log("set", at, found.bench, by, reason)
    return found


def lift(bench: Path, at: datetime, by: str, reason: str) -> None:
    """Take the lockout off a bench. Raises InputError where there is none, StoreError."""
    check_signed(by, reason)
    path = _path(bench)
    if not path.exists():
        raise InputError(f"{bench}: is not locked out")
    _log("lifted", at, str(bench.resolve()), by, reason)
    try:
        path.unlink()
    except OSError as problem:
        raise StoreError(f"{path}: cannot be removed ({problem})") from problem


def lockouts() -> Iterator[Lockout]:
    """All of them. Raises StoreError for one that cannot be read."""
    for path in sorted(_folder().glob("*.json")):
        content = read_kept(path, _FORM)
        yield Lockout(**{name: content[name] for name in _FIELDS})


def locked_out(connections: Collection[str]) -> str:
    """Why instruments at these addresses may only be switched off and stopped; "" where they are not locked out.

    Records that cannot be read lock out every bench.
    """
    try:
        return next((each.in_words for each in lockouts() if set(each.connections.values()) & set(connections)), "")
    except StoreError as problem:
        return f"whether it is locked out is not known ({problem})"


def _path(bench: Path) -> Path:
    resolved = bench.resolve()
    return _folder() / f"{resolved.stem}.{hashlib.sha256(str(resolved).encode()).hexdigest()[:8]}.json"


def _folder() -> Path:
    try:
        folder = state_folder() / FOLDER
        folder.mkdir(exist_ok=True)
    except OSError as problem:
        raise StoreError(f"the records of lockouts cannot be used ({problem})") from problem
    return folder


def _log(what: str, at: datetime, bench: str, by: str, reason: str) -> None:
    line = {"at": at.isoformat(timespec="seconds"), "what": what, "bench": bench, "by": by, "reason": reason}
    try:
        append_line(state_folder() / LOG, json.dumps(line, ensure_ascii=False))
    except OSError as problem:
        raise StoreError(f"the lockout cannot be recorded ({problem})") from problem
