"""Chambers after a run over real wires: their air arrives, or they are held, and whoever comes has the bench."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from bench.store.energised import energised
from tests.support import guardians
from tests.support.energised import HOT_C, SAFE, SAFE_C, Process, Wires, end_following, wires
from tests.support.guardians import guardian_of, has_ended, has_made_safe
from tests.support.killed import journal
from tests.support.runs import ROOT

pytestmark = pytest.mark.integration
until = partial(guardians.until, within_s=30.0)
HELD = {**SAFE, "chamber": HOT_C}
SOAKED_C, SOAK_S, BEFORE_S = 20.4, 10.0, 1.0  # where the air is nearly, so that it is within the band at once
SOAKED = f"""\
schema: itb-sequence/1
title: Soaked
needs: {{supply: power_supply, chamber: thermal_chamber, unit_temperature: thermometer}}
steps:
  - {{ramp: chamber, to: {SOAKED_C} °C, at: 1200 °C/min}}
  - {{soak: unit_temperature, at_least: {SOAK_S:g} s}}
  - {{set: supply, voltage: 15 V, current_limit: 120 mA, output: on}}
  - wait: 1 h
teardown:
  - {{set: supply, output: off}}
"""


@pytest.fixture(scope="module")
def served(tmp_path_factory) -> Iterator[Wires]:
    with wires(tmp_path_factory.mktemp("served")) as found:
        yield found


@pytest.fixture
def bench(served, tmp_path, monkeypatch) -> Iterator[Wires]:
    """The bench, at which nobody looks any more afterwards."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    yield served
    end_following(served.bench)
    bench_command("make-safe", "--bench", str(served.bench))


