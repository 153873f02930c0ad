"""Runs over wires whose process, or guardian, is lost: the bench is asked by a client of its own."""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from campaigns.trials.signals import PHASES
from tests.support.energised import SAFE, Process, Wires, wires
from tests.support.guardians import guardian_of, has_ended, has_made_safe

LEASE_S, KILL_S, LONGEST_LANE_S = 10.0, 3.0, 45.0
PHASES_ENERGISED = ("setup", "steps", "teardown")
WATCHDOG_S, LATE_S = 30.0, 1.0
NEEDS_MEMORY_WITHIN_S = 15.0
ON_V = 14.0
BURN = "while True: pass"
BURNING, SLOWER = 20, 4.0
DIES_AFTER_S = 25.0  # from when its simulator is there
SCENARIO = """\
schema: itb-scenario/1
title: One that no longer answers
faults: [{{at: {at_s} s, device: {role}, fault: silent}}]
"""


def run_lost(number: int) -> str:
    """Killed, stopped, or without memory."""
    return _played(number, ("kill", "freeze", "kill", "memory")[number % 4])


def one_device_dead(number: int) -> str:
    """The others are safe, and that one is named."""
    return _played(number, ("kill", "freeze")[number % 2], dead=("supply", "source", "chamber")[number % 3])


def guardian_lost(number: int) -> str:
    """The run ends, and makes its bench safe itself."""
    return _played(number, "guardian")


def under_load(number: int) -> str:
    """While other programs take all that there is."""
    return _played(number, ("kill", "freeze")[number % 2], burning=BURNING)


def computer_lost(number: int) -> str:
    """The run and its guardian stand still together, as when the computer does: the supply goes off by itself."""
    draw = np.random.default_rng([8, number])
    with tempfile.TemporaryDirectory() as text, wires(Path(text) / "bench") as bench:
        folder = Path(text)
        watched = f"    driver: scpi_supply\n    options: {{watchdog: {WATCHDOG_S:g} s}}"
        edited = bench.edited(folder, "supply", lambda line: watched if "driver:" in line else line)
        arguments, wait = PHASES["steps"]
        run = Process(edited, folder / "run", *arguments)
        wait(run)
        time.sleep(float(draw.uniform(0.0, 2.0)))
        both = run.process.pid, guardian_of(run.process.pid)
        if (voltage_v := bench.supply_v()) < ON_V:
            return f"{voltage_v} V before the computer stood still"
        for process in both:
            os.kill(process, signal.SIGSTOP)
        time.sleep(WATCHDOG_S + LATE_S)
        voltage_v = bench.supply_v()
        for process in both:
            os.kill(process, signal.SIGKILL)
        run.process.wait()
        return "" if voltage_v == 0 else f"{voltage_v} V after {WATCHDOG_S:g} s"


def _played(number: int, way: str, dead: str = "", burning: int = 0) -> str:
    draw = np.random.default_rng([7, number])
    phase = PHASES_ENERGISED[int(draw.integers(len(PHASES_ENERGISED)))]
    with tempfile.TemporaryDirectory() as text, ExitStack() as others:
        folder, options = Path(text), list[str]()
        if dead:
            (folder / "dead.yaml").write_text(SCENARIO.format(at_s=DIES_AFTER_S, role=dead), "utf-8")
            options, phase = ["--scenario", str(folder / "dead.yaml")], "steps"
        bench = others.enter_context(wires(folder / "bench", *options))
        begun_s = time.monotonic()
        arguments, wait = PHASES[phase]
        run = Process(bench.bench, folder / "run", *arguments)
        others.callback(run.process.kill)
        wait(run)
        time.sleep(float(draw.uniform(0.0, 1.0)) if not dead else max(0.0, begun_s + DIES_AFTER_S - time.monotonic()))
        for _ in range(burning):
            others.callback(others.enter_context(subprocess.Popen([sys.executable, "-c", BURN])).kill)
        wrong = _lost(run, way, (SLOWER if burning else 1.0) * (LEASE_S + KILL_S + LONGEST_LANE_S))
        return wrong or "; ".join(_left(bench, run, dead))


def _lost(run: Process, way: str, within_s: float) -> str:
    guardian = guardian_of(run.process.pid)
    victim = guardian if way == "guardian" else run.process.pid
    with contextlib.suppress(ProcessLookupError):
        if way == "memory":
            resource.prlimit(victim, resource.RLIMIT_AS, (1, 1))
            with contextlib.suppress(subprocess.TimeoutExpired):
                run.process.wait(NEEDS_MEMORY_WITHIN_S)  # else it needs none, and the kernel takes it
        os.kill(victim, signal.SIGSTOP if way == "freeze" else signal.SIGKILL)
    end_s = time.monotonic() + within_s
    while run.process.poll() is None or not (has_made_safe(run.path) or has_ended(guardian)):
        if time.monotonic() > end_s:
            return f"{way}: not over within {within_s:g} s; {run.told.read_text('utf-8')[-300:]}"
        time.sleep(0.1)
    return ""


def _left(bench: Wires, run: Process, dead: str) -> Iterator[str]:
    """Devices left on, and silent instruments that are named nowhere."""
    for role, safe in SAFE.items():
        if role != dead and (state := bench.state_of(role)) != safe:
            yield f"{role} left at {state}; {run.told.read_text('utf-8')[-300:]}"
    assert run.path is not None
    if dead and not any(dead in _text(run.path / name) for name in ("incident.jsonl", "manifest.json")):
        yield f"{dead} is nowhere named"


def _text(path: Path) -> str:
    with contextlib.suppress(FileNotFoundError):
        return path.read_text("utf-8")
    return ""
