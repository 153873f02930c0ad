"""Runs in virtual time on a computer whose clock is set, slewed and stopped, also while they are interrupted."""

from __future__ import annotations

import json
import math
import random
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from datetime import datetime
from functools import lru_cache
from html import unescape
from pathlib import Path

from bench.app.execute import execute
from bench.app.request import RunRequest, prepare
from bench.app.resume import Resumption, prepare_again, read_interrupted
from bench.clock import wall_utc
from bench.runner.quiet import Quiet
from bench.store.reader import Event
from bench.store.verify import examine
from tests.support.killed import KILLED, ended, journal
from tests.support.runs import ROOT
from tests.support.wall_clock import Change, WallClock, epoch_of

HOUR_S, DAY_S = 3600.0, 86400.0
AT_A_LIMIT = ("2026-03-29T01:00:00", "2026-10-25T01:00:00", "2026-12-31T23:00:00", "2027-01-01T00:00:00")
"""Summer time begins and ends, and the year, by the clock of the laboratory and by UTC."""
APART_S = 25.0  # between two changes: the clock is looked at every 10 s
ON_OUTAGE_S = 600.0  # real time for which a killed run lies, before its clock is set
AGREES_S = 0.1
HEAD = """\
schema: itb-sequence/1
title: Clocks
needs: {chamber: thermal_chamber, head: positioner, counter: pulse_counter, supply: power_supply,
        source: current_source, unit_temperature: thermometer}
steps:
  - set: supply
    voltage: 15 V
    current_limit: 120 mA
    output: on
  - ramp: chamber
    to: 26 °C
    at: 3 °C/min
  - soak: unit_temperature
    at_least: 1 min
  - wait_until: unit_temperature
    above: 20 °C
    hold: 20 s
    give_up_after: 1 h
  - measure: unit_temperature
    for: 10 s
    as: t
  - tare: counter.x
    for: 10 s
  - prompt: Is it quiet?
    choices: [done, cannot]
    give_up_after: 1 h
  - note: The case has ${t}.
  - alarm: The door stays closed.
  - for_each: position
    in: [0°, 90°]
    steps:
      - move: head
        to: ${position}
        settle: 5 s
      - acquire: counter
        for: 20 s
        label: a
  - repeat: 2
    steps:
      - wait: 10 s
  - group: part
    steps:
      - wait: 15 s
    teardown:
      - wait: 5 s
  - if: ${t > '10 °C'}
    then:
      - wait: 10 s
    else:
      - wait: 1 s
  - while: ${t > '100 °C'}
    at_most: 2
    steps:
      - wait: 1 s
  - parallel:
      one:
        - wait: 12 s
      two:
        - wait: 8 s
  - call: called.yaml
  - retry: 2
    delay: 10 s
    on: [silent]
    steps:
      - move: head
        to: 0°
teardown:
  - set: supply
    output: off
"""
CALLED = "schema: itb-sequence/1\ntitle: Called\nneeds: {head: positioner}\nsteps:\n  - wait: 7 s\n"
TABLE = """\
schema: itb-sequence/1
title: Clocks of a table
needs: {outer: rate_table, output: output, supply: power_supply}
steps:
  - set: supply
    voltage: 15 V
    current_limit: 2 A
    output: on
  - orient: {x: up, y: east}
    settle: 5 s
  - acquire: output
    for: 30 s
    label: a
  - rotate: outer
    at: 10 °/s
    turns: 2
  - oscillate: outer
    amplitude: 2°
    frequency: 1 Hz
    for: 40 s
  - wait: 20 s
teardown:
  - set: supply
    output: off
"""
PLAYED = {"head": (HEAD, "simulated"), "table": (TABLE, "imu")}


def clock(number: int) -> str:
    """A run of every type of step; each second is killed and resumed, four of five begin where a clock is changed."""
    draw = random.Random(f"clock {number}")
    name = "table" if number % 4 == 3 else "head"
    began = epoch_of(draw.choice(AT_A_LIMIT)) - draw.uniform(0, 300) if number % 5 else draw.uniform(1.6e9, 2.0e9)
    with tempfile.TemporaryDirectory() as folder:
        wrong = list(_played(Path(folder), name, began, draw, kill=number % 2 == 1))
    return "; ".join(wrong[:4])


