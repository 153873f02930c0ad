"""Runs that are killed, in virtual time or over wires, and resumed."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from bench.store.verify import examine
from campaigns.trials.resume import RUNS, killed
from tests.support.energised import SAFE, Process, Wires, wires
from tests.support.guardians import guardian_of, has_ended, has_made_safe
from tests.support.killed import ended, journal
from tests.support.runs import ROOT

SOAK_MOVE_ACQUIRE = """\
schema: itb-sequence/1
title: Soak, move, acquire
needs:
  chamber: thermal_chamber
  head: positioner
  output: output
  supply: power_supply
  source: current_source
  unit_temperature: thermometer
setup:
  - {set: supply, voltage: 15 V, current_limit: 120 mA, output: on}
  - {set: source, current: 1 mA, compliance: 10 V, output: on}
  - wait: 10 s
steps:
  - for_each: temperature
    in: [22 °C, 23 °C]
    steps:
      - {ramp: chamber, to: "${temperature}", at: 3 °C/min}
      - {soak: unit_temperature, at_least: 1 min}
      - for_each: position
        in: [0°, 10°, 20°, 10°]
        steps:
          - {move: head, to: "${position}"}
          - {acquire: output, for: 8 s, label: tumble}
teardown:
  - {set: source, output: off}
  - {set: supply, output: off}
"""
LASTS_S = 250.0  # from its first step
ENDS_WITHIN_S = 900.0
SAFE_WITHIN_S = 90.0
ENDINGS = (0, 5, 7)  # nothing is judged; a result from both sides of an interruption is incomplete


def once(number: int) -> str:
    """Killed at any moment."""
    return _played(number, random.Random(f"once {number}"), again=False)


def twice(number: int) -> str:
    """Killed again while the world is rebuilt, or after that."""
    return _played(number, random.Random(f"twice {number}"), again=True)


def over_wires(number: int) -> str:
    """Killed at any moment of its steps, made safe by its guardian, acknowledged, and resumed in another process."""
    draw = random.Random(f"wires {number}")
    before = os.environ.get("XDG_STATE_HOME")
    with tempfile.TemporaryDirectory() as text, wires(Path(text) / "bench") as bench:
        os.environ["XDG_STATE_HOME"] = f"{text}/state"
        try:
            return _killed_over_wires(bench, Path(text), draw.uniform(0.0, LASTS_S))
        finally:
            os.environ.pop("XDG_STATE_HOME")
            if before is not None:
                os.environ["XDG_STATE_HOME"] = before


def _killed_over_wires(bench: Wires, folder: Path, after_s: float) -> str:
    run = Process(bench.bench, folder / "run", text=SOAK_MOVE_ACQUIRE)
    run.until_step("steps/temperature=22/ramp")
    time.sleep(after_s)
    guardian = guardian_of(run.process.pid)
    run.process.kill()
    run.process.wait()
    end_s = time.monotonic() + SAFE_WITHIN_S
    while not (has_made_safe(run.path) or has_ended(guardian)) and time.monotonic() < end_s:
        time.sleep(0.1)
    if (state := bench.state()) != SAFE:
        return f"killed after {after_s:.1f} s: left at {state}; {run.told.read_text('utf-8')[-300:]}"
    path = run.path
    assert path is not None
    for words in (("acknowledge", str(path), "--reason", "a trial"), ("resume", str(path), "--interrupted")):
        done = subprocess.run(
            [sys.executable, "-m", "bench", *words], capture_output=True, text=True, cwd=ROOT, check=False,
            stdin=subprocess.DEVNULL, timeout=ENDS_WITHIN_S,
        )  # fmt: skip
        if done.returncode not in ENDINGS:
            return f"killed after {after_s:.1f} s: {words[0]} ended with {done.returncode}: {done.stderr[-400:]}"
    if (state := bench.state()) != SAFE:
        return f"resumed: left at {state}"
    acquired = {step: count for step, count in ended(journal(path)).items() if step.endswith("acquire")}
    if len(acquired) != 8 or set(acquired.values()) != {1}:
        return f"killed after {after_s:.1f} s: acquisitions missing or repeated: {acquired}"
    return "; ".join(examine(path).damage)


def _played(number: int, draw: random.Random, *, again: bool) -> str:
    sequence, share = list(RUNS)[number % len(RUNS)], draw.random()
    with tempfile.TemporaryDirectory() as folder:
        found = killed(Path(folder), sequence, share, draw.random() if again else None)
    return f"{sequence} at {share:.4f}: {found}" if found else ""
