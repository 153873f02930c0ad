"""The page on bad nights, followed literally; and the shipped bad night, which its reader is sent to."""

from __future__ import annotations

import re
from typing import get_args

import pytest

from bench.app.rehearse import rehearse
from bench.app.request import RunRequest, prepare
from bench.config.simulation import DeviceFault, UnitFault
from bench.runner.quiet import Quiet
from bench.store.reader import RunReader
from simulators.faults.instrument_faults import LINE_FAULTS
from tests.support.how_to import FOLDER, blocks, commands
from tests.support.runs import ROOT

pytestmark = pytest.mark.slow

PAGE = FOLDER / "rehearse_a_bad_night.md"


def test_the_page_can_be_followed(tmp_path, bench_here):
    ((_, scenario),) = blocks(PAGE)
    (tmp_path / "door.yaml").write_text(scenario, "utf-8")
    (tmp_path / "config").symlink_to(ROOT / "config")
    by_chance, scripted = [bench_here(*words[1:], cwd=tmp_path) for words in commands(PAGE)]
    assert "Injected" in by_chance.stdout
    assert scripted.returncode == 3, scripted.stderr
    assert re.findall(r"^Injected \d:\d\d:\d\d: (.*)$", scripted.stdout, re.MULTILINE) == [
        "chamber silent", "chamber door_open", "head emergency_stop",
    ]  # fmt: skip
    assert "Made safe: every device" in scripted.stdout


def test_the_page_tells_every_fault_once():
    _, *tables = PAGE.read_text("utf-8").split("| fault of a")
    reported = [re.findall(r"^\| `(\w+)`", table, re.MULTILINE) for table in tables]
    wire, instrument, unit = reported
    assert wire == ["silent", "cut", *LINE_FAULTS]
    assert wire + instrument == list(get_args(DeviceFault))
    assert unit == list(get_args(UnitFault))


def test_the_shipped_bad_night_is_borne_until_the_emergency_stop(tmp_path):
    scenario = ROOT / "config/scenarios/bad_night.yaml"
    shorter = ("temperatures=[45 °C]", "warm_up=65 min", "soak=60 min")
    request = RunRequest(
        "tumble_static", preset="quick", settings=shorter, bench="simulated", scenario=scenario, runs=tmp_path
    )
    rehearsal = rehearse(prepare(request), Quiet())
    assert None not in rehearsal.began_s
    assert (rehearsal.unsafe, rehearsal.lost) == ({}, ())
    took = {step.name: step.took_s - step.planned_s for step in rehearsal.steps}
    assert took["steps/cycle=1/temperature=45/soak"] > 600, "the door has cost the soak its time"
    assert (
        "steps/cycle=1/temperature=45/position=180/move: head: axis X has a fault: emergency stop"
        in (rehearsal.result.problems[0])
    )
    with RunReader(rehearsal.result.path) as reader:
        notes = [event.data["text"] for event in reader.events("device_note")]
    assert len(notes) == 2
    assert all(note.startswith("asked again: chamber: no answer within 3 s") for note in notes)
