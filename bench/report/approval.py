"""Approval of a run's report by a second person: `approval.json`, which the seal of the run does not cover."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from bench.errors import StoreError
from bench.figures.languages import tr
from bench.store.kept_json import TEXT, named, object_of, one_of, read_kept

APPROVAL, SCHEMA = "approval.json", "itb-approval/1"
_FORM = object_of(
    {
        "schema": one_of(SCHEMA), "report": TEXT, "run": TEXT, "by": TEXT, "at": TEXT, "comment": TEXT, "head": TEXT,
        "replaces": TEXT, "calibrations": named(TEXT), "laboratory": named(TEXT), "fields": named(TEXT),
        "signature": named(TEXT),
    },
    ("schema", "report", "run", "by", "at", "head", "calibrations", "laboratory", "fields"),
)  # fmt: skip


def approval_of(run: Path) -> Mapping[str, Any] | None:
    """Return the approval of a run's report, or None. Raises StoreError if it is damaged or of another run."""
    path = run / APPROVAL
    if not path.is_file():
        return None
    found: Mapping[str, Any] = read_kept(path, _FORM)
    if found["run"] != run.name:
        raise StoreError(f"{path}: approves the run {found['run']}")
    return found


def certificate(approval: Mapping[str, Any], recorded: Mapping[str, str]) -> Iterator[tuple[str, str]]:
    """Yield the entries of a certificate in the language of the report; empty ones are left out.

    `recorded` are the `order`, the dates (`calibrated`) and the conditions (`ambient`) that the run itself has.
    """
    laboratory, fields = approval["laboratory"], approval["fields"]
    place = fields.get("place") or laboratory.get("place") or tr("at the address of the laboratory")
    environment = [recorded["ambient"], fields.get("environment", "")]
    entries = {
        "Report number": approval["report"],
        "Run": approval["run"],
        "Replaces": approval.get("replaces", ""),
        "Laboratory": laboratory.get("name", ""),
        "Address": laboratory.get("address", ""),
        "Accreditation": laboratory.get("accreditation", ""),
        "Customer": fields.get("customer", ""),
        "Address of the customer": fields.get("customer_address", ""),
        "Order": recorded["order"],
        "Model of the units": fields.get("model", ""),
        "Condition of the units": fields.get("condition", ""),
        "Received": fields.get("received", ""),
        "Calibrated": recorded["calibrated"],
        "Place of calibration": place,
        "Environment": tr("; ").join(filter(None, environment)) or laboratory.get("environment", ""),
        "Traceability": laboratory.get("traceability", ""),
        "Remarks": fields.get("remarks", ""),
        "Electronic signature": _signature(approval.get("signature", {})),
    }
    for name, text in entries.items():
        if text:
            yield tr(name), text
    yield tr("Scope"), tr("This report relates only to the items calibrated.")


def _signature(signature: Mapping[str, str]) -> str:
    """Sentence about the signature in the PDF; empty without one."""
    if not signature:
        return ""
    return tr(
        "This PDF is signed with the certificate of {subject} (SHA-256 {fingerprint}). It is the approved report only "
        "if a reader of PDF files finds the signature valid and the file unchanged since.", **signature,
    )  # fmt: skip
