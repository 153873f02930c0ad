"""Released versions of sequences and bench files, with all files that they name."""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterator, Mapping
from datetime import datetime
from typing import Literal

from pydantic import BaseModel, ConfigDict

from bench.app.inputs import digest_of
from bench.clock import wall_utc
from bench.errors import InputError
from bench.station.storage.database import Database

Kind = Literal["sequence", "bench"]
_TABLE = """
CREATE TABLE IF NOT EXISTS release(number INTEGER PRIMARY KEY, kind TEXT NOT NULL, name TEXT NOT NULL,
  digest TEXT NOT NULL, texts TEXT NOT NULL, by TEXT NOT NULL, at TEXT NOT NULL, comment TEXT NOT NULL)
"""
_COLUMNS = "kind, name, digest, by, at, comment"
_INSERT = f"INSERT INTO release({_COLUMNS}, texts) VALUES (?, ?, ?, ?, ?, ?, ?)"  # noqa: S608  our own names
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


class Releases:
    """Releases of a station; none is ever changed. Raises StoreError."""

    def __init__(self, database: Database) -> None:
        self._database = database
        with database.transaction() as tables:
            tables.execute(_TABLE)

    def all(self) -> list[Release]:
        """Return all releases, newest first."""
        rows = self._database.rows(
            "SELECT number, kind, name, digest, by, at, comment FROM release ORDER BY number DESC"
        )
        return [Release.model_validate(dict(row)) for row in rows]

    def release(self, sequence: str, bench: str, inputs: Mapping[str, str], by: str, comment: str) -> list[Release]:
        """Release the files of a checked submission; a file whose newest release is identical gets no second one."""
        with self._database.transaction() as tables:
            for kind, name, texts in _parts(sequence, bench, inputs):
                if self._newest(kind, name) != texts:
                    row = (kind, name, digest_of(texts), json.dumps(texts), by, wall_utc().isoformat(), comment)
                    statement = (
                        "INSERT INTO release(kind, name, digest, texts, by, at, comment) VALUES (?, ?, ?, ?, ?, ?, ?)"
                    )
                    tables.execute(statement, row)
        return [each for each in self.all() if each.name in (sequence, bench)]

    def difference(self, sequence: str, bench: str, inputs: Mapping[str, str]) -> list[str]:
        """Return the lines that differ from the newest releases, as `diff -u` writes them; [] if none do."""
        return [
            line
            for kind, name, texts in _parts(sequence, bench, inputs)
            for line in _difference(f"{kind} {name}", self._newest(kind, name), texts)
        ]

    def expect_released(self, sequence: str, bench: str, inputs: Mapping[str, str]) -> None:
        """Raise InputError, with the first lines that differ, unless the files are the newest released ones."""
        for kind, name, texts in _parts(sequence, bench, inputs):
            newest = self._newest(kind, name)
            if newest is None:
                raise InputError(f"the {kind} '{name}' is not released; an engineer releases it")
            if lines := list(_difference(f"{kind} {name}", newest, texts)):
                shown = "; ".join(line for line in lines if line[:1] in "+-" and line[:3] not in ("+++", "---"))
                raise InputError(f"the {kind} '{name}' differs from its released version: {shown[:300]}")

    def _newest(self, kind: Kind, name: str) -> Mapping[str, str] | None:
        query = "SELECT texts FROM release WHERE kind = ? AND name = ? ORDER BY number DESC LIMIT 1"
        rows = self._database.rows(query, kind, name)
        return dict(json.loads(rows[0]["texts"])) if rows else None


def _parts(sequence: str, bench: str, inputs: Mapping[str, str]) -> Iterator[tuple[Kind, str, dict[str, str]]]:
    """Yield the files of the sequence, and those of the bench."""
    own = {name: text for name, text in inputs.items() if name.startswith(_OF_A_SEQUENCE)}
    others = {each: inputs[each] for each in inputs.keys() - own.keys() if not each.startswith(_OF_ONE_RUN)}
    yield "sequence", sequence, own
    yield "bench", bench, others


def _difference(title: str, old: Mapping[str, str] | None, new: Mapping[str, str]) -> Iterator[str]:
    for name in sorted({*(old or {}), *new}):
        before, after = (old or {}).get(name, ""), new.get(name, "")
        lines = before.splitlines(), after.splitlines()
        yield from difflib.unified_diff(*lines, f"{title}: {name}, released", f"{title}: {name}, now", lineterm="", n=1)
