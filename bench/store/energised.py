"""Register of benches that may be energised: one file per run on real instruments, until these are known to be safe.

A killed run leaves its file; the process that makes the instruments safe removes them from it. Two processes that
change one file at the same time can at worst leave an entry of an instrument that is already safe.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from bench.errors import StoreError
from bench.store.kept_json import TEXT, named, object_of, one_of
from bench.store.kept_records import kept_records
from bench.store.machine_state import (
    append_record,
    folder_to_write,
    printable,
    problem_to_read,
    remove_record,
    write_record,
)
from bench.store.runs import json_text

SCHEMA = "itb-energised/1"
FOLDER = "energised"
_UNUSABLE = "the register of energised benches cannot be used"
MADE_SAFE = "made_safe.jsonl"


def _a_path(value: object) -> str:
    fits = isinstance(value, str) and value.startswith("/") and "\0" not in value
    return "" if fits else " is not the path of a file"


_FIELDS = {"run": _a_path, "bench": _a_path, "since": TEXT, "connections": named(TEXT)}
_FORM = object_of({"schema": one_of(SCHEMA), **_FIELDS}, required=("schema", *_FIELDS))


class Energised(NamedTuple):
    """Instruments that a run may have left on: paths of run and bench file, and addresses by role."""

    run: str
    bench: str
    since: str
    connections: Mapping[str, str]

    @property
    def name(self) -> str:
        """Name of the run, with control characters removed: other users may have written the file."""
        return printable(Path(self.run).name)


def note_energised(run: Path, bench: Path, at: datetime, connections: Mapping[str, str]) -> None:
    """Register, durably, that a run may energise instruments from now on. Raises StoreError."""
    found = Energised(str(run.absolute()), str(bench.absolute()), at.isoformat(timespec="seconds"), connections)
    try:
        folder = folder_to_write(FOLDER)
    except OSError as problem:
        raise StoreError(f"{_UNUSABLE} ({problem})") from problem
    _write(folder / f"{run.name}.{hashlib.sha256(found.run.encode()).hexdigest()[:8]}.json", found)


def energised(unreadable: Callable[[StoreError], object]) -> Iterator[Energised]:
    """Yield the instruments that may be on, oldest run first.

    Errors of single files, and of the folder for all users, are passed to `unreadable`. Raises StoreError if the user's
    own folder cannot be read.
    """
    if problem := problem_to_read():
        unreadable(StoreError(f"what runs of other users have left on is not known: {problem}"))
    yield from (found for _, found in sorted(_entries(unreadable), key=lambda entry: entry[1].since))


def note_safe(connections: Collection[str]) -> None:
    """Remove instruments at these addresses from all files, and the files that are then empty.

    Raises StoreError after the last file if one could not be changed.
    """
    problems: list[StoreError] = []
    for path, found in list(_entries(lambda _problem: None)):
        left = {role: address for role, address in found.connections.items() if address not in connections}
        try:
            if not left:
                remove_record(path)
            elif len(left) < len(found.connections):
                _write(path, found._replace(connections=left))
        except StoreError as problem:
            problems.append(problem)
    if problems:
        raise problems[0]


def record_made_safe(bench: Path, at: datetime, lanes: Sequence[Mapping[str, object]]) -> None:
    """Append the outcome of a manual make-safe for each instrument of a bench, durably. Raises StoreError."""
    line = {"bench": str(bench.absolute()), "at": at.isoformat(timespec="seconds"), "lanes": list(lanes)}
    try:
        append_record(MADE_SAFE, json.dumps(line, ensure_ascii=False))
    except OSError as problem:
        raise StoreError(f"how the bench was made safe cannot be recorded ({problem})") from problem


def _entries(unreadable: Callable[[StoreError], object]) -> Iterator[tuple[Path, Energised]]:
    for path, content in kept_records(FOLDER, _FORM, _UNUSABLE, unreadable):
        yield path, Energised(**{name: content[name] for name in _FIELDS})


def _write(path: Path, found: Energised) -> None:
    write_record(path, json_text({"schema": SCHEMA, **found._asdict()}).encode())
