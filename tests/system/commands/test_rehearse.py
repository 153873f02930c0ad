"""Rehearsals: a sequence on simulators of a bench, held against its plan, also with instruments that break."""

from __future__ import annotations

import datetime as dt
import json
import re

import pytest

from bench.app.drawn_faults import draw_faults
from bench.app.rehearse import rehearse
from bench.app.request import RunRequest, load_checked, prepare
from bench.clock import wall_utc
from bench.config.bench import load_bench
from bench.errors import InputError
from bench.runner.quiet import Quiet
from bench.store.reader import RunReader
from tests.support.runs import ROOT, SHORT
from tests.support.sequences import BENCH, TAIL

pytestmark = pytest.mark.slow

WIRES = ROOT / "config/simulated_wires.yaml"
TABLE = load_bench(ROOT / "config/rate_table.yaml").bench
SOAKING = """\
setup:
  - {set: supply, voltage: 15 V, current_limit: 120 mA, output: on}
steps:
  - for_each: temperature
    in: [20 °C, 40 °C, 0 °C]
    steps:
      - {ramp: chamber, to: "${temperature}", at: 3 °C/min}
      - soak: unit_temperature
        at_least: 1 min
        until_stable: {band: 0.2 °C, slope: 1 °C/h, hold: 10 min}
        give_up_after: 4 h
  - {ramp: chamber, to: 30 °C, at: 3 °C/min}
  - {wait_until: unit_temperature, above: 33 °C, hold: 1 min, give_up_after: 2 h}
  - {prompt: Open the door.}
teardown:
  - {set: supply, output: off}
"""
TURNING = """\
schema: itb-sequence/1
title: Turning and swinging
needs: {table: rate_table, counter: pulse_counter}
steps:
  - {move: table, to: 90°}
  - {rotate: table, at: 30 °/s, during: [{acquire: counter, turns: 2, of: table, label: turning}]}
  - {oscillate: table, amplitude: 1°, sweep: {from: 1 Hz, to: 4 Hz}, for: 60 s}
  - {rotate: table, at: -400 °/s, turns: 5}
teardown:
  - {move: table, to: 0°}
"""


def rehearsed(folder, sequence="smoke", fault_seed=None, **options):
    options = {"bench": str(WIRES), "simulate": True, "runs": folder} | options
    return rehearse(prepare(RunRequest(sequence, **options)), Quiet(), fault_seed)


def written(folder, text):
    path = folder / "s.yaml"
    path.write_text(text, "utf-8")
    return str(path)


def test_a_rehearsal_is_of_a_bench_with_real_connections_and_ends_in_a_table(tmp_path, bench_here):
    done = bench_here("rehearse", "smoke", "--bench", WIRES, "--runs", tmp_path)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0].split() == ["planned", "took", "ratio"]
    rows = {line.split("  ")[-1]: line.split() for line in lines if line}
    assert rows["steps"][4] == "1.00"
    assert rows["all"][4] in ("1.02", "1.03", "1.04")
    assert rows["size of run.db"][1] == "MB"
    assert sum("teardown/move" in line for line in lines) == 1
    assert "The run completed after 71.7 s" in lines
    assert "Made safe: every device" in lines
    assert "On the disk: all that was acknowledged" in lines
    assert "Verdict on the simulated units: PASS" in lines
    manifest = json.loads(next(tmp_path.glob("*/manifest.json")).read_text("utf-8"))
    assert set(manifest["simulated"]) == {"chamber", "head", "counter", "supply", "source"}


def test_a_rehearsal_ends_with_the_exit_code_that_the_run_would_have(tmp_path, bench_here):
    strict = (ROOT / "sequences/smoke.yaml").read_text("utf-8").replace("min: -5 mg, max: 5 mg", "max: 5 µg")
    done = bench_here("rehearse", written(tmp_path, strict), "--bench", WIRES, "--runs", tmp_path / "runs")
    assert done.returncode == 1
    assert "Verdict on the simulated units: FAIL" in done.stdout


def test_with_a_fault_it_says_what_was_broken_when_and_how_it_ended(tmp_path, bench_here):
    done = bench_here("rehearse", "smoke", "--bench", WIRES, "--runs", tmp_path, "--faults", "5")
    assert done.returncode == 6
    injected = re.findall(r"^Injected (\d+:\d\d:\d\d): (\w+) (\w+)$", done.stdout, re.MULTILINE)
    drawn = {(fault.device, fault.kind) for fault in draw_faults(BENCH, 69.6, 5)}
    assert injected
    assert {(device, kind) for _, device, kind in injected} <= drawn
    assert "The run ended with an error after" in done.stdout
    assert "in which a fault was injected" in done.stdout
    assert "Problem: " in done.stdout


@pytest.mark.parametrize("seed", range(1, 13))
def test_whatever_breaks_all_else_is_made_safe_and_nothing_acknowledged_is_lost(tmp_path, seed):
    rehearsal = rehearsed(tmp_path, fault_seed=seed)
    assert 1 <= len(rehearsal.faults) <= 3
    assert rehearsal.unsafe_without_fault == ()
    assert rehearsal.lost == ()
    if rehearsal.result.outcome.how != "completed":
        assert rehearsal.result.problems
    if "supply" in {fault.device for fault in rehearsal.faults}:
        return
    with RunReader(rehearsal.result.path) as reader:
        ended = {event.step: event.data for event in reader.events("step_ended")}
    assert ended["teardown/set"]["output"] is False, "the unit is off"


