"""Rows of a run for the tables of an archive, from its manifest, results and approval."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import date, datetime
from pathlib import Path
from typing import Any, NamedTuple

from bench.archive.columns import PARTITION, SORTED_BY, schema
from bench.archive.libraries import arrow
from bench.report.approval import approval_of
from bench.station.runs.findings import RESULTS, FindingView, read_findings
from bench.station.units.history import Identities, shared_errors, without_place

Row = dict[str, Any]


class Claim(NamedTuple):
    """Claim on the number of a version: the digest of its files, when it was made, by which program and computer."""

    digest: str
    published: str
    program: str
    station: str


class Publication(NamedTuple):
    """Version of a run in an archive: `uuid` is that of the run, `files` are its objects by the names of the files."""

    uuid: str
    number: int
    folder: str
    files: Mapping[str, Any]
    claim: Claim


class Reduced(NamedTuple):
    """Results of another reduction than that at the end of a run, and the program that made them."""

    file: Path
    verdict: str
    by: str


def rows_of(
    run: Path, manifest: Mapping[str, Any], publication: Publication, reduced: Reduced | None = None
) -> dict[str, Any]:
    """Return an Arrow table for each table of an archive, with the results of the run or those of `reduced`.

    Raises StoreError.
    """
    started = datetime.fromisoformat(manifest["started"])
    keys = {
        "uuid": publication.uuid, "version": publication.number, "run": manifest["run"], "started": started,
        PARTITION: started.year,
    }  # fmt: skip
    approval = approval_of(run)
    file = reduced.file if reduced else run / RESULTS
    results, places = read_findings(file) if file.exists() else ([], {})
    found = {
        "findings": list(_findings(results, places, manifest)),
        "budgets": list(_budgets(results)),
        "instruments": list(_instruments(manifest)),
        "certificates": [_certificate(approval, manifest)] if approval is not None else [],
        "runs": [_run(manifest, approval, publication, reduced)],
    }
    return {name: as_table(name, [keys | row for row in rows]) for name, rows in found.items()}


def as_table(name: str, rows: list[Row]) -> Any:
    """Return rows as an Arrow table with the columns of a table of the archive, sorted."""
    found = arrow().Table.from_pylist(rows, schema=schema(name))
    return found.sort_by([(column, "ascending") for column in SORTED_BY[name]])


def _run(
    manifest: Mapping[str, Any], approval: Mapping[str, Any] | None, publication: Publication, reduced: Reduced | None
) -> Row:
    ended = manifest.get("ended")
    return {
        "ended": datetime.fromisoformat(ended) if ended else None,
        "published": datetime.fromisoformat(publication.claim.published), "publication": publication.claim.digest,
        "folder": publication.folder, "program": publication.claim.program, "station": publication.claim.station,
        **{name: manifest.get(name) for name in ("sequence", "title", "bench", "preset", "seed", "operator", "state")},
        "verdict": reduced.verdict if reduced else manifest.get("verdict"),
        "parameters": _json(manifest.get("parameters", {})),
        "simulated": bool(manifest.get("simulated")), "work_order": manifest.get("order"),
        "procedure": manifest.get("procedure"), "units": _units(manifest),
        "report": approval["report"] if approval else None,
        "approved": datetime.fromisoformat(approval["at"]) if approval else None,
        "approved_by": approval["by"] if approval else None,
        "bench_s": manifest.get("bench_s"), "bytes": sum(each["bytes"] for each in publication.files.values()),
        "files": _json(publication.files), "manifest": _json(manifest),
        "reduced_by": reduced.by if reduced else None,
    }  # fmt: skip


def _units(manifest: Mapping[str, Any]) -> str:
    return ", ".join(unit["uut"] for unit in manifest["units"])


def _findings(results: Sequence[FindingView], places: Iterable[str], manifest: Mapping[str, Any]) -> Iterator[Row]:
    identities = Identities(manifest)
    for each in results:
        shared = {_short(name): u for name, u in shared_errors(identities, each)}
        yield {
            "uut": each.uut, "sequence": manifest["sequence"], "simulated": bool(manifest.get("simulated")),
            "id": each.id, "result": without_place(each.id, places), "quantity": each.quantity, "name": each.name,
            "conditions": _json(each.at), "temperature_c": _temperature(each), "value": each.value, "unit": each.unit,
            "u": each.u, "expanded": each.expanded, "low": each.low, "high": each.high, "u_max": each.u_max,
            "monthly_drift": each.monthly_drift, "verdict": each.verdict, "marginal": each.marginal,
            "flags": _json(each.flags), "shared": _json(shared),
        }  # fmt: skip


def _short(error: str) -> str:
    """Return an error as its source and a digest of its identity, which is long."""
    source, _, identity = error.partition(" of ")
    return f"{source} of {hashlib.sha256(identity.encode()).hexdigest()[:16]}"


def _temperature(finding: FindingView) -> float | None:
    found = finding.at.get("temperature_c", finding.at.get("temperature_set_c"))
    return float(found) if isinstance(found, int | float) else None


def _budgets(results: Sequence[FindingView]) -> Iterator[Row]:
    for each in results:
        for line in each.budget:
            yield {
                "uut": each.uut, "id": each.id, "quantity": each.quantity, "unit": each.unit, "source": line.source,
                "type": line.type, "u": line.u, "shared": line.shared,
            }  # fmt: skip


def _instruments(manifest: Mapping[str, Any]) -> Iterator[Row]:
    for role, each in manifest["instruments"].items():
        certificate = each.get("calibration") or {}
        yield {
            "role": role,
            **{name: each.get(name) for name in ("driver", "maker", "model", "serial", "firmware", "serial_verified")},
            "simulated": bool(each.get("simulated")), "certificate": certificate.get("certificate"),
            "laboratory": certificate.get("laboratory"), "calibrated": _day(certificate.get("date")),
            "due": _day(certificate.get("due")),
        }  # fmt: skip


def _certificate(approval: Mapping[str, Any], manifest: Mapping[str, Any]) -> Row:
    return {
        "report": approval["report"], "replaces": approval.get("replaces") or None,
        "approved": datetime.fromisoformat(approval["at"]), "approved_by": approval["by"],
        "units": _units(manifest), "laboratory": approval["laboratory"].get("name"),
        "customer": approval["fields"].get("customer"), "comment": approval.get("comment"),
        "signed_by": approval.get("signature", {}).get("subject"), "calibrations": _json(approval["calibrations"]),
    }  # fmt: skip


def _day(text: object) -> date | None:
    return date.fromisoformat(str(text)) if text else None


def _json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, sort_keys=True, default=dict)
