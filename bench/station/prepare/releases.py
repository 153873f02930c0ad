"""Released versions of sequences and bench files, with all files that they name."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from datetime import datetime
from sqlite3 import Row
from typing import Literal, NamedTuple

from pydantic import BaseModel, ConfigDict

from bench.app.inputs import digest_of
from bench.clock import wall_utc
from bench.errors import InputError
from bench.station.prepare.differences import difference_of
from bench.station.storage.database import Database

Kind = Literal["sequence", "bench"]
_TABLE = """
CREATE TABLE IF NOT EXISTS release(number INTEGER PRIMARY KEY, kind TEXT NOT NULL, name TEXT NOT NULL,
  digest TEXT NOT NULL, texts TEXT NOT NULL, by TEXT NOT NULL, at TEXT NOT NULL, comment TEXT NOT NULL)
"""
_SELECT = "SELECT number, kind, name, digest, by, at, comment FROM release"
_INSERT = "INSERT INTO release(kind, name, digest, texts, by, at, comment) VALUES (?, ?, ?, ?, ?, ?, ?)"
_OF_A_SEQUENCE = ("sequence.yaml", "called/")
_OF_ONE_RUN = ("released_", "scenario.yaml")


class Release(BaseModel):
    """Released version of a sequence or a bench."""

    model_config = ConfigDict(frozen=True)

    number: int
    kind: Kind
    name: str
    digest: str
    by: str
    at: datetime
    comment: str


class Released(NamedTuple):
    """Release with the texts of its files, by the names of their copies."""

    release: Release
    texts: Mapping[str, str]


class Releases:
    """Releases of a station; none is ever changed. Raises StoreError."""

    def __init__(self, database: Database) -> None:
        self._database = database
        with database.transaction() as tables:
            tables.execute(_TABLE)

    def all(self) -> list[Release]:
        """Return all releases, newest first."""
        return [_release(row) for row in self._database.rows(f"{_SELECT} ORDER BY number DESC")]

    def of(self, kind: Kind, name: str) -> list[Release]:
        """Return the releases of a sequence or a bench, newest first."""
        rows = self._database.rows(f"{_SELECT} WHERE kind = ? AND name = ? ORDER BY number DESC", kind, name)
        return [_release(row) for row in rows]

    def newest(self, kind: Kind, name: str) -> Released | None:
        """Return the newest release of a sequence or a bench; None if it was never released."""
        found = self.of(kind, name)
        return Released(found[0], self.texts_of(found[0].number)) if found else None

    def texts_of(self, number: int) -> Mapping[str, str]:
        """Return the texts of a release. Raises InputError."""
        rows = self._database.rows("SELECT texts FROM release WHERE number = ?", number)
        if not rows:
            raise InputError(f"there is no release {number}")
        return dict(json.loads(rows[0]["texts"]))

    def release_one(self, kind: Kind, name: str, texts: Mapping[str, str], by: str, comment: str) -> Release:
        """Release a sequence or a bench; if its newest release is identical, return that one."""
        newest = self.newest(kind, name)
        if newest is None or newest.texts != texts:
            row = (kind, name, digest_of(texts), json.dumps(dict(texts)), by, wall_utc().isoformat(), comment)
            with self._database.transaction() as tables:
                tables.execute(_INSERT, row)
        return self.of(kind, name)[0]

    def release(self, sequence: str, bench: str, inputs: Mapping[str, str], by: str, comment: str) -> list[Release]:
        """Release the files of a checked submission; a file whose newest release is identical gets no second one."""
        with self._database.transaction():
            for kind, name, texts in _parts(sequence, bench, inputs):
                self.release_one(kind, name, texts, by, comment)
        return [each for each in self.all() if each.name in (sequence, bench)]

    def difference(self, sequence: str, bench: str, inputs: Mapping[str, str]) -> list[str]:
        """Return the lines that differ from the newest releases, as `diff -u` writes them; [] if none do."""
        return [
            line
            for kind, name, texts in _parts(sequence, bench, inputs)
            for line in difference_of(f"{kind} {name}", self._texts(kind, name), texts)
        ]

    def expect_released(self, sequence: str, bench: str, inputs: Mapping[str, str]) -> None:
        """Raise InputError, with the first lines that differ, unless the files are the newest released ones."""
        for kind, name, texts in _parts(sequence, bench, inputs):
            newest = self._texts(kind, name)
            if newest is None:
                raise InputError(f"the {kind} '{name}' is not released; an engineer releases it")
            if lines := list(difference_of(f"{kind} {name}", newest, texts)):
                shown = "; ".join(line for line in lines if line[:1] in "+-" and line[:3] not in ("+++", "---"))
                raise InputError(f"the {kind} '{name}' differs from its released version: {shown[:300]}")

    def _texts(self, kind: Kind, name: str) -> Mapping[str, str] | None:
        newest = self.newest(kind, name)
        return newest.texts if newest is not None else None


def _release(row: Row) -> Release:
    return Release.model_validate(dict(row))


def _parts(sequence: str, bench: str, inputs: Mapping[str, str]) -> Iterator[tuple[Kind, str, dict[str, str]]]:
    """Yield the files of the sequence, and those of the bench."""
    own = {name: text for name, text in inputs.items() if name.startswith(_OF_A_SEQUENCE)}
    others = {each: inputs[each] for each in inputs.keys() - own.keys() if not each.startswith(_OF_ONE_RUN)}
    yield "sequence", sequence, own
    yield "bench", bench, others
