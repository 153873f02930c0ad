"""Lines of a preflight that need no instrument, alerts that fail, and what is remembered of what was tried."""

from __future__ import annotations

import datetime as dt
import json
import shutil
from pathlib import Path

import pytest

from bench.app import preflight as module
from bench.app.preflight import preflight, rehearsal_key
from bench.app.request import PreparedRun, RunRequest, prepare
from bench.clock import wall_utc
from bench.runner import alert as alert_module
from bench.runner.alert import alert, program_id
from bench.store.tried import TRIED, last_tried, note_tried
from bench.store.user_state import state_folder
from tests.support.runs import ROOT
from tests.support.sequences import TAIL, steps

WIRES = ROOT / "config" / "simulated_wires.yaml"
OFF = "teardown: [{set: supply, output: off}]\n"
ON = "{set: supply, voltage: 15 V, current_limit: 120 mA, output: on}"


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def prepared(folder: Path, *lines: str, setup: str = "", bench: Path = WIRES) -> PreparedRun:
    path = folder / "s.yaml"
    path.write_text((f"setup: [{setup}]\n" if setup else "") + steps(*lines) + OFF + TAIL, "utf-8")
    return prepare(RunRequest(str(path), bench=str(bench), units=("QF-1",), runs=folder))


def wires_with(folder: Path, *edits: tuple[str, str], more: str = "") -> Path:
    shutil.copytree(ROOT / "config", folder / "config", dirs_exist_ok=True)
    text = WIRES.read_text("utf-8")
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new)
    path = folder / "config" / "wires.yaml"
    path.write_text(text + more, "utf-8")
    return path


def test_a_certificate_that_ends_within_the_run_is_named(tmp_path):
    tomorrow = (wall_utc() + dt.timedelta(days=1)).date()
    bench = wires_with(tmp_path, ("due: 2030-12-31", f"due: {tomorrow}"))
    short = module._certificates(prepared(tmp_path, "{move: head, to: 10°}", "{wait: 1 min}", bench=bench))
    assert short.state == "ok"
    long = module._certificates(prepared(tmp_path, "{move: head, to: 10°}", "{wait: 72 h}", bench=bench))
    assert long.state == "NO"
    assert f"head ({tomorrow})" in long.text


@pytest.mark.parametrize(
    ("lines", "setup", "state", "words"),
    [
        (("{wait: 1 s}",), "", "ok", "has no prompts"),
        (("{wait: 1 s}",), "{prompt: 'Ready?'}", "look", "stay until these are answered"),
        (("{prompt: 'Turn the cube.'}",), "", "NO", "s.yaml:2:5"),
        (("{wait_until: unit_temperature, above: 1 °C, give_up_after: 1 s, on_failure: ask}",), "", "NO", "s.yaml:2:5"),
        (("{group: g, on_failure: ask, steps: [{wait: 1 s}]}",), "", "NO", "s.yaml:2:5"),
    ],
)
def test_a_run_that_waits_for_a_person_is_not_left_alone(tmp_path, lines, setup, state, words):
    found = module._questions(prepared(tmp_path, *lines, setup=setup))
    assert (found.state, words in found.text) == (state, True), found.text


def test_a_disk_that_holds_the_run_only_once_is_too_small(tmp_path):
    run = prepared(tmp_path, "{wait: 1 s}")
    assert module._disk(run).state == "ok"
    assert module._disk(run._replace(expected=run.expected._replace(size_bytes=10**18))).state == "NO"


def test_a_rehearsal_holds_for_its_files_and_parameters_alone(tmp_path):
    run = prepared(tmp_path, "{wait: 1 s}")
    assert module._rehearsal(run).state == "NO"
    note_tried("rehearsal", rehearsal_key(run))
    assert module._rehearsal(run).state == "ok"
    assert module._rehearsal(prepared(tmp_path, "{wait: 2 s}")).state == "NO"
    other = wires_with(tmp_path, ("rate: 20 °/s", "rate: 19 °/s"))
    assert module._rehearsal(prepared(tmp_path, "{wait: 1 s}", bench=other)).state == "NO"


def test_parameters_are_under_the_rehearsal(tmp_path):
    wish = RunRequest("smoke", bench=str(WIRES), units=("QF-1",), runs=tmp_path)
    assert rehearsal_key(prepare(wish)) != rehearsal_key(prepare(wish._replace(settings=("soak=31 s",))))
    assert rehearsal_key(prepare(wish)) == rehearsal_key(prepare(wish._replace(simulate=True)))


def test_an_alert_counts_for_a_day_and_for_its_program(tmp_path):
    bench = wires_with(tmp_path, more="alert: {exec: [/bin/true]}\n")
    run = prepared(tmp_path, "{wait: 1 s}", bench=bench)
    assert "tried never" in module.alert_line(run).text
    note_tried("alert", program_id(["/bin/true", "--other"]))
    assert module.alert_line(run).state == "NO"
    note_tried("alert", program_id(["/bin/true"]))
    assert module.alert_line(run).state == "ok"
    path = state_folder() / TRIED
    old = (wall_utc() - dt.timedelta(hours=25)).isoformat(timespec="seconds")
    path.write_text(
        json.dumps({"what": "alert", "key": program_id(["/bin/true"]), "at": old}) + "\nnonsense\n[]\n", "utf-8"
    )
    assert "not within 24 h" in module.alert_line(run).text
    assert "names no program" in module.alert_line(prepared(tmp_path, "{wait: 1 s}")).text


def test_nothing_was_tried_where_nothing_can_be_read():
    (state_folder() / TRIED).mkdir()
    assert last_tried("alert", "x") is None


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("exit 3", "ended with code 3"),
        ("echo no network >&2; exit 1", "ended with code 1: no network"),
        ("sleep 60", "has not ended within 0.3 s"),
    ],
)
def test_an_alert_that_fails_says_how(script, words, monkeypatch):
    monkeypatch.setattr(alert_module, "LIMIT_S", 0.3)
    assert words in alert(["/bin/sh", "-c", script], "t", "x")


def test_an_alert_program_that_is_not_there_is_named():
    assert "/no/such cannot be run" in alert(["/no/such"], "t", "x")


def test_an_alert_is_given_title_and_text(tmp_path):
    out = tmp_path / "out"
    assert alert(["/bin/sh", "-c", f'(cat; echo "$0") > {out}'], "the title", "the text\n") == ""
    assert out.read_text("utf-8") == "the text\nthe title\n"


def test_on_a_simulated_bench_only_what_applies_is_looked_at(tmp_path):
    found = preflight(prepare(RunRequest("smoke", runs=tmp_path)))
    assert found.is_green
    assert [line.what for line in found.lines] == ["instruments", "disk", "times"]


def test_a_supply_that_is_named_and_not_there_keeps_a_run_from_being_left_alone(tmp_path):
    run = prepared(tmp_path, "{wait: 1 s}", bench=wires_with(tmp_path, more="power: {ups: 'u@127.0.0.1:1'}\n"))
    found = module._power(run)
    assert (found.state, "is not known (upsd at 127.0.0.1:1" in found.text) == ("NO", True), found.text
    assert module._power(prepared(tmp_path, "{wait: 1 s}")).state == "look"
