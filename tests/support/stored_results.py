"""Run directories with results of a test's choice, without a database or a seal."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

HEAD = {"maker": "M", "model": "H", "serial": "H-1", "firmware": "", "fingerprint": "", "serial_verified": True}


def line(source: str, u: float, shared: str | None = None, kind: str = "B") -> dict[str, Any]:
    """A line of a budget."""
    return {"source": source, "type": kind, "u": u, "dof": None, "shared": shared}


def finding(
    value: float, *budget: Mapping[str, Any], quantity: str = "K0", id_: str = "tumble/a/K0", uut: str = "QF-1",
    low: float | None = -1.0, high: float | None = 1.0, verdict: str | None = "PASS", unit: str = "g", **more: Any,
) -> dict[str, Any]:  # fmt: skip
    """A finding as `results.json` has it."""
    lines = [*budget] or [line("readings: scatter", 0.01, kind="A")]
    u = sum(each["u"] ** 2 for each in lines) ** 0.5
    limits = {key: side for key, side in (("min", low), ("max", high)) if side is not None}
    return {
        "id": id_, "uut": uut, "quantity": quantity, "name": "bias", "at": {}, "value": value, "unit": unit, "u": u,
        "k": 2.0, "expanded": 2 * u, "limits": limits or None, "verdict": verdict, "marginal": False, "flags": [],
        "budget": lines, **more,
    }  # fmt: skip


def stored(
    runs: Path, at: datetime, findings: Sequence[Mapping[str, Any]] = (), *, uut: str = "QF-1", place: str = "a",
    certificate: str = "C-1", **manifest: Any,
) -> Path:  # fmt: skip
    """Write a completed run with these findings."""
    name = f"{at:%Y%m%dT%H%M%SZ}_tumble"
    folder = runs / name
    folder.mkdir(parents=True)
    verdict = "FAIL" if any(each["verdict"] == "FAIL" for each in findings) else "PASS"
    instruments = {"head": {**HEAD, "calibration": {"certificate": certificate, "due": "2030-01-01"}}}
    content = {
        "run": name, "state": "completed", "verdict": verdict, "title": "Static temperature tumble",
        "sequence": "tumble_static", "bench": "Bench A", "operator": "anna", "started": at.isoformat(),
        "ended": at.isoformat(), "units": [{"place": place, "uut": uut}], "instruments": instruments, "problems": [],
        "parameters": {"gate": "60 s"},
        "hashes": {"bench.yaml": "sha256:b", "sequence.yaml": "sha256:s", "results.json": "sha256:r"},
        "simulated": [], "sealed": False, **manifest,
    }  # fmt: skip
    (folder / "manifest.json").write_text(json.dumps(content))
    results = {
        "verdict": verdict, "units": [{"place": place, "uut": uut, "verdict": verdict, "flags": []}],
        "findings": list(findings), "left_out": [],
    }  # fmt: skip
    (folder / "results.json").write_text(json.dumps(results))
    return folder


def instant(year: int, month: int = 1, day: int = 1) -> datetime:
    """Return an instant in UTC."""
    return datetime(year, month, day, 8, tzinfo=UTC)
