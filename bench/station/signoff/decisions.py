"""Decisions about sealed runs: rows that are never changed. An approval takes a number, which is used once.

A decision goes through the states of `State`, each durable: a station that dies leaves either no approval, or one whose
files are put in place afterwards. Its number is used up in any case.
"""

from __future__ import annotations

import secrets
import sqlite3
from collections.abc import Collection, Mapping
from datetime import datetime
from enum import IntEnum
from typing import Literal, NamedTuple

from pydantic import BaseModel, ConfigDict, Field

from bench.clock import wall_utc
from bench.config.laboratory import LaboratoryFile
from bench.errors import InputError
from bench.station.storage.database import Database
from bench.store.latch import latch
from bench.store.runs import RunSummary

Decision = Literal["approved", "rejected"]
LETTERS, ENDING = "23456789ABCDEFGHJKMNPQRSTUVWXYZ", 5  # none that looks like another
_TABLE = """
CREATE TABLE IF NOT EXISTS decision(number INTEGER PRIMARY KEY, run TEXT NOT NULL, decision TEXT NOT NULL,
  report TEXT NOT NULL, data TEXT NOT NULL, complete INTEGER NOT NULL)
"""


class State(IntEnum):
    """State of a decision, as stored.

    An approval has BEGUN when it has its number, and is DECIDED when it has the hashes of its files, which wait beside
    their places until they are IN_PLACE. One that is given up is DROPPED, and VOID when its files are removed.
    """

    BEGUN = 0
    IN_PLACE = 1
    DECIDED = 2
    DROPPED = 3
    VOID = 4


class Signed(BaseModel):
    """Decision of a person about a run. `binds` are the hashes of what an approval covers, by name."""

    model_config = ConfigDict(frozen=True)

    run: str
    decision: Decision
    by: str
    at: datetime
    comment: str
    report: str = Field("", description="number of the report; empty for a rejection")
    replaces: str = Field("", description="number of the report that this one replaces")
    binds: Mapping[str, str] = Field({}, description="SHA-256 of report and calibration files, and head of the chain")


class Pending(NamedTuple):
    """Decision whose files are not yet as they shall be."""

    number: int
    state: State
    signed: Signed


