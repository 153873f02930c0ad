"""Sign-off of runs by a second person, and the fields of certificates."""

from __future__ import annotations

import asyncio
from typing import Literal

from fastapi import APIRouter, status
from pydantic import BaseModel, Field

from bench.config.bench import load_kept_bench
from bench.config.laboratory import CertificateFields, missing_fields
from bench.errors import BenchError, InputError
from bench.figures.languages import tr
from bench.station.queue.items import Line, Short
from bench.station.runs.catalogue import ticket_of
from bench.station.signoff.decisions import Decision, Pending, Signed
from bench.station.signoff.files import Issue, usable_key, write_staged
from bench.store.reader import RunReader
from bench.store.runs import BENCH_COPY, RunSummary
from bench.web.access import Approver, Person, Reader
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
    language: Literal["en", "zh"] = Field("en", description="language of the report")
    fields: CertificateFields = CertificateFields()


@router.get("/{run}/sign-off")
async def sign_off(station: Station, _: Reader, run: str) -> SignOffView:
    """Return the decisions about a run."""
    found = await asyncio.to_thread(station.daemon.catalogue.run, run)
    sign_off = station.daemon.sign_off
    return SignOffView(
        decisions=sign_off.of_run(run),
        approved=sign_off.approval(run) is not None,
        missing=missing_fields(sign_off.laboratory, CertificateFields(), await asyncio.to_thread(facts_of, found)),
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
            rejected = sign_off.reject(found, person.name, comment)
        await station.daemon.placing.settle(rejected)
        return rejected.signed
    return (await _approve(station, person, found, decision)).signed


async def _approve(station: Services, person: Person, run: RunSummary, decision: NewDecision) -> Pending:
    """Approve a run: it counts when its hashes are durable, and is answered when its files are in place."""
    daemon, comment = station.daemon, decision.comment
    key = daemon.settings.signature if station.report_form == "pdf" else None
    if key is not None:
        await daemon.approvals.call(usable_key, key)  # before a number is used up
    with station.audit.noted(person, "approve", run.id, reason=comment, replaces=decision.replaces) as facts:
        begun = daemon.sign_off.begin(run, person.name, comment, decision.replaces)
        facts["report"] = begun.signed.report
    issue = Issue(
        daemon.sign_off.laboratory, decision.fields, station.report_form, decision.language, key, daemon.settings.dcc
    )
    try:
        binds = await daemon.approvals.call(write_staged, run.path, begun.signed, issue)
    except BaseException:
        daemon.sign_off.drop(begun)
        daemon.placing.wake()
        raise
    decided = daemon.sign_off.decide(begun, binds)
    await daemon.placing.settle(decided)
    return decided


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
    """Return what the record of a run has for a certificate: its order and ambient conditions, in words."""
    return {"order": str(run.manifest.get("order") or ""), "ambient": _ambient(run)}


def _ambient(run: RunSummary) -> str:
    from bench.reduce.ambient import ambient_of  # imports much, which a station does not wait for

    try:
        bench = load_kept_bench(run.path / BENCH_COPY)
        if not bench.site.ambient:
            return ""
        with RunReader(run.path) as reader:
            return tr("; ").join(each.in_words for each in ambient_of(reader, bench))
    except BenchError:  # the page of a damaged run says so elsewhere
        return ""
