"""Devices that cannot be made safe or reached: named in every place, while all others are safe by their own word."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from campaigns.trials.rows import Row
from campaigns.trials.signals import Trial, row_of, sample
from tests.support.energised import ENERGISED, SAFE, Process, Wires, wires
from tests.support.runs import LARGE, ROOT
from tests.support.served import free_port

USED = ("chamber", "counter", "supply", "source")
SERIALS = {"supply": "SIM-PSU-01", "source": "SIM-6220-01"}
BEYOND_RESERVE_BYTES = (4_096, 60_000, 200_000, 400_000)


def trials(scale: float) -> Iterator[Row]:
    """A silent supply on a full disk; instruments that are missing, exchanged, or not used."""
    wrong = [found for size in sample(list(BEYOND_RESERVE_BYTES), scale) if (found := _full_disk(size))]
    yield Row(
        "not safe, disk full", len(sample(list(BEYOND_RESERVE_BYTES), scale)),
        "; ".join(wrong) or "exit code 6, named on the terminal, in the manifest and beside the runs", not wrong,
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder, wires(Path(folder)) as bench:
        missing: list[tuple[str, Trial]] = [(role, partial(_missing, role)) for role in USED]
        exchanged: list[tuple[str, Trial]] = [(role, partial(_exchanged, role)) for role in SERIALS]
        named = "named, nothing sent to it, all others made safe"
        yield row_of("an instrument is missing", sample(missing, scale), bench, named)
        yield row_of("an instrument is exchanged", sample(exchanged, scale), bench, named)
        yield row_of("one that is not used is missing", [("head", _not_used)], bench, "named, and the run passes")


def _full_disk(beyond_reserve_bytes: int) -> str:
    """Problem in the record of a run with a full disk, whose supply does not answer from the teardown on."""
    limit = 4 * 2**20 + beyond_reserve_bytes
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scenario = folder / "silent.yaml"
        scenario.write_text(
            "schema: itb-scenario/1\ntitle: S\nfaults: [{after: teardown/set, device: supply, fault: silent}]\n",
            "utf-8",
        )
        settings = [word for setting in LARGE for word in ("--set", setting)]
        done = subprocess.run(
            [sys.executable, "-m", "bench", "run", "tumble_static", "--bench", "simulated", "--runs", folder / "runs",
             "--scenario", scenario, *settings],
            capture_output=True, text=True, cwd=ROOT, check=False, env={**os.environ, "XDG_STATE_HOME": str(folder)},
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
        )  # fmt: skip
        manifest = json.loads(next((folder / "runs").glob("*/manifest.json")).read_text("utf-8"))
        records = list((folder / "inertial-test-bench" / "unsafe").glob("*.json"))
        told = {
            "exit code": done.returncode == 6,
            "disk": "the run store cannot write" in done.stderr,
            "terminal": "supply COULD NOT BE MADE SAFE" in done.stderr,
            "manifest": list(manifest["unsafe"]) == ["supply"],
            "serials": all(each["serial"] for each in manifest["instruments"].values()),
            "record": [list(json.loads(path.read_text("utf-8"))["unsafe"]) for path in records] == [["supply"]],
        }
    wrong = [what for what, is_right in told.items() if not is_right]
    return f"{beyond_reserve_bytes} bytes: {', '.join(wrong)}; {done.stderr[-300:]}" if wrong else ""


def _missing(role: str, bench: Wires, folder: Path) -> str:
    """Nobody is at the address of an instrument: what is left as it was is this instrument alone."""
    return _not_opened(role, bench, folder, bench.edited(folder, role, _elsewhere))


def _exchanged(role: str, bench: Wires, folder: Path) -> str:
    return _not_opened(role, bench, folder, bench.edited(folder, role, lambda line: line.replace(SERIALS[role], "77")))


def _not_opened(role: str, bench: Wires, folder: Path, edited: Path) -> str:
    run = Process(edited, folder)
    code, told, manifest = run.code(), run.told.read_text("utf-8"), run.manifest()
    found = (code, list(manifest["not_reached"]), f"NOT REACHED, so nothing was sent: {role}" in told)
    if found != (3, [role], True):
        return f"{found}; {told[-300:]}"
    expected = SAFE | {role: ENERGISED[role]} if role in ENERGISED else SAFE
    state = bench.state()
    bench.make_safe(role)
    return "" if state == expected else f"left at {state}"


def _not_used(bench: Wires, folder: Path) -> str:
    run = Process(bench.edited(folder, "head", _elsewhere), folder, "--set", "time=1 s")
    found = run.code(), list(run.manifest()["not_reached"])
    return "" if found == (0, ["head"]) else f"{found}; {run.told.read_text('utf-8')[-300:]}"


def _elsewhere(line: str) -> str:
    """The line of a connection to where nobody is."""
    if "connection:" not in line:
        return line
    return line.replace("/itb/", "/nobody/") if "/itb/" in line else f"    connection: tcp://127.0.0.1:{free_port()}"