class SignOff:
    """Decisions of a station. `prefix` begins the numbers of its reports."""

    def __init__(self, database: Database, prefix: str, laboratory: LaboratoryFile | None) -> None:
        self._database, self._prefix, self.laboratory = database, prefix, laboratory
        with database.transaction() as tables:
            tables.execute(_TABLE)
            # Nobody was answered that these are approved.
            tables.execute("UPDATE decision SET complete = ? WHERE complete = ?", (State.DROPPED, State.BEGUN))

    def of_run(self, run: str) -> list[Signed]:
        """Return the decisions about a run, oldest first."""
        return [
            each.signed for each in self._rows("run = ? AND complete IN (?, ?)", run, State.IN_PLACE, State.DECIDED)
        ]

    def approval(self, run: str) -> Signed | None:
        """Return the approval of a run; None if there is none, or if a rejection followed."""
        found = self.of_run(run)
        return found[-1] if found and found[-1].decision == "approved" else None

    def pending(self) -> list[Pending]:
        """Return the decisions whose files are to be put in place or removed."""
        return self._rows("complete IN (?, ?)", State.DECIDED, State.DROPPED)

    def expect_allowed(self, run: RunSummary, by: str, others: Collection[str], replaces: str = "") -> None:
        """Raise InputError unless a person may decide about a run; `others` are its operator and its submitter."""
        if by.casefold() in {other.casefold() for other in others if other}:
            raise InputError(f"{by} submitted or operated this run; a second person decides about it")
        if not run.has_outcome:
            raise InputError(f"{run.id}: only a sealed run is signed off; this one is {run.state}")
        if (latched := latch(run)) is not None:
            raise InputError(f"{run.id}: is latched: {latched.why}. Acknowledge it first")
        self._expect_free(run.id)
        self._expect_not_approved(run.id, replaces)

    def _expect_not_approved(self, run: str, replaces: str) -> None:
        approved = self.approval(run)
        if approved is not None and approved.report != replaces:
            raise InputError(f"{run}: is approved as {approved.report}; a re-issue names it as the one it replaces")
        if approved is None and replaces:
            raise InputError(f"{run}: has no approved report {replaces} to replace")

    def is_writing(self, run: str) -> bool:
        """Return True while an approval of a run is written, or the files of a decision are not in place."""
        return bool(self._rows("run = ? AND complete IN (?, ?)", run, State.BEGUN, State.DECIDED))

    def _expect_free(self, run: str) -> None:
        if self.is_writing(run):
            raise InputError(f"{run}: the files of another decision are being written; look again in a minute")

    def reject(self, run: RunSummary, by: str, comment: str) -> Pending:
        """Record a rejection, which takes an approval back. Raises InputError while one is written, and StoreError."""
        signed = Signed(run=run.id, decision="rejected", by=by, at=wall_utc(), comment=comment)
        with self._database.transaction() as tables:
            self._expect_free(run.id)
            return Pending(_insert(tables, signed, State.DECIDED), State.DECIDED, signed)

    def begin(self, run: RunSummary, by: str, comment: str, replaces: str = "") -> Pending:
        """Take the next number for the approval of a run, durably.

        Its random ending makes it unique also among stations with one prefix, such as a restored or copied one.
        """
        with self._database.transaction() as tables:
            self._expect_free(run.id)
            self._expect_not_approved(run.id, replaces)
            number = tables.execute("SELECT COALESCE(MAX(number), 0) + 1 FROM decision").fetchone()[0]
            now, ending = wall_utc(), "".join(secrets.choice(LETTERS) for _ in range(ENDING))
            signed = Signed(
                run=run.id, decision="approved", by=by, at=now, comment=comment, replaces=replaces,
                report=f"{self._prefix}-{now:%Y}-{number:05d}-{ending}",
            )  # fmt: skip
            return Pending(_insert(tables, signed, State.BEGUN), State.BEGUN, signed)

    def decide(self, begun: Pending, binds: Mapping[str, str]) -> Pending:
        """Approve with the hashes of what the approval covers: from now on it counts. Raises StoreError."""
        signed = begun.signed.model_copy(update={"binds": dict(binds)})
        with self._database.transaction() as tables:
            row = (signed.model_dump_json(), State.DECIDED, begun.number)
            tables.execute("UPDATE decision SET data = ?, complete = ? WHERE number = ?", row)
        return Pending(begun.number, State.DECIDED, signed)

    def drop(self, begun: Pending) -> None:
        """Give up an approval that is not decided; its number stays used. Raises StoreError."""
        self._set(begun, State.DROPPED)

    def done(self, pending: Pending) -> None:
        """Note that the files of a decision are as they shall be. Raises StoreError."""
        self._set(pending, State.IN_PLACE if pending.state is State.DECIDED else State.VOID)

    def _set(self, pending: Pending, state: State) -> None:
        with self._database.transaction() as tables:
            tables.execute("UPDATE decision SET complete = ? WHERE number = ?", (state, pending.number))

    def _rows(self, condition: str, *values: object) -> list[Pending]:
        query = f"SELECT number, complete, data FROM decision WHERE {condition} ORDER BY number"  # noqa: S608  ours
        return [
            Pending(row["number"], State(row["complete"]), Signed.model_validate_json(row["data"]))
            for row in self._database.rows(query, *values)
        ]


def _insert(tables: sqlite3.Connection, signed: Signed, state: State) -> int:
    row = (signed.run, signed.decision, signed.report, signed.model_dump_json(), state)
    statement = "INSERT INTO decision(run, decision, report, data, complete) VALUES (?, ?, ?, ?, ?)"
    return int(tables.execute(statement, row).lastrowid or 0)