@pytest.fixture
def cool(tmp_path, monkeypatch) -> Iterator[Wires]:
    """A bench whose air nobody has heated yet."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with wires(tmp_path / "served") as found:
        yield found
        end_following(found.bench)


def bench_command(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "bench", *words], capture_output=True, text=True, cwd=ROOT, check=False,
        stdin=subprocess.DEVNULL, timeout=120,
    )  # fmt: skip


def holding(bench: Wires, folder: Path) -> Path:
    """The bench file with a hold of 30 min."""
    return bench.edited(
        folder, "chamber", lambda line: line.replace("{temperature: 25 °C}", "{temperature: 25 °C, hold: 30 min}")
    )


def course(run: Process) -> list[str]:
    """The events of the chamber after the run, without those of single looks."""
    assert run.path is not None
    path = run.path / "followed.jsonl"
    entries = [json.loads(line) for line in path.read_text("utf-8").splitlines()] if path.exists() else []
    return [each["event"] for each in entries if each["role"] == "chamber" and each["event"] != "reading"]


def kinds_since_resumed(run: Process) -> list[str]:
    """The kinds of the entries of its journal since it was resumed."""
    assert run.path is not None
    kinds = [entry.kind for entry in journal(run.path)]
    return kinds[kinds.index("run_resumed") :] if "run_resumed" in kinds else []


def killed(bench: Path, folder: Path) -> tuple[Process, int]:
    run = Process(bench, folder)
    run.until_step("steps/wait")
    guardian = guardian_of(run.process.pid)
    run.process.kill()
    run.process.wait()
    until(lambda: has_made_safe(run.path))
    return run, guardian


def test_a_run_ends_at_once_and_its_guardian_sees_the_air_arrive(bench, tmp_path):
    cool = bench.edited(tmp_path / "own", "chamber", lambda line: line.replace("25 °C}", "21 °C}"))  # where its air is
    run = Process(cool, tmp_path)
    run.until_step("steps/wait")
    run.send(signal.SIGTERM)
    assert run.code() == 4
    assert bench.state() == {**SAFE, "chamber": 21.0}
    devices = bench_command("devices", "--bench", str(cool))
    assert devices.returncode == 0, devices.stderr
    until(lambda: course(run)[-1:] == ["arrived"], why=lambda: "the air has not arrived")
    assert course(run) == ["commanded", "arrived"]
    assert "arrived at" in bench_command("status", str(run.path)).stdout


def test_a_held_chamber_stays_until_its_guardian_is_ended(bench, tmp_path):
    run, guardian = killed(holding(bench, tmp_path / "own"), tmp_path)
    assert bench.state() == HELD
    until(lambda: course(run) == ["held"])
    assert [list(each.connections) for each in energised(lambda _: None)] == [["chamber"]]
    assert bench_command("make-safe", "--if-left-on").returncode == 0
    assert bench.state() == HELD, "its guardian ends that"
    os.kill(guardian, signal.SIGTERM)
    until(lambda: has_ended(guardian))
    assert bench.state() == SAFE
    assert course(run)[:3] == ["held", "hold_ends", "commanded"]
    assert list(energised(lambda _: None)) == []


def test_a_hold_without_a_guardian_is_ended_by_make_safe(bench, tmp_path):
    run, guardian = killed(holding(bench, tmp_path / "own"), tmp_path)
    until(lambda: course(run) == ["held"])
    os.kill(guardian, signal.SIGKILL)
    until(lambda: has_ended(guardian))
    assert bench.state() == HELD
    assert bench_command("make-safe", "--if-left-on").returncode == 0
    assert bench.state() == SAFE


def test_a_resumed_run_takes_a_held_chamber_over_as_it_is(bench, tmp_path):
    run, guardian = killed(holding(bench, tmp_path / "own"), tmp_path)
    until(lambda: course(run) == ["held"])
    assert bench_command("acknowledge", str(run.path), "--reason", "a test").returncode == 0
    resumed = subprocess.Popen(
        [sys.executable, "-m", "bench", "resume", str(run.path), "--interrupted"],
        stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, cwd=ROOT,
    )  # fmt: skip
    try:
        until(lambda: has_ended(guardian))
        until(lambda: "step_begins" in kinds_since_resumed(run))
        assert "found_energised" not in kinds_since_resumed(run)
        assert bench.state_of("chamber") != SAFE_C
        assert course(run)[:2] == ["held", "handed_over"]
    finally:
        resumed.send_signal(signal.SIGTERM)
        reported = resumed.communicate(timeout=60)[1]
    assert "held at its set point" in reported
    assert bench.state() == SAFE


def killed_in_its_soak(bench: Wires, folder: Path) -> tuple[Process, float]:
    """A run that was killed in a soak without power, its chamber held; when the soak had not begun yet."""
    often = holding(bench, folder / "own")
    often.write_text(often.read_text("utf-8").replace("  period: 1 s\n", "  {period: 1 s, devices: 1 s}\n"), "utf-8")
    run = Process(often, folder, text=SOAKED)
    run.until_step("steps/soak")
    before_s = time.monotonic() - 1.0
    time.sleep(BEFORE_S + 1.0)  # until its chamber was read, and that was written
    run.process.kill()
    run.process.wait()
    until(lambda: has_made_safe(run.path))
    until(lambda: course(run) == ["held"])
    assert bench_command("acknowledge", str(run.path), "--reason", "a test").returncode == 0
    return run, before_s


@contextmanager
def resuming(run: Process) -> Iterator[list[str]]:
    """The run, resumed until the end of the block; what it told is in the list then."""
    reported: list[str] = []
    resumed = subprocess.Popen(
        [sys.executable, "-m", "bench", "resume", str(run.path), "--interrupted"],
        stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True, cwd=ROOT,
    )  # fmt: skip
    try:
        yield reported
    finally:
        resumed.send_signal(signal.SIGTERM)
        reported.append(resumed.communicate(timeout=60)[1])


def soak_credit(run: Process) -> dict[str, Any]:
    (credit,) = (each for each in journal(run.path) if each.kind == "soak_credit")
    assert credit.step == "steps/soak~2"
    return dict(credit.data)


def test_a_soak_of_a_resumed_run_has_credit_for_the_time_in_which_its_chamber_was_held(cool, tmp_path):
    run, before_s = killed_in_its_soak(cool, tmp_path)
    with resuming(run) as reported:
        until(lambda: "soak_credit" in kinds_since_resumed(run))
        passed_s = time.monotonic() - before_s
        until(lambda: "steps/soak~2" in [each.step for each in journal(run.path) if each.kind == "step_ended"])
    credit = soak_credit(run)
    assert BEFORE_S <= credit["credit_s"] <= passed_s, credit
    (again,) = (each for each in journal(run.path) if each.kind == "step_ended" and each.step == "steps/soak~2")
    assert again.data["soaked_s"] == pytest.approx(max(SOAK_S - credit["credit_s"], 0.0), abs=1.0)
    assert credit["looks"] >= 1
    assert credit["longest_gap_s"] < passed_s
    assert "The soak steps/soak~2 is credited with" in reported[0]
    assert "counted as passed: its chamber was held" in (run.path / "report.html").read_text("utf-8")


def test_a_soak_has_no_credit_where_somebody_switched_the_unit_on_meanwhile(cool, tmp_path):
    run, _ = killed_in_its_soak(cool, tmp_path)
    cool.switch_supply_on()
    with resuming(run) as reported:
        until(lambda: "soak_credit" in kinds_since_resumed(run))
    credit = soak_credit(run)
    assert (credit["credit_s"], credit["why"]) == (0.0, "supply was found energised")
    assert "No credit for the soak steps/soak~2: supply was found energised. It is done in full." in reported[0]
    assert "No credit for the soak steps/soak~2: supply was found energised." in (run.path / "report.html").read_text()
