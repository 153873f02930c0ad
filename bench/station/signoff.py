"""Sign-off: a second person approves or rejects a sealed run. An approval numbers its report and binds what it covers.

Decisions are rows that are never changed. An approval is complete when its report is on the disk and its row has the
hashes; its number is used up even if the station dies in between.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from bench.clock import wall_utc
from bench.config.laboratory import CertificateFields, LaboratoryFile
from bench.errors import InputError
from bench.files import write_atomically
from bench.station.storage.database import Database
from bench.store.latch import latch
from bench.store.runs import RunSummary, json_text
from bench.store.seal import file_hash, read_seal

Decision = Literal["approved", "rejected"]
_TABLE = """
CREATE TABLE IF NOT EXISTS decision(number INTEGER PRIMARY KEY, run TEXT NOT NULL, decision TEXT NOT NULL,
  report TEXT NOT NULL, data TEXT NOT NULL, complete INTEGER NOT NULL)
"""


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


class SignOff:
    """Decisions of a station. `prefix` makes the numbers of its reports unique among stations."""

    def __init__(self, database: Database, prefix: str, laboratory: LaboratoryFile | None) -> None:
        self._database, self._prefix, self.laboratory = database, prefix, laboratory
        with database.transaction() as tables:
            tables.execute(_TABLE)

    def of_run(self, run: str) -> list[Signed]:
        """Return the decisions about a run, oldest first."""
        rows = self._database.rows("SELECT data FROM decision WHERE run = ? AND complete ORDER BY number", run)
        return [Signed.model_validate_json(row["data"]) for row in rows]

    def approval(self, run: str) -> Signed | None:
        """Return the approval of a run; None if there is none, or if a rejection followed."""
        found = self.of_run(run)
        return found[-1] if found and found[-1].decision == "approved" else None

    def expect_allowed(self, run: RunSummary, by: str, others: Collection[str], replaces: str = "") -> None:
        """Raise InputError unless a person may decide about a run; `others` are its operator and its submitter."""
        if by.casefold() in {other.casefold() for other in others if other}:
            raise InputError(f"{by} submitted or operated this run; a second person decides about it")
        if run.state in ("running", "interrupted", "damaged"):
            raise InputError(f"{run.id}: only a sealed run is signed off; this one is {run.state}")
        if (latched := latch(run)) is not None:
            raise InputError(f"{run.id}: is latched: {latched.why}. Acknowledge it first")
        self._expect_not_approved(run.id, replaces)

    def _expect_not_approved(self, run: str, replaces: str) -> None:
        approved = self.approval(run)
        if approved is not None and approved.report != replaces:
            raise InputError(f"{run}: is approved as {approved.report}; a re-issue names it as the one it replaces")
        if approved is None and replaces:
            raise InputError(f"{run}: has no approved report {replaces} to replace")

    def reject(self, run: RunSummary, by: str, comment: str) -> Signed:
        """Record a rejection. Raises StoreError."""
        signed = Signed(run=run.id, decision="rejected", by=by, at=wall_utc(), comment=comment)
        with self._database.transaction() as tables:
            _insert(tables, signed, complete=True)
        return signed

    def begin(self, run: RunSummary, by: str, comment: str, replaces: str = "") -> tuple[int, Signed]:
        """Take the next number for the approval of a run, durably; return its row and the approval so far."""
        with self._database.transaction() as tables:
            self._expect_not_approved(run.id, replaces)
            number = tables.execute("SELECT COALESCE(MAX(number), 0) + 1 FROM decision").fetchone()[0]
            now = wall_utc()
            report = f"{self._prefix}-{now:%Y}-{number:05d}"
            signed = Signed(
                run=run.id, decision="approved", by=by, at=now, comment=comment, report=report, replaces=replaces
            )
            return _insert(tables, signed, complete=False), signed

    def complete(self, number: int, signed: Signed, binds: Mapping[str, str]) -> Signed:
        """Complete an approval with the hashes of what it covers. Raises StoreError."""
        signed = signed.model_copy(update={"binds": dict(binds)})
        with self._database.transaction() as tables:
            row = (signed.model_dump_json(), number)
            tables.execute("UPDATE decision SET data = ?, complete = 1 WHERE number = ?", row)
        return signed


def _insert(tables: sqlite3.Connection, signed: Signed, *, complete: bool) -> int:
    row = (signed.run, signed.decision, signed.report, signed.model_dump_json(), complete)
    statement = "INSERT INTO decision(run, decision, report, data, complete) VALUES (?, ?, ?, ?, ?)"
    return int(tables.execute(statement, row).lastrowid or 0)


def write_approved(
    run: Path, signed: Signed, laboratory: LaboratoryFile | None, fields: CertificateFields, form: str = "pdf"
) -> dict[str, str]:
    """Write the approval and the approved report of a run; return the hashes of what it covers. For a worker process.

    Raises InputError if the record is damaged, and StoreError.
    """
    from bench.figures.languages import ENGLISH
    from bench.reduce.stored_run import open_run
    from bench.report.approval import APPROVAL, SCHEMA
    from bench.report.revision import examined
    from bench.report.write import write_report

    if damage := examined(run).damage:
        raise InputError(f"{run.name}: is DAMAGED and cannot be approved: {'; '.join(damage[:3])}")
    head = read_seal(run).head
    calibrations = {path.name: file_hash(path) for path in sorted(run.glob("calibration_*.json"))}
    content: dict[str, Any] = {
        "schema": SCHEMA,
        "report": signed.report,
        "run": run.name,
        "by": signed.by,
        "at": signed.at.isoformat(timespec="seconds"),
        "comment": signed.comment,
        "replaces": signed.replaces,
        "head": head,
        "calibrations": calibrations,
        "laboratory": _stated(laboratory),
        "fields": {name: str(value) for name, value in fields.model_dump().items() if value},
    }
    write_atomically(run / APPROVAL, json_text(content).encode())
    with open_run(run) as stored:
        report = write_report(stored, form, ENGLISH)
    return {report.name: file_hash(report), APPROVAL: file_hash(run / APPROVAL), **calibrations, "chain": head}


def _stated(laboratory: LaboratoryFile | None) -> dict[str, str]:
    if laboratory is None:
        return {}
    accreditation = laboratory.accreditation
    stated = {
        "name": laboratory.name,
        "address": laboratory.address,
        "place": laboratory.place,
        "traceability": laboratory.traceability,
        "accreditation": f"{accreditation.body}, {accreditation.number}" if accreditation is not None else "",
    }
    return {name: text for name, text in stated.items() if text}
