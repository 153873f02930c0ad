"""Records of runs that are killed, cut off from their disk, edited, or refused by it."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from bench.report.verify import examined
from bench.store.runs import list_runs
from tests.support.runs import ROOT
from tests.trials import record

BEYOND_THE_END = 1.1  # of the time that a run takes
WRITING = ("write", "pwrite64", "fdatasync", "fsync", "rename", "ftruncate", "unlink", "mkdir")
STORAGE = ("pwrite64", "fdatasync", "fsync", "rename", "ftruncate")
ERRORS = ("ENOSPC", "EIO")
RUN = ("-m", "bench", "run", "smoke", "--runs")
ENDS_WITHIN_S = 120.0
FIRST_STEP = "steps/"
UNSAFE = ("COULD NOT BE MADE SAFE", "NOT REACHED", "Traceback")
REASONS = ("cannot be", "cannot write", "cannot read", "Input/output error", "No space left")


def killed(number: int) -> str:
    """At a moment between the start and some time beyond the end."""
    with tempfile.TemporaryDirectory() as folder:
        return "; ".join(record.killed_once(Path(folder), _delay_s(9, number)))


def power_cut(number: int) -> str:
    """The same, and the disk loses all that it had not yet written."""
    with tempfile.TemporaryDirectory() as folder:
        image, disk = record.ext4(Path(folder))
        return "; ".join(record.cut_once(image, disk, _delay_s(10, number)))


def altered(number: int) -> str:
    """One of a run that has ended, or of an interrupted one."""
    with tempfile.TemporaryDirectory() as folder:
        what, answer = record.altered_once(Path(folder), _originals()[number % 2], number)
    return "" if answer in record.ANSWERS else f"{what}: {answer}"


def killed_at_a_call(number: int) -> str:
    """At the n-th system call of a kind in any of its threads; beyond the last one it comes to its end."""
    kind, which = WRITING[number % len(WRITING)], 1 + number // len(WRITING)
    with tempfile.TemporaryDirectory() as folder:
        _, said = _traced(Path(folder), f"{kind}:signal=SIGKILL:when={which}")
        for run in list_runs(Path(folder)):
            found = examined(run.path)
            if found.damage and (found.rows or FIRST_STEP in said):  # else nothing was acknowledged yet
                return f"{kind} {which}: {'; '.join(found.damage)}"
    return ""


def storage_fails(number: int) -> str:
    """The n-th storage operation of a kind, once or from then on: the bench is safe, and the reason is told."""
    draw = np.random.default_rng([12, number])
    kind, error = STORAGE[number % len(STORAGE)], ERRORS[int(draw.integers(len(ERRORS)))]
    which, for_good = 1 + int(draw.integers(40)), bool(draw.integers(2))
    what = f"{kind}:error={error}:when={which}{'+' * for_good}"
    with tempfile.TemporaryDirectory() as folder:
        code, said = _traced(Path(folder), what)
        damage = [each for run in list_runs(Path(folder)) for each in examined(run.path).damage]
    if any(words in said for words in UNSAFE):
        return f"{what}: {said[-400:]}"
    if code and not any(words in said for words in REASONS):
        return f"{what}: exit code {code} without a reason: {said[-400:]}"
    return f"{what}: exit code {code}, {damage}" if damage and not code else ""


def _traced(folder: Path, inject: str) -> tuple[int, str]:
    """Exit code of a run while its system calls are tampered with, and what it said."""
    command = ["strace", "-f", "-qq", "-o", "/dev/null", "-e", f"trace={inject.partition(':')[0]}", "-e"]
    command += [f"inject={inject}", sys.executable, *RUN, str(folder)]
    done = subprocess.run(
        command, capture_output=True, text=True, cwd=ROOT, check=False, timeout=ENDS_WITHIN_S, stdin=subprocess.DEVNULL
    )
    return done.returncode, done.stdout + done.stderr


def _delay_s(line: int, number: int) -> float:
    return float(np.random.default_rng([line, number]).uniform(0, BEYOND_THE_END * _whole_s()))


@cache
def _whole_s() -> float:
    with tempfile.TemporaryDirectory() as folder:
        return record.whole_s(Path(folder))


@cache
def _originals() -> tuple[Path, Path]:
    return record.originals(Path(tempfile.mkdtemp(prefix="itb-originals-")))