def test_faults_are_those_of_the_seed_on_devices_of_the_bench_within_the_plan():
    drawn = [draw_faults(BENCH, 1000.0, seed) for seed in range(200)]
    assert drawn == [draw_faults(BENCH, 1000.0, seed) for seed in range(200)]
    faults = [fault for each in drawn for fault in each]
    assert {len(each) for each in drawn} == {1, 2, 3}
    assert {fault.device for fault in faults} == set(BENCH.devices)
    assert all(0 <= fault.at <= 1000 for fault in faults)
    assert all(len({fault.device for fault in each}) == len(each) for each in drawn)
    assert {fault.kind for fault in faults if fault.device == "counter"} == {"silent", "cut", "frozen", "restart"}
    assert {fault.kind for fault in faults if fault.device == "source"} == {"silent", "cut", "stuck"}
    assert {fault.kind for fault in faults if fault.device == "head"} == {"silent", "cut", "frozen", "stuck"}
    assert {fault.device for seed in range(50) for fault in draw_faults(TABLE, 9.0, seed)} == set(TABLE.devices)


def test_a_step_that_was_told_and_is_not_in_the_journal_is_lost(tmp_path, monkeypatch):
    events = RunReader.events
    monkeypatch.setattr(
        RunReader, "events", lambda self, *kinds: (each for each in events(self, *kinds) if "acquire" not in each.step)
    )
    lost = rehearsed(tmp_path).lost
    assert "step_begins steps/temperature=20/position=0/acquire is not in the journal" in lost
    assert "step_ended steps/temperature=20/position=270/acquire is not in the journal" in lost


def test_soaks_and_waits_take_what_the_plan_said(tmp_path):
    rehearsal = rehearsed(tmp_path, written(tmp_path, SOAKING + TAIL))
    assert rehearsal.result.outcome.how == "completed"
    assert rehearsal.result.bench_s == pytest.approx(rehearsal.expected.total_s, rel=0.03)
    took = {step.name: step for step in rehearsal.steps}
    for name in ("20/soak", "40/soak", "0/soak"):
        assert took[f"steps/temperature={name}"].ratio == pytest.approx(1, abs=0.05)
        assert took[f"steps/temperature={name}"].took_s > 15 * 60
    assert took["steps/wait_until"].took_s == pytest.approx(took["steps/wait_until"].planned_s, abs=30)
    assert took["steps/prompt"].ratio == pytest.approx(1)
    assert rehearsal.largest_deviations(1)[0].name.endswith("/soak")


def test_turning_takes_what_the_plan_said(tmp_path):
    bench = str(ROOT / "config/rate_table.yaml")
    rehearsal = rehearsed(tmp_path, written(tmp_path, TURNING), bench=bench)
    assert rehearsal.result.outcome.how == "completed"
    assert rehearsal.result.bench_s == pytest.approx(rehearsal.expected.total_s, rel=0.08)


def test_a_short_tumble_takes_and_writes_what_the_plan_said(tmp_path):
    rehearsal = rehearsed(tmp_path, "tumble_static", settings=SHORT)
    assert rehearsal.result.bench_s == pytest.approx(rehearsal.expected.total_s, rel=0.01)
    assert rehearsal.stored_bytes == pytest.approx(rehearsal.expected.size_bytes, rel=0.13)
    assert [phase.name for phase in rehearsal.phases] == ["setup", "steps", "teardown"]
    assert all(phase.ratio == pytest.approx(1, abs=0.02) for phase in rehearsal.phases[1:])


def ends_too_late(**options):
    checked = load_checked(RunRequest("tumble_static", **options))
    return [remark.problem for remark in checked.warnings if remark.rule == "ends-too-late"]


def test_a_simulated_run_that_ends_too_late_by_its_own_time_is_warned_of():
    assert ends_too_late(bench="simulated") == []
    assert ends_too_late(bench="simulated", not_after="2026-01-02T09:00Z") == []
    (problem,) = ends_too_late(bench="simulated", not_after="2026-01-02T08:00:00+01:00")
    assert problem == (
        "a run that begins at 2026-01-01 00:00 UTC ends at about 2026-01-02 08:50 UTC, "
        "1 h 51 min after 2026-01-02 07:00 UTC"
    )


def test_a_run_with_real_connections_would_begin_now():
    tomorrow = wall_utc() + dt.timedelta(hours=34)
    assert ends_too_late(bench=str(WIRES), not_after=tomorrow.isoformat()) == []
    assert len(ends_too_late(bench=str(WIRES), not_after=(tomorrow - dt.timedelta(hours=3)).isoformat())) == 1


@pytest.mark.parametrize("command", ["check", "plan", "rehearse", "run"])
def test_every_command_that_plans_warns_of_a_late_end(tmp_path, bench_here, command):
    runs = ("--runs", tmp_path) if command in ("run", "rehearse") else ()
    done = bench_here(command, "smoke", "--bench", "simulated", "--not-after", "2026-01-01T00:00:30Z", *runs)
    assert done.returncode == 0
    assert "ends-too-late" in done.stderr


def test_an_instant_needs_its_zone():
    with pytest.raises(InputError, match=r"--not-after 2026-01-02T07:00: .* a time with its zone"):
        ends_too_late(bench="simulated", not_after="2026-01-02T07:00")


def test_a_rehearsal_of_a_real_bench_warns_as_of_tonight(tmp_path, bench_here):
    yesterday = (wall_utc() - dt.timedelta(days=1)).isoformat(timespec="seconds")
    done = bench_here("rehearse", "smoke", "--bench", WIRES, "--not-after", yesterday, "--runs", tmp_path)
    assert done.returncode == 0
    assert "ends-too-late" in done.stderr
