"""Approved runs, and their certificates."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

from bench.certificates.signature import Key
from bench.figures.languages import language
from bench.reduce.stored_run import open_run
from bench.report.approval import APPROVAL, SCHEMA
from bench.report.dcc.versions import DEFAULT
from bench.report.dcc.write import certificate_of
from bench.report.revision import issued_name, replacing
from bench.station.signoff.key import KeyFiles
from bench.station.signoff.loaded_key import loaded_key

NUMBER = "L3-2026-00001-ABCDE"
PDF = b"%PDF-1.7 the approved report"
LABORATORY = {
    "name": "Inertial Laboratory", "address": "1 Bench Street", "country": "DE", "email": "lab@example.org",
    "accreditation": "National Body, 0815", "traceability": "traceable to the SI",
}  # fmt: skip
FIELDS = {
    "customer": "Mole & Sons <b>", "customer_address": "1 Hole", "model": "Maker QF", "condition": "new",
    "received": "2026-11-01", "remarks": "none",
}  # fmt: skip


def approve(run: Path, **instead: Any) -> Path:
    """Approve a run as a station does, without the look at its record; return its directory."""
    content = {
        "schema": SCHEMA, "report": NUMBER, "run": run.name, "by": "boris", "at": "2026-11-21T20:00:00+00:00",
        "comment": "", "head": "", "calibrations": {}, "laboratory": LABORATORY, "fields": FIELDS, **instead,
    }  # fmt: skip
    (run / APPROVAL).write_text(json.dumps(content))
    with replacing(run, issued_name(NUMBER, "pdf"), PDF):
        (run / issued_name(NUMBER, "pdf")).write_bytes(PDF)
    return run


def approved_copy(run: Path, folder: Path, **instead: Any) -> Path:
    """Return the approved copy of a run."""
    return approve(Path(shutil.copytree(run, folder / run.name)), **instead)


def certificate(run: Path, key: KeyFiles | None = None, lang: str = "en", version: str = DEFAULT) -> bytes:
    """Return the certificate of an approved run."""
    with open_run(run) as stored, language(lang):
        return certificate_of(stored, Key(*loaded_key(key)) if key is not None else None, version=version)