def _played(folder: Path, name: str, epoch_s: float, draw: random.Random, *, kill: bool) -> Iterator[str]:
    at_s = draw.uniform(0.1, 0.95) * _expected_s(name) if kill else None
    lying = Change(at_s, "set", draw.choice((-DAY_S, -HOUR_S, -300.0, 300.0, HOUR_S, DAY_S))) if at_s else None
    calm = journal(_run(folder / "a", name, epoch_s, (), at_s, None))
    begins_s = [max(entry.at_s, at_s or 0.0) if entry.kind == "run_resumed" else entry.at_s
                for entry in calm if entry.kind in ("run_begins", "run_resumed")]  # fmt: skip
    ends_s = [each for each in (at_s, calm[-1].at_s) if each is not None]
    changes = [each for span in zip(begins_s, ends_s, strict=True) for each in _changes(draw, *span)]
    path = _run(folder / "b", name, epoch_s, changes, at_s, lying)
    entries = journal(path)
    yield from _same(calm, entries)
    yield from _steps_journaled(entries, changes, math.inf if at_s is None else at_s)
    if lying is not None:
        yield from _outage(entries)
    yield from _manifest(path)
    yield from examine(path).damage


def _changes(draw: random.Random, from_s: float, to_s: float) -> list[Change]:
    """A few changes of the clocks while a process runs, apart from each other."""
    kinds = {"set": (-DAY_S, -HOUR_S, HOUR_S, DAY_S, -1.0, 2.0), "slew": (-2e-4, 2e-4, 5e-4), "sleep": (20.0, HOUR_S)}
    found, at_s = [], from_s + draw.uniform(1.0, APART_S)
    while at_s < to_s - 1.0 and len(found) < 5:
        kind = draw.choice(("set", "set", "slew", "sleep"))
        found.append(Change(at_s, kind, draw.choice(kinds[kind])))
        at_s += APART_S + draw.expovariate(1 / 40)
    return found


@lru_cache(maxsize=4)
def _expected_s(name: str) -> float:
    with tempfile.TemporaryDirectory() as folder:
        return prepare(_request(Path(folder), name)).expected.total_s


def _request(folder: Path, name: str) -> RunRequest:
    """A run whose bench is in a zone with daylight saving."""
    text, bench = PLAYED[name]
    path = folder / "s.yaml"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")
        (folder / "called.yaml").write_text(CALLED, "utf-8")
    return RunRequest(str(path), bench=str(ROOT / "config" / f"{bench}.yaml"), runs=folder / "runs")


def _run(
    folder: Path, name: str, epoch_s: float, changes: Sequence[Change], kill_s: float | None, lying: Change | None
) -> Path:
    """The directory of a run that has come to its end, killed and resumed on the way where there is a `kill_s`."""
    request = _request(folder, name)
    if kill_s is None:
        with WallClock(epoch_s, changes).used():
            return execute(prepare(request), Quiet()).path
    wish = {"sequence": request.sequence, "bench": request.bench, "runs": str(request.runs), "at_s": kill_s,
            "epoch_s": epoch_s, "changes": changes}  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-m", "tests.support.wall_clock", json.dumps(wish)],
        capture_output=True, text=True, cwd=ROOT, check=False,
    )  # fmt: skip
    assert done.returncode == KILLED, f"{done.returncode} {done.stderr[-600:]}"
    (path,) = (folder / "runs").iterdir()
    all_changes = [*changes, *([lying] if lying is not None else [])]
    moved = [each for each in all_changes if each.at_s <= kill_s]  # the others come when bench time is there
    with WallClock(epoch_s + ON_OUTAGE_S, all_changes, kill_s).used():
        resumption = read_interrupted(path)
        outage_s = _of_a_real_bench(resumption).outage_s(wall_utc())
        truly_s = ON_OUTAGE_S + kill_s - resumption.last_s
        most_s = truly_s + sum(max(0.0, each.by_s) for each in moved if each.kind in ("set", "sleep")) + 2
        assert 0 <= outage_s <= most_s, f"an outage of {outage_s} s, of really {truly_s} s"
        execute(prepare_again(resumption), Quiet(), None, resumption)
    return path


