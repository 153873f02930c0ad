"""Records of runs that are killed, cut off from their disk, edited, or refused by it."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from bench.report.revision import examined
from bench.store.runs import list_runs
from campaigns.trials import record
from tests.support.runs import ROOT

WRITING = ("write", "pwrite64", "fdatasync", "fsync", "rename", "ftruncate", "unlink", "mkdir")
STORAGE = ("pwrite64", "fdatasync", "fsync", "rename", "ftruncate")
ERRORS = ("ENOSPC", "EIO")
ENDS_WITHIN_S = 120.0
REASONS = ("cannot be", "cannot write", "cannot read", "Input/output error", "No space left")


def killed(number: int) -> str:
    """At a moment between the start and some time beyond the end."""
    with tempfile.TemporaryDirectory() as folder:
        return "; ".join(record.killed_once(Path(folder), _moment(9, number)))


def power_cut(number: int) -> str:
    """The same, and the disk loses all that it had not yet written."""
    with tempfile.TemporaryDirectory() as folder:
        image, disk = record.ext4(Path(folder))
        return "; ".join(record.cut_once(image, disk, _moment(10, number)))


def altered(number: int) -> str:
    """One of a run that has ended, or of an interrupted one."""
    with tempfile.TemporaryDirectory() as folder:
        what, answer = record.altered_once(Path(folder), _originals()[number % 2], number)
    return "" if answer in record.ANSWERS else f"{what}: {answer}"


def killed_at_a_call(number: int) -> str:
    """At the n-th system call of a kind in any of its threads; beyond the last one it comes to its end."""
    kind, which = WRITING[number % len(WRITING)], 1 + number // len(WRITING)
    with tempfile.TemporaryDirectory() as folder:
        _, wrong = _traced(Path(folder), f"{kind}:signal=SIGKILL:when={which}")
    return f"{kind} {which}: {wrong}" if wrong else ""


def storage_fails(number: int) -> str:
    """Let the n-th storage operation of a kind fail, once or from then on: the bench must be safe, and the reason
    reported."""
    draw = np.random.default_rng([12, number])
    kind, error = STORAGE[number % len(STORAGE)], ERRORS[int(draw.integers(len(ERRORS)))]
    which, for_good = 1 + int(draw.integers(40)), bool(draw.integers(2))
    what = f"{kind}:error={error}:when={which}{'+' * for_good}"
    with tempfile.TemporaryDirectory() as folder:
        ended, wrong = _traced(Path(folder), what)
    if not ended:
        return f"{what}: it did not come to its end"
    if ended["unsafe"]:
        wrong = f"{wrong} not safe: {ended['unsafe']}"
    if ended["how"] != "completed" and not any(word in text for word in REASONS for text in ended["problems"]):
        wrong = f"{wrong} {ended['how']} without a reason: {ended['problems']}"
    return f"{what}: {wrong}" if wrong else ""


def _traced(folder: Path, inject: str) -> tuple[dict[str, Any], str]:
    """Exit of a run with manipulated system calls, and problems of its record."""
    command = ["strace", "-f", "-qq", "-o", "/dev/null", "-e", f"trace={inject.partition(':')[0]}", "-e"]
    command += [f"inject={inject}", sys.executable, "-m", "campaigns.reliability.workload", str(folder)]
    done = subprocess.run(
        command, capture_output=True, text=True, cwd=ROOT, check=False, timeout=ENDS_WITHIN_S, stdin=subprocess.DEVNULL
    )
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    ended = lines.pop() if lines and isinstance(lines[-1], dict) else {}
    acknowledged = lines[-1] if lines else 0
    wrong = [done.stderr[-400:]] if "Traceback" in done.stderr else []
    records = [examined(run.path) for run in list_runs(folder)]
    if acknowledged > (there := sum(found.rows for found in records)):
        wrong.append(f"{acknowledged} rows were acknowledged, {there} are there")
    wrong += [each for found in records if found.rows and (not ended or not ended["problems"]) for each in found.damage]
    return ended, "; ".join(wrong)


def _moment(line: int, number: int) -> record.Moment:
    return record.Moment.drawn(np.random.default_rng([line, number]), number, _whole_s())


@cache
def _whole_s() -> float:
    with tempfile.TemporaryDirectory() as folder:
        return record.whole_s(Path(folder))


@cache
def _originals() -> tuple[Path, Path]:
    return record.originals(Path(tempfile.mkdtemp(prefix="itb-originals-")))
