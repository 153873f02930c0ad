"""Manifest of a run: operator, units, times, instruments, files and program versions."""

from __future__ import annotations

import os
import platform
import re
import uuid
from collections.abc import Mapping
from datetime import datetime
from importlib.metadata import distribution, version
from typing import Any

from bench.config.models import BenchFile
from bench.sequence.language.values import as_written
from bench.sequence.plan.plan import Plan
from drivers.values import Identity

SCHEMA = "itb-manifest/1"
_PROGRAMS = (
    "inertial-test-bench", "numpy", "scipy", "pydantic", "pymodbus", "python-can", "cantools", "pyserial", "matplotlib",
    "jinja2",
)  # fmt: skip


def opening(
    run_id: str, plan: Plan, bench: BenchFile, serials: Mapping[str, str], seed: int, operator: str, started: datetime
) -> dict[str, Any]:
    """Return the manifest at the start of a run."""
    return {
        "schema": SCHEMA,
        "run": run_id,
        "uuid": uuid.uuid4().hex,  # runs of the same second on different computers may have the same name
        "state": "running",
        "verdict": None,
        "title": plan.sequence.title,
        "sequence": plan.name,
        "bench": bench.title,
        "operator": operator,
        "started": started.isoformat(timespec="seconds"),
        "ended": None,
        "wall_s": None,
        "bench_s": None,
        "preset": plan.preset,
        "parameters": {name: as_written(value) for name, value in plan.parameters.items()},
        "seed": seed,
        "simulated": [role for role, entry in bench.devices.items() if entry.connection.simulated],
        "units": [_unit(bench, place, serial) for place, serial in serials.items()],
        "instruments": {},
        "hashes": {},
        "software": {name: version_of(name) for name in _PROGRAMS},
        "host": {"name": platform.node(), "python": platform.python_version(), "system": _system()},
        "process": os.getpid(),
        "problems": [],
    }


def version_of(program: str) -> str:
    """Return the version of an installed distribution, from the line of its metadata."""
    # Python parses the whole file, with the licence and the description, as a mail
    found = re.search(r"^Version: *(\S+)", distribution(program).read_text("METADATA") or "", re.MULTILINE)
    return found[1] if found else version(program)


def _system() -> str:
    """Return kernel, machine and C library; `platform.platform()` starts a program for the name of the processor."""
    return f"{platform.system()}-{platform.release()}-{platform.machine()}-with-{''.join(platform.libc_ver())}"


def _unit(bench: BenchFile, place: str, serial: str) -> dict[str, Any]:
    entry = bench.places[place]
    return {
        "place": place,
        "uut": serial,
        "type": entry.type,
        "channel": ", ".join(entry.measured_by.values()),
        "mount_angle_deg": entry.mount_angle,
        "supply": entry.supply,
    }


def instruments(bench: BenchFile, identities: Mapping[str, Identity]) -> dict[str, Any]:
    """Return identity and calibration of every instrument."""
    return {role: _instrument(bench, role, identities.get(role)) for role in bench.devices}


def _instrument(bench: BenchFile, role: str, identity: Identity | None) -> dict[str, Any]:
    entry = bench.devices[role]
    found = identity or Identity(verified=False)
    calibration = entry.calibration
    return {
        "driver": entry.driver,
        "connection": str(entry.connection),
        "simulated": entry.connection.simulated,
        **facts(found),
        "calibration": calibration.model_dump(mode="json", exclude={"U"}) if calibration is not None else None,
    }


def facts(identity: Identity) -> dict[str, Any]:
    """Return an identity as in the record of a run."""
    return {"serial_verified" if name == "verified" else name: fact for name, fact in identity._asdict().items()}
