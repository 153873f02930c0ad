"""Sign-off on the page of a run: decisions, the form for a second person, what a certificate lacks, released files."""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

from pydantic import ValidationError

from bench.config.laboratory import CertificateFields, missing_fields
from bench.errors import InputError, StoreError
from bench.figures.languages import ENGLISH
from bench.report.approval import approval_of
from bench.report.revision import is_issued
from bench.station.runs.record_files import FileView
from bench.station.signoff.decisions import Signed
from bench.station.signoff.files import CHAIN
from bench.store.runs import RunSummary
from bench.store.seal import file_hash
from bench.web.access import Person, Scope
from bench.web.api.signoff import NewDecision, facts_of, others_of
from bench.web.services import Services

FIELDS = tuple(CertificateFields.model_fields)
DECISION = ("decision", "comment", "password", "replaces", "language")


class Released(NamedTuple):
    """File that an approval covers, with the hash of then. `offered`: the record lists it, so it can be downloaded."""

    name: str
    hash: str
    offered: bool
    unchanged: bool


class Issued(NamedTuple):
    """Decision, and what became of it: the number of the report that replaces it, or True if it was taken back.

    `file` is the report that it issued, if the record lists it.
    """

    signed: Signed
    replaced_by: str
    is_withdrawn: bool
    file: str


class Signing(NamedTuple):
    """Sign-off of a run as one person sees it. `why_not` is the reason if this person may not decide."""

    decisions: Sequence[Issued]
    approved: Signed | None
    is_writing: bool
    lacks: Sequence[str]
    released: Sequence[Released]
    may_decide: bool
    why_not: str
    given: Mapping[str, str]
    problem: str

    @property
    def released_names(self) -> set[str]:
        """Names of the files that are as they were when they were approved."""
        return {each.name for each in self.released if each.unchanged}


def decision_of(form: Mapping[str, str]) -> NewDecision:
    """Return the decision of a form; empty fields are not given. Raises InputError."""
    given = {name: value.replace("\r\n", "\n") for name, value in form.items() if value}
    fields = {name: given[name] for name in FIELDS if name in given}
    decision = {name: given[name] for name in DECISION if name in given}
    try:
        return NewDecision.model_validate({"comment": "", "password": "", **decision, "fields": fields})
    except ValidationError as wrong:
        raise InputError(*(f"{each['loc'][-1]}: {each['msg']}" for each in wrong.errors())) from None


async def signing_of(
    station: Services, person: Person | None, run: RunSummary, files: Sequence[FileView],
    given: Mapping[str, str] | None = None, problem: str = "", language: str = ENGLISH,
) -> Signing:  # fmt: skip
    """Return the sign-off of a run for a person, who reads a language.

    `given` and `problem` are a form that was refused, and why.
    """
    sign_off = station.daemon.sign_off
    approved = sign_off.approval(run.id)
    fields = _approved_fields(run) if approved is not None else CertificateFields()
    why_not = _why_not(station, person, run, approved.report if approved is not None else "")
    facts = await asyncio.to_thread(facts_of, run)
    return Signing(
        decisions=_issued(sign_off.of_run(run.id), {each.name for each in files}),
        approved=approved,
        is_writing=sign_off.is_writing(run.id),
        lacks=missing_fields(sign_off.laboratory, fields, facts),
        released=await asyncio.to_thread(_released, run, approved, files) if approved is not None else [],
        may_decide=why_not == "",
        why_not=why_not or "",
        given={"comment": "", "language": language, **_texts(fields), **(given or {})},
        problem=problem,
    )


def _issued(decisions: Sequence[Signed], listed: Collection[str]) -> list[Issued]:
    """Return decisions with what became of them, oldest first."""
    replaced = {each.replaces: each.report for each in decisions if each.replaces}
    return [
        Issued(
            signed=each,
            replaced_by=replaced.get(each.report, "") if each.report else "",
            is_withdrawn=each.report != "" and any(later.decision == "rejected" for later in decisions[place:]),
            file=next((name for name in each.binds if name in listed and is_issued(name)), ""),
        )
        for place, each in enumerate(decisions, 1)
    ]


def _why_not(station: Services, person: Person | None, run: RunSummary, replaces: str) -> str | None:
    """Return why a person may not decide; "" if allowed, None for a person who decides about no run."""
    if person is None or Scope.APPROVE not in person.scopes:
        return None
    if not person.is_user:
        return "log in with your name and password: a decision asks for the password again"
    try:
        station.daemon.sign_off.expect_allowed(run, person.name, others_of(station, run), replaces)
    except InputError as problem:
        return str(problem)
    return ""


def _approved_fields(run: RunSummary) -> CertificateFields:
    """Return the fields of the certificate; empty ones if the file of the approval is gone or damaged."""
    try:
        found = approval_of(run.path)
        return CertificateFields.model_validate(found["fields"] if found is not None else {})
    except (StoreError, ValidationError):
        return CertificateFields()


def _texts(fields: CertificateFields) -> dict[str, str]:
    return {name: str(value or "") for name, value in fields.model_dump().items()}


def _released(run: RunSummary, approved: Signed, files: Sequence[FileView]) -> list[Released]:
    """Return the files that an approval covers, the report first; each is compared with its hash."""
    listed = {each.name for each in files}
    return [
        Released(name, digest, name in listed, _hash(run, name) == digest)
        for name, digest in approved.binds.items() if name != CHAIN
    ]  # fmt: skip


def _hash(run: RunSummary, name: str) -> str:
    try:
        return file_hash(run.path / name)
    except OSError:
        return ""
