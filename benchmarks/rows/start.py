"""How soon this program answers: help, a check of a sequence at each change of it, the first move of a run.

Real time from the start of the process, with everything in the cache of the disk. A peer without a command is started
by the import that each of its test scripts begins with; it checks nothing.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from statistics import median

from benchmarks.compared import Row, Side, in_turn
from benchmarks.peers import HERE, python_of, version_of

ROOT = Path(__file__).parents[2]
BENCH = (sys.executable, "-m", "bench")
ROUNDS, ROUNDS_OF_A_WHOLE = 9, 25
HELP_MS, CHECK_MS, FIRST_MOVE_MS = 90, 250, 600
CHECKS = {"tumble_static": "simulated", "imu_start_up": "imu"}  # a common sequence, and the longest of the shipped ones
NONE, STEPS = "none", "each step on the disk"

Sides = Mapping[str, Callable[[], float]]


def measure(whole: bool) -> Iterator[Row]:
    """Rows of help, checks and the first move."""
    rounds = ROUNDS_OF_A_WHOLE if whole else ROUNDS
    openhtf, queueserver, pymeasure = map(python_of, ("openhtf", "queueserver", "pymeasure"))
    htf, queue, measured = (
        f"{shown} {version_of(name, package)}"
        for shown, name, package in (
            ("OpenHTF", "openhtf", "openhtf"),
            ("queueserver", "queueserver", "bluesky-queueserver"),
            ("PyMeasure", "pymeasure", "pymeasure"),
        )
    )
    qserver = partial(_ends_ms, queueserver.parent / "qserver", "--help")
    imports = {
        f"{htf}, import": partial(_ends_ms, openhtf, "-c", "import openhtf"),
        f"{measured}, import": partial(_ends_ms, pymeasure, "-c", "import pymeasure.experiment"),
    }
    help_ = {"": partial(_ends_ms, *BENCH, "--help"), f"{queue}, qserver --help": qserver}
    yield _row("bench --help", HELP_MS, NONE, help_, rounds)
    for sequence, bench in CHECKS.items():
        files = (f"sequences/{sequence}.yaml", "--bench", f"config/{bench}.yaml")
        check = {"": partial(_ends_ms, *BENCH, "check", *files)}
        yield _row(f"bench check {sequence}", CHECK_MS, NONE, check | imports, rounds)
    with tempfile.TemporaryDirectory() as folder:
        files = ("sequences/smoke.yaml", "--bench", "config/simulated.yaml", "--runs", folder)
        firsts = {
            "": partial(_shows_ms, "/move", *BENCH, "run", "--no-report", *files),
            f"{htf}, first phase": partial(_shows_ms, "begins", openhtf, HERE / "openhtf_first.py"),
            f"{measured}, first row": partial(_shows_ms, "begins", pymeasure, HERE / "pymeasure_first.py"),
        }
        yield _row("bench run smoke, to its first move", FIRST_MOVE_MS, STEPS, firsts, rounds)


def _row(work: str, goal_ms: float, durability: str, sides: Sides, rounds: int) -> Row:
    """Row of one work; the side without a name is this program."""
    for side in sides.values():
        side()  # compiles modules, fills the cache of the disk
    before_s = _children_cpu_s()
    sides[""]()
    cpu_ms = (_children_cpu_s() - before_s) * 1e3
    least = {"least": partial(_ends_ms, sys.executable, "-c", "pass")}
    found = in_turn({**sides, **least}, rounds)
    ours, limit_ms = Side("this program", durability, found.pop("")), median(found.pop("least"))
    peers = tuple(Side(name, NONE, values) for name, values in found.items())
    limit = f"python -c pass: {limit_ms:.0f} ms; processor time of this program: {cpu_ms:.0f} ms"
    goal = f"at most {goal_ms:.0f} ms"
    return Row("P6", work, "ms", ours, peers, limit, goal, is_met=ours.value <= goal_ms)


def _children_cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _ends_ms(*command: str | Path) -> float:
    """Time until a command ends; raises CalledProcessError if it fails."""
    began_s = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True, cwd=ROOT)
    return (time.perf_counter() - began_s) * 1e3


def _shows_ms(mark: str, *command: str | Path) -> float:
    """Time until a command writes a line with `mark`; it is killed then."""
    began_s = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT) as process:
        found = any(mark in line for line in process.stdout or ())
        passed_ms = (time.perf_counter() - began_s) * 1e3
        process.kill()
    if not found:
        raise RuntimeError(f"{command[0]} ended without a line with '{mark}'")
    return passed_ms
