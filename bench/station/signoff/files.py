"""Files of an approval: written beside their places, put in place when the approval counts, removed if it does not."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from bench.config.laboratory import CertificateFields, LaboratoryFile, mark_of
from bench.errors import InputError, StoreError
from bench.files import content_hash, sync_folder, write_atomically
from bench.optional import imported
from bench.report.approval import APPROVAL, SCHEMA
from bench.report.revision import issued_name, replacing, writing
from bench.station.signoff.decisions import Pending, Signed, State
from bench.station.signoff.key import KeyFiles
from bench.store.runs import json_text
from bench.store.seal import file_hash, read_seal
from bench.store.verify import examine

if TYPE_CHECKING:
    from bench.station.signoff.signature import Signer

STAGED, CHAIN = ".staged", "chain"


class Issue(NamedTuple):
    """What a certificate states beside the run itself, its form and language, and the key that signs it.

    With `dcc` a Digital Calibration Certificate in that version of the schema is issued with the report, for a run that
    can have one.
    """

    laboratory: LaboratoryFile | None = None
    fields: CertificateFields = CertificateFields()
    form: str = "pdf"
    language: str = "en"
    key: KeyFiles | None = None
    dcc: str = ""


def usable_key(key: KeyFiles) -> None:
    """Raise InputError if a key cannot sign now. For a worker process, since it imports much."""
    _signer(key)


def write_staged(run: Path, signed: Signed, issue: Issue) -> dict[str, str]:
    """Write report and approval of a run beside their places; return the hashes of what it covers.

    For a worker process. Raises InputError if the record is damaged or the report cannot be signed, and StoreError.
    """
    with writing(run):
        if damage := examine(run).damage:
            raise InputError(f"{run.name}: is DAMAGED and cannot be approved: {'; '.join(damage[:3])}")
        remove_staged(run)
        head, calibrations = read_seal(run).head, _calibrations(run)
        content = _approval(run, signed, issue, head, calibrations)
        report = _report(run, signed, issue, content)
        files = {issued_name(signed.report, issue.form): report}
        if issue.dcc and (certificate := _certificate(run, issue, content, report)):
            files[issued_name(signed.report, "xml")] = certificate
        files[APPROVAL] = json_text(content).encode()
        for each, data in files.items():
            write_atomically(_staged(run, each), data)
    return {**{each: content_hash(data) for each, data in files.items()}, **calibrations, CHAIN: head}


def settle(run: Path, pending: Pending) -> None:
    """Make the files of a run what a decision says: put in place, removed, or no longer marked as approved.

    It can be repeated after it was interrupted at any instant. Raises StoreError.
    """
    try:
        with writing(run):
            if pending.state is State.DROPPED:
                remove_staged(run)
            elif pending.signed.decision == "rejected":
                (run / APPROVAL).unlink(missing_ok=True)
            else:
                _put_in_place(run, pending.signed)
            sync_folder(run)
    except OSError as problem:
        raise StoreError(f"{run}: the files of its approval cannot be written ({problem})") from problem


def remove_staged(run: Path) -> None:
    """Remove the files of an approval that never counted. Raises OSError."""
    for each in (*run.glob(f"report.*{STAGED}"), _staged(run, APPROVAL)):
        each.unlink(missing_ok=True)


def _put_in_place(run: Path, signed: Signed) -> None:
    """The report first: a run with an approval has its report."""
    for name in sorted(_written(signed), key=lambda each: each == APPROVAL):
        staged, path = _staged(run, name), run / name
        found = staged if staged.exists() else path
        if not found.is_file() or content_hash(content := found.read_bytes()) != signed.binds[name]:
            continue  # the page of the run compares hashes, and says to issue the report again
        if name == APPROVAL:
            _move(staged, path)
        else:
            with replacing(run, name, content):
                _move(staged, path)


def _move(staged: Path, path: Path) -> None:
    if staged.exists():
        staged.replace(path)
        sync_folder(path.parent)


def _written(signed: Signed) -> Iterator[str]:
    """Names of the files that an approval has written: its report and `approval.json`."""
    for name in signed.binds:
        if name == APPROVAL or name.startswith("report."):
            yield name


def _staged(run: Path, name: str) -> Path:
    return run / f"{name}{STAGED}"


def _report(run: Path, signed: Signed, issue: Issue, content: dict[str, Any]) -> bytes:
    """Return the report; as PDF, signed if there is a key, whose certificate is added to the content."""
    signer = _signer(issue.key) if issue.key is not None and issue.form == "pdf" else None
    if signer is not None:
        content["signature"] = {"subject": signer.subject, "fingerprint": signer.fingerprint}
    from bench.reduce.stored_run import open_run  # import what only the worker process needs
    from bench.report.write import report_to_issue

    with open_run(run) as stored:
        report = report_to_issue(stored, issue.form, issue.language, content)
    return signer.signed(report, by=signed.by, report=signed.report) if signer is not None else report


def _certificate(run: Path, issue: Issue, content: dict[str, Any], report: bytes) -> bytes:
    """Return the Digital Calibration Certificate with the report inside, signed if there is a key; empty for none."""
    imported("signxml", "dcc", what="certificate")
    from bench.certificates.signature import Key
    from bench.figures.languages import language
    from bench.reduce.stored_run import open_run
    from bench.report.dcc.write import certificate_of, why_none
    from bench.station.signoff.loaded_key import loaded_key

    key = Key(*loaded_key(issue.key)) if issue.key is not None else None
    with open_run(run) as stored, language(issue.language):
        return b"" if why_none(stored, content) else certificate_of(stored, key, content, report, issue.dcc)


def _signer(key: KeyFiles) -> Signer:
    imported("pyhanko", "sign", what="signature")
    from bench.station.signoff.signature import Signer

    return Signer(key)


def _approval(run: Path, signed: Signed, issue: Issue, head: str, calibrations: dict[str, str]) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "report": signed.report,
        "run": run.name,
        "by": signed.by,
        "at": signed.at.isoformat(timespec="seconds"),
        "comment": signed.comment,
        "replaces": signed.replaces,
        "head": head,
        "calibrations": calibrations,
        "laboratory": _stated(issue.laboratory),
        "fields": {name: str(value) for name, value in issue.fields.model_dump().items() if value},
    }


def _calibrations(run: Path) -> dict[str, str]:
    return {path.name: file_hash(path) for path in sorted(run.glob("calibration_*.json"))}


def _stated(laboratory: LaboratoryFile | None) -> dict[str, str]:
    if laboratory is None:
        return {}
    accreditation = laboratory.accreditation
    stated = {
        "name": laboratory.name,
        "address": laboratory.address,
        "country": laboratory.country,
        "email": laboratory.email or "",
        "place": laboratory.place,
        "environment": laboratory.environment,
        "traceability": laboratory.traceability,
        "accreditation": f"{accreditation.body}, {accreditation.number}" if accreditation is not None else "",
        "mark": mark_of(laboratory),
    }
    return {name: text for name, text in stated.items() if text}
