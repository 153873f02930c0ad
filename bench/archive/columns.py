"""Columns of the tables of an archive.

Every table has `uuid` and `version` of a publication, and `year`, in which its run started, by which it is partitioned.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from bench.archive.libraries import arrow

KEYS = {"uuid": "string", "version": "int64", "run": "string", "started": "instant"}
RUNS = {
    **KEYS, "ended": "instant", "published": "instant", "publication": "string", "folder": "string",
    "program": "string", "station": "string", "sequence": "string", "title": "string", "bench": "string",
    "preset": "string", "parameters": "json", "seed": "int64", "simulated": "bool", "operator": "string",
    "work_order": "string", "procedure": "string", "state": "string", "verdict": "string", "units": "string",
    "report": "string", "approved": "instant", "approved_by": "string", "bench_s": "double", "bytes": "int64",
    "files": "json", "manifest": "json", "reduced_by": "string",
}  # fmt: skip
FINDINGS = {
    **KEYS, "uut": "string", "sequence": "string", "simulated": "bool", "id": "string", "result": "string",
    "quantity": "string", "name": "string", "conditions": "json", "temperature_c": "double", "value": "double",
    "unit": "string", "u": "double", "expanded": "double", "low": "double", "high": "double", "u_max": "double",
    "monthly_drift": "double", "verdict": "string", "marginal": "bool", "flags": "json", "shared": "json",
}  # fmt: skip
BUDGETS = {
    **KEYS, "uut": "string", "id": "string", "quantity": "string", "unit": "string", "source": "string",
    "type": "string", "u": "double", "shared": "string",
}  # fmt: skip
INSTRUMENTS = {
    **KEYS, "role": "string", "driver": "string", "maker": "string", "model": "string", "serial": "string",
    "firmware": "string", "serial_verified": "bool", "simulated": "bool", "certificate": "string",
    "laboratory": "string", "calibrated": "day", "due": "day",
}  # fmt: skip
CERTIFICATES = {
    **KEYS, "report": "string", "replaces": "string", "approved": "instant", "approved_by": "string",
    "units": "string", "laboratory": "string", "customer": "string", "comment": "string", "signed_by": "string",
    "calibrations": "json",
}  # fmt: skip
TABLES: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {"findings": FINDINGS, "budgets": BUDGETS, "instruments": INSTRUMENTS, "certificates": CERTIFICATES, "runs": RUNS}
)  # the runs come last: their row makes the others visible
SORTED_BY: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "findings": ("uut", "result", "started"),
        "budgets": ("uut", "id", "started"),
        "instruments": ("serial", "started"),
        "certificates": ("report",),
        "runs": ("started",),
    }
)
PARTITION = "year"


def schema(table: str) -> Any:
    """Arrow schema of a table, with the partition column last."""
    pa = arrow()
    kinds = {
        "json": pa.string(), "day": pa.date32(), "instant": pa.timestamp("us", "UTC"), "string": pa.string(),
        "int64": pa.int64(), "double": pa.float64(), "bool": pa.bool_(),
    }  # fmt: skip
    return pa.schema([*((name, kinds[kind]) for name, kind in TABLES[table].items()), (PARTITION, pa.int32())])
