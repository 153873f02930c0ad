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


def certificate(approval: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the entries of a certificate in the language of the report; empty ones are left out."""
    laboratory, fields = approval["laboratory"], approval["fields"]
    entries = {
        "Report number": approval["report"],
        "Replaces": approval.get("replaces", ""),
        "Laboratory": laboratory.get("name", ""),
        "Address": laboratory.get("address", ""),
        "Accreditation": laboratory.get("accreditation", ""),
        "Place": fields.get("place") or laboratory.get("place", ""),
        "Traceability": laboratory.get("traceability", ""),
        "Customer": fields.get("customer", ""),
        "Address of the customer": fields.get("customer_address", ""),
        "Model of the units": fields.get("model", ""),
        "Condition of the units": fields.get("condition", ""),
        "Received": fields.get("received", ""),
        "Environment": fields.get("environment", ""),
        "Remarks": fields.get("remarks", ""),
    }
    for name, text in entries.items():
        if text:
            yield tr(name), text
    yield tr("Scope"), tr("This report relates only to the items calibrated.")
