"""Runs in virtual time on a computer whose clock is set, slewed and stopped, also while they are interrupted."""

from __future__ import annotations

import json
import random
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from datetime import datetime
from functools import lru_cache
from pathlib import Path

from bench.app.execute import execute
from bench.app.request import RunRequest, prepare
from bench.app.resume import prepared_again, read_interrupted
from bench.clock import SMALLEST_STEP_S, wall_utc
from bench.runner.quiet import Quiet
from bench.store.reader import Event
from bench.store.verify import examine
from tests.support.killed import KILLED, journal
from tests.support.runs import ROOT
from tests.support.wall_clock import ZONE, Change, WallClock, epoch_of

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
    """A run of every type of step; each second one is killed and resumed, each fifth begins where a clock is changed."""
    draw = random.Random(f"clock {number}")
    name = "table" if number % 4 == 3 else "head"
    began = epoch_of(draw.choice(AT_A_LIMIT)) - draw.uniform(0, 300) if number % 5 else draw.uniform(1.6e9, 2.0e9)
    with tempfile.TemporaryDirectory() as folder:
        wrong = list(_played(Path(folder), name, began, draw, kill=number % 2 == 1))
    return "; ".join(wrong[:4])


def _played(folder: Path, name: str, epoch_s: float, draw: random.Random, *, kill: bool) -> Iterator[str]:
    length_s = _expected_s(name)
    changes = _changes(draw, length_s)
    at_s = draw.uniform(0.1, 0.95) * length_s if kill else None
    lying = Change(0.0, "set", draw.choice((-DAY_S, -HOUR_S, -300.0, 300.0, HOUR_S, DAY_S))) if kill else None
    undisturbed = _run(folder / "a", name, epoch_s, (), at_s, None)
    path = _run(folder / "b", name, epoch_s, changes, at_s, lying)
    entries, calm = journal(path), journal(undisturbed)
    yield from _same(calm, entries)
    yield from _steps_journaled(entries, changes)
    if lying is not None:
        yield from _outage(entries)
    yield from _manifest(path)
    yield from examine(path).damage


def _changes(draw: random.Random, length_s: float) -> list[Change]:
    """A few changes of the clocks, apart from each other; those before the end of the run by less than a look too."""
    kinds = {"set": (-DAY_S, -HOUR_S, HOUR_S, DAY_S, -1.0, 2.0), "slew": (-2e-4, 2e-4, 5e-4), "sleep": (20.0, HOUR_S)}
    found, at_s = [], draw.uniform(1.0, APART_S)
    while at_s < length_s and len(found) < 5:
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
    again_s = kill_s + ON_OUTAGE_S
    moved = [each for each in changes if each.at_s <= kill_s]  # the others come when bench time is there
    if lying is not None:
        moved = [*moved, lying._replace(at_s=again_s - 1.0)]
    with WallClock(epoch_s, [*moved, *(each for each in changes if each.at_s > again_s)], again_s).used():
        resumption = read_interrupted(path)
        truly_s = ON_OUTAGE_S + kill_s - resumption.last_s
        most_s = truly_s + sum(max(0.0, each.by_s) for each in moved if each.kind in ("set", "sleep")) + AGREES_S
        assert 0 <= resumption.outage_s(wall_utc()) <= most_s, f"an outage of {resumption.outage_s(wall_utc())} s"
        execute(prepared_again(resumption), Quiet(), None, resumption)
    return path


def _same(calm: Sequence[Event], entries: Sequence[Event]) -> Iterator[str]:
    """What is not as in a run whose clock nobody sets: order, durations, and everything that was found."""
    times = [entry.at_s for entry in entries]
    if times != sorted(times):
        yield "the journal is not in the order of time"
    found = [entry for entry in entries if entry.kind != "clock_step"]
    if [(each.kind, each.step) for each in found] != [(each.kind, each.step) for each in calm]:
        yield f"other entries than without: {len(found)} and {len(calm)}"
    for before, now in zip(calm, found, strict=False):
        if abs(before.at_s - now.at_s) > AGREES_S:
            yield f"{now.kind} {now.step} at {now.at_s:.3f} s and not at {before.at_s:.3f} s"
            return


def _steps_journaled(entries: Sequence[Event], changes: Sequence[Change]) -> Iterator[str]:
    """Each step of the clock and each sleep while a process ran is in the journal, and nothing else is."""
    wanted = [each for each in changes if each.kind != "slew" and _was_watched(entries, each.at_s)]
    told = [entry for entry in entries if entry.kind == "clock_step"]
    found = [entry.data["set_by_s"] + entry.data["slept_s"] for entry in told]
    if [round(each.by_s) for each in wanted] != [round(by_s) for by_s in found]:
        yield f"the clock was changed by {[each.by_s for each in wanted]}, and journaled is {found}"
    for each, entry in zip(wanted, told, strict=False):
        if not 0 <= entry.at_s - each.at_s <= APART_S:
            yield f"{each} was journaled at {entry.at_s:.1f} s"


def _was_watched(entries: Sequence[Event], at_s: float) -> bool:
    """Whether the process that kept this journal ran at an instant, and lived on until it had looked."""
    ends = [entry.at_s for entry in entries if entry.kind == "run_ended"]
    for entry in entries:
        if entry.kind == "run_resumed" and entry.data["interrupted_s"] - 2 * APART_S < at_s <= entry.at_s:
            return False
    return SMALLEST_STEP_S <= at_s < max(ends, default=0.0)


def _outage(entries: Sequence[Event]) -> Iterator[str]:
    for entry in entries:
        if entry.kind == "run_resumed" and not 0 <= entry.data["outage_s"] <= DAY_S:
            yield f"an outage of {entry.data['outage_s']} s"


def _manifest(path: Path) -> Iterator[str]:
    """What is wrong with the times in the manifest and on the first page."""
    manifest = json.loads((path / "manifest.json").read_text("utf-8"))
    started, ended = (datetime.fromisoformat(manifest[key]) for key in ("started", "ended"))
    if ended < started or manifest["wall_s"] < 0:
        yield f"started {started}, ended {ended}, took {manifest['wall_s']} s"
    if not abs((ended - started).total_seconds() - manifest["wall_s"]) < 2:
        yield f"ended {ended - started} after its start, and took {manifest['wall_s']} s"
    page = (path / "report.html").read_text("utf-8")
    for step in manifest.get("clock_steps", ()):
        if step["set_by_s"] and f"clock was set by {step['set_by_s']:+.1f} s".replace("+", "") not in page.replace("+", ""):
            yield f"the report does not say that the clock was set by {step['set_by_s']} s"


__all__ = ["ZONE", "clock"]
