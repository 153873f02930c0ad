"""Benches that may be energised: a file for each run with real connections, until its instruments are known to be safe.

A run that is killed leaves its file; whoever makes the instruments safe takes them out of it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from bench.errors import StoreError
from bench.files import append_line, write_whole
from bench.store.kept_json import TEXT, an_object, named, one_of, read_kept
from bench.store.runs import json_text
from bench.store.user_state import state_folder

SCHEMA = "itb-energised/1"
FOLDER = "energised"
MADE_SAFE = "made_safe.jsonl"
_FIELDS = {"run": TEXT, "bench": TEXT, "since": TEXT, "connections": named(TEXT)}
_FORM = an_object({"schema": one_of(SCHEMA), **_FIELDS}, required=("schema", *_FIELDS))


class Energised(NamedTuple):
    """Instruments that a run may have left on: the paths of run and bench file, and addresses by role."""

    run: str
    bench: str
    since: str
    connections: Mapping[str, str]


def note_energised(run: Path, bench: Path, at: datetime, connections: Mapping[str, str]) -> None:
    """Record, durably, that a run may energise instruments from now on. Raises StoreError."""
    found = Energised(str(run.absolute()), str(bench.absolute()), at.isoformat(timespec="seconds"), connections)
    _write(_folder() / f"{run.name}.{hashlib.sha256(found.run.encode()).hexdigest()[:8]}.json", found)


def energised(unreadable: Callable[[StoreError], object]) -> Iterator[Energised]:
    """The instruments that may be on, oldest run first; a file that cannot be read is passed to `unreadable`.

    Raises StoreError when the folder cannot be read.
    """
    yield from (found for _, found in sorted(_entries(unreadable), key=lambda entry: entry[1].since))


def note_safe(connections: Collection[str]) -> None:
    """Take instruments at these addresses out of all files; a run without any left has none. Raises StoreError."""
    for path, found in list(_entries(lambda _problem: None)):
        left = {role: address for role, address in found.connections.items() if address not in connections}
        if not left:
            _remove(path)
        elif len(left) < len(found.connections):
            _write(path, found._replace(connections=left))


def record_made_safe(bench: Path, at: datetime, lanes: Sequence[Mapping[str, object]]) -> None:
    """Append how each instrument of a bench was made safe by hand, durably. Raises StoreError."""
    line = {"bench": str(bench.absolute()), "at": at.isoformat(timespec="seconds"), "lanes": list(lanes)}
    try:
        append_line(state_folder() / MADE_SAFE, json.dumps(line, ensure_ascii=False))
    except OSError as problem:
        raise StoreError(f"how the bench was made safe cannot be recorded ({problem})") from problem


def _entries(unreadable: Callable[[StoreError], object]) -> Iterator[tuple[Path, Energised]]:
    for path in sorted(_folder().glob("*.json")):
        try:
            content = read_kept(path, _FORM)
        except StoreError as problem:
            if path.exists():  # else made safe meanwhile
                unreadable(problem)
        else:
            yield path, Energised(**{name: content[name] for name in _FIELDS})


def _folder() -> Path:
    try:
        folder = state_folder() / FOLDER
        folder.mkdir(exist_ok=True)
    except OSError as problem:
        raise StoreError(f"the register of energised benches cannot be used ({problem})") from problem
    return folder


def _write(path: Path, found: Energised) -> None:
    write_whole(path, json_text({"schema": SCHEMA, **found._asdict()}).encode())


def _remove(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError as problem:
        raise StoreError(f"{path}: cannot be removed ({problem})") from problem
