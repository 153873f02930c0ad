"""Sign-off of runs by a second person, and the fields of certificates."""

from __future__ import annotations

import asyncio

from fastapi import APIRouter, status
from pydantic import BaseModel, Field

from bench.config.laboratory import CertificateFields, missing_fields
from bench.errors import InputError
from bench.station.queue.items import Line, Short
from bench.station.runs.catalogue import ticket_of
from bench.station.signoff import Decision, Signed, write_approved
from bench.store.runs import RunSummary
from bench.web.access import Approver, Reader
from bench.web.services import Services, Station

router = APIRouter(prefix="/api/v1/runs", tags=["sign-off"])


class SignOffView(BaseModel):
    """Decisions about a run, and what its certificate would lack."""

    decisions: list[Signed]
    approved: bool
    missing: list[str]


class NewDecision(BaseModel):
    """Decision about a run; the password of the person is asked for again."""

    decision: Decision
    comment: Line = Field(min_length=1)
    password: str = Field(max_length=1000)
    replaces: Short = Field("", description="number of the report that this one replaces")
    fields: CertificateFields = CertificateFields()


@router.get("/{run}/sign-off")
async def sign_off(station: Station, _: Reader, run: str) -> SignOffView:
    """Return the decisions about a run."""
    found = await asyncio.to_thread(station.daemon.catalogue.run, run)
    sign_off = station.daemon.sign_off
    return SignOffView(
        decisions=sign_off.of_run(run),
        approved=sign_off.approval(run) is not None,
        missing=missing_fields(sign_off.laboratory, CertificateFields(), facts_of(found)),
    )


@router.post("/{run}/sign-off", status_code=status.HTTP_201_CREATED)
async def decide(station: Station, person: Approver, run: str, decision: NewDecision) -> Signed:
    """Approve or reject a sealed run.

    An approval writes the numbered report, and binds it with the calibration files and the head of the chain.
    """
    await station.identity.check_password(person.name, decision.password, person.address)
    found = await asyncio.to_thread(station.daemon.catalogue.run, run)
    sign_off, comment, replaces = station.daemon.sign_off, decision.comment, decision.replaces
    sign_off.expect_allowed(found, person.name, others_of(station, found), replaces)
    if decision.decision == "rejected":
        with station.audit.noted(person, "reject", run, reason=comment):
            return sign_off.reject(found, person.name, comment)
    with station.audit.noted(person, "approve", run, reason=comment, replaces=replaces) as facts:
        number, signed = sign_off.begin(found, person.name, comment, replaces)
        facts["report"] = signed.report
    binds = await station.daemon.workers.call(
        write_approved, found.path, signed, sign_off.laboratory, decision.fields, station.report_form
    )
    return sign_off.complete(number, signed, binds)


def others_of(station: Services, run: RunSummary) -> list[str]:
    """Return who operated and who submitted a run."""
    others = [str(run.manifest.get("operator", ""))]
    if ticket := ticket_of(run.manifest):
        try:
            item = station.daemon.queue.item(ticket)
        except InputError:  # of another station
            return others
        others += [item.submitted_by, item.submission.operator]
    return others


def facts_of(run: RunSummary) -> dict[str, str]:
    """Return what the record of a run has for a certificate."""
    return {"order": str(run.manifest.get("order") or "")}