def _of_a_real_bench(resumption: Resumption) -> Resumption:
    """One whose bench time began by the clock of the computer."""
    first, *others = resumption.entries
    return resumption._replace(
        entries=(first._replace(data={**first.data, "utc": resumption.manifest["started"]}), *others)
    )


def _same(calm: list[Event], entries: list[Event]) -> Iterator[str]:
    """Differences from a run with an unchanged clock: order, durations, and all findings."""
    times = [entry.at_s for entry in entries]
    if times != sorted(times):
        yield "the journal is not in the order of time"
    found = [entry for entry in entries if entry.kind != "clock_step"]
    if _acknowledged_s(found) != _acknowledged_s(calm):  # one had more on the disk when it was killed
        if ended(found).keys() != ended(calm).keys():
            yield "other steps have ended than without"
        return
    if [(each.kind, each.step) for each in found] != [(each.kind, each.step) for each in calm]:
        yield f"other entries than without: {len(found)} and {len(calm)}"
    for before, now in zip(calm, found, strict=False):
        if abs(before.at_s - now.at_s) > AGREES_S:
            yield f"{now.kind} {now.step} at {now.at_s:.3f} s and not at {before.at_s:.3f} s"
            return


def _acknowledged_s(entries: Sequence[Event]) -> list[float]:
    """Bench times up to which the record was on the disk when the run was killed."""
    return [entry.data["interrupted_s"] for entry in entries if entry.kind == "run_resumed"]


def _steps_journaled(entries: Sequence[Event], changes: Sequence[Change], kill_s: float) -> Iterator[str]:
    """Each step of the clock and each sleep while a process ran is in the journal, and nothing else is.

    What the process that was killed had not acknowledged yet may be missing.
    """
    lost = next((entry.data["interrupted_s"] - APART_S for entry in entries if entry.kind == "run_resumed"), math.inf)
    told = [entry for entry in entries if entry.kind == "clock_step"]
    for each in (each for each in changes if each.kind != "slew"):
        found = [entry for entry in told if 0 <= entry.at_s - each.at_s <= APART_S]
        if not found and (each.at_s < lost or each.at_s >= kill_s):
            yield f"{each} is not in the journal"
            continue
        for entry in found:
            told.remove(entry)
            by_s = entry.data["set_by_s" if each.kind == "set" else "slept_s"]
            if abs(by_s - each.by_s) > AGREES_S:
                yield f"{each} was journaled as {entry.data}"
    if told:
        yield f"journaled, and not so: {told}"


def _outage(entries: Sequence[Event]) -> Iterator[str]:
    for entry in entries:
        if entry.kind == "run_resumed" and not 0 <= entry.data["outage_s"] <= DAY_S:
            yield f"an outage of {entry.data['outage_s']} s"


def _manifest(path: Path) -> Iterator[str]:
    """Problems of the times in the manifest and on the first page."""
    manifest = json.loads((path / "manifest.json").read_text("utf-8"))
    started, ended = (datetime.fromisoformat(manifest[key]) for key in ("started", "ended"))
    if ended < started or manifest["wall_s"] < 0:
        yield f"started {started}, ended {ended}, took {manifest['wall_s']} s"
    if not abs((ended - started).total_seconds() - manifest["wall_s"]) < 2:
        yield f"ended {ended - started} after its start, and took {manifest['wall_s']} s"
    page = unescape((path / "report.html").read_text("utf-8"))
    for step in manifest.get("clock_steps", ()):
        if step["set_by_s"] and f"clock was set by {step['set_by_s']:+g} s" not in page:
            yield f"the report does not say that the clock was set by {step['set_by_s']} s"
