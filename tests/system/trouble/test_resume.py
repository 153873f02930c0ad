"""Runs that were killed in virtual time and go on: what is passed over, what is done again, what is refused."""

from __future__ import annotations

import json
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from bench.app.drawn_faults import with_drawn_faults
from bench.app.execute import RunResult
from bench.app.request import RunRequest, prepare
from bench.app.resume import prepare_again, read_interrupted
from bench.cli.main import main
from bench.engine.state import replayed
from bench.errors import InputError
from bench.metrology.power_cycles import SOURCE
from bench.reduce.stored_run import open_run
from bench.runner.quiet import Quiet
from bench.sequence.plan.dwells import first_visit
from bench.store.reader import digest_of
from bench.store.runs import RunDirectory
from bench.store.verify import examine
from campaigns.truth.resumed import stepping_bench
from tests.support.killed import ended, interrupted, interrupted_again, journal, resumed
from tests.support.runs import ROOT, copy_bench
from tests.support.sequences import TAIL, steps

BENCH = ROOT / "config" / "simulated.yaml"
ON = "{set: supply, voltage: 15 V, current_limit: 120 mA, output: on}"
SLOW = pytest.mark.slow
WHERE_S = (*(pytest.param(at_s, marks=SLOW) for at_s in (3.0, 26.0, 30.0, 65.0)), 50.0)  # of about 70 s


OFF = "teardown: [{set: supply, output: off}]\n"
TABLE_TAIL = """\
schema: itb-sequence/1
title: Test
needs: {table: rate_table, counter: pulse_counter, supply: power_supply}
"""


def cut(folder: Path, at_s: float, *lines: str, tail: str = OFF + TAIL, bench: Path = BENCH, **wishes: Any) -> Path:
    path = folder / "s.yaml"
    path.write_text(steps(*lines) + tail, "utf-8")
    return interrupted(folder / "runs", at_s, path, bench, **wishes)


def after(path: Path) -> list[str]:
    """Ids of the steps that began after the last interruption."""
    entries = journal(path)
    last = max(index for index, entry in enumerate(entries) if entry.kind == "run_resumed")
    return [entry.step for entry in entries[last:] if entry.kind == "step_begins"]


def values(path: Path) -> dict[str, tuple[float, float]]:
    found = json.loads((path / "results.json").read_text("utf-8"))["findings"]
    return {each["id"]: (each["value"], each["expanded"]) for each in found if each["quantity"] == "K0"}


@pytest.fixture
def undisturbed(smoke_run: RunResult) -> Path:
    return smoke_run.path


@pytest.mark.parametrize("at_s", WHERE_S)
def test_a_run_goes_on_where_it_was(tmp_path, undisturbed, at_s):
    path = interrupted(tmp_path, at_s, "smoke", BENCH)
    before = ended(journal(path))
    result = resumed(path)
    assert (result.path, result.outcome.how, result.outcome.unsafe) == (path, "completed", {})
    entries = journal(path)
    acquired = {step: count for step, count in ended(entries).items() if step.endswith("acquire")}
    assert acquired == dict.fromkeys((step for step in ended(journal(undisturbed)) if step.endswith("acquire")), 1)
    assert replayed(entries).under_way == ()
    assert [entry.at_s for entry in entries] == sorted(entry.at_s for entry in entries)
    assert not [step for step in after(path) if step.endswith("acquire") and first_visit(step) in before]
    assert examine(path).damage == ()
    assert result.results is not None
    begun = sum(step.endswith("acquire") for step in before)
    assert result.results.verdict == ("INCOMPLETE" if 0 < begun < len(acquired) else "PASS")
    for name, (value, expanded) in values(path).items():
        other, other_expanded = values(undisturbed)[name]
        assert abs(value - other) < expanded + other_expanded


@SLOW
def test_the_bench_is_restored_in_full_before_anything_is_done(tmp_path):
    path = interrupted(tmp_path, 50.0, "smoke", BENCH)
    resumed(path)
    names = [step.rpartition("/")[2].partition("~")[0] for step in after(path)]
    assert names[:4] == ["set", "ramp", "soak", "move"]
    assert all("~2" in step for step in after(path)[:4])


@SLOW
def test_a_resumed_run_is_read_back_as_it_was_written(tmp_path):
    path = interrupted(tmp_path, 50.0, "smoke", BENCH, no_report=False)
    resumed(path)
    manifest = json.loads((path / "manifest.json").read_text("utf-8"))
    assert manifest["digest"] == digest_of(path)
    assert manifest["started"] <= manifest["ended"]
    page = (path / "report.html").read_text("utf-8")
    assert "made safe, and resumed" in page
    assert "the run is INCOMPLETE" in page


def test_with_a_stated_repeatability_over_power_cycles_a_resumed_run_is_judged(tmp_path):
    bench = stepping_bench(tmp_path / "config")
    path = interrupted(tmp_path / "runs", 50.0, "smoke", bench, no_report=False)
    result = resumed(path)
    assert result.results is not None
    assert result.results.verdict == "PASS"
    (k0,) = (each for unit in result.results.units for each in unit.findings if each.quantity == "K0")
    assert sum(line.u for line in k0.budget if line.source == SOURCE) > 20e-6
    page = (path / "report.html").read_text("utf-8")
    assert "made safe, and resumed" in page
    assert "Budgets that it concerns contain its repeatability over power cycles." in page


def test_without_it_the_message_says_what_to_state_and_where(tmp_path):
    path = interrupted(tmp_path, 50.0, "smoke", BENCH)
    result = resumed(path)
    assert result.results is not None
    (found,) = result.results.journal_records.interruptions
    assert "state power_cycles in the bench file: places.a." in found.in_words


def test_a_supply_is_on_since_the_resumption(tmp_path):
    path = interrupted(tmp_path, 50.0, "smoke", BENCH)
    resumed(path)
    again_s = next(entry.at_s for entry in journal(path) if entry.kind == "run_resumed")
    with open_run(path) as run:
        acquired = [each for entry in run.sequence.results for each in run.data(entry.data).acquisitions]
    assert {each.stretch for each in acquired} == {0, 1}
    assert all((each.on_since_s["supply"][0] > again_s) == (each.stretch == 1) for each in acquired)


@SLOW
def test_an_attempt_that_was_cut_short_is_named_as_superseded(tmp_path):
    path = cut(
        tmp_path, 25.0, ON, "{wait: 5 s}", "{acquire: counter, for: 30 s, label: a}", "{wait: 2 s}", no_report=False
    )
    result = resumed(path)
    assert result.results is not None
    (found,) = result.results.journal_records.superseded
    assert (found.step, found.attempt, found.ended) == ("steps/acquire", 1, False)
    (kept,) = json.loads((path / "results.json").read_text("utf-8"))["superseded"]
    assert kept["step"] == "steps/acquire"
    assert "Superseded: attempt 1 of step steps/acquire" in (path / "report.html").read_text("utf-8")


@SLOW
def test_equal_interruptions_are_resumed_alike(tmp_path):
    digests = set()
    for folder in ("a", "b"):
        path = interrupted(tmp_path / folder, 50.0, "smoke", BENCH)
        resumed(path)
        digests.add(digest_of(path))
    assert len(digests) == 1


@SLOW
def test_a_run_that_is_interrupted_again_goes_on_again(tmp_path):
    path = interrupted(tmp_path, 30.0, "smoke", BENCH)
    first = journal(path)[-1].at_s
    once = resumed_at_s(tmp_path / "other", 30.0)
    interrupted_again(path, once + 20.0)
    result = resumed(path)
    assert result.outcome.how == "completed"
    entries = journal(path)
    assert [entry.data["number"] for entry in entries if entry.kind == "run_resumed"] == [1, 2]
    assert set(ended([e for e in entries if e.step.partition("~")[0].endswith("acquire")]).values()) == {1}
    assert first < once
    assert examine(path).damage == ()


def resumed_at_s(folder: Path, at_s: float) -> float:
    """When, in bench time, an equal run is resumed; what is drawn is the same."""
    path = interrupted(folder, at_s, "smoke", BENCH)
    resumed(path)
    return next(entry.at_s for entry in journal(path) if entry.kind == "run_resumed")


# What is decided and measured before it


def test_what_was_decided_and_measured_before_stays(tmp_path):
    lines = (
        "{measure: unit_temperature, as: t}",
        "{if: \"${t > '10 °C'}\", then: [{note: warm}, {wait: 20 s}, {note: 'was ${t}'}], else: [note: cold]}",
    )
    path = cut(tmp_path, 10.0, *lines)
    assert resumed(path).outcome.problems == []
    entries = journal(path)
    notes = [entry.data["note"] for entry in entries if entry.kind == "step_ended" and "note" in entry.data]
    assert notes[0] == "warm"
    assert notes[1].startswith("was ")
    assert sum(entry.kind == "decided" for entry in entries) == 1
    assert sum("reading" in entry.data for entry in entries if entry.kind == "step_ended") == 1


@SLOW
def test_a_loop_with_a_condition_goes_on_in_its_pass(tmp_path):
    lines = (
        ON,
        "{measure: supply.voltage, for: 1 s, as: v}",
        "{while: \"${v > '1 V'}\", at_most: 3, steps: ["
        "{wait: 20 s}, {if: \"${v > '20 V'}\", then: [note: never]},"
        " {measure: unit_temperature, as: t}]}",
    )
    path = cut(tmp_path, 35.0, *lines)
    result = resumed(path)
    assert "still true after 3 passes" in result.outcome.problems[0]
    waits = [step for step in ended(journal(path)) if step.endswith("/wait")]
    assert [step.split("/")[-2] for step in waits] == ["pass=1", "pass=2", "pass=3"]
    assert set(ended([e for e in journal(path) if e.step.endswith("/wait")]).values()) == {1}


# What lasts as long as other steps


def test_an_acquisition_during_other_steps_is_one_and_is_done_again_with_them(tmp_path):
    inside = "during: [{wait: 10 s}, {ramp: chamber, to: 24 °C, at: 3 °C/min}]"
    path = cut(tmp_path, 30.0, ON, f"{{acquire: counter, label: a, {inside}}}", "{note: over}")
    resumed(path)
    assert ended(journal(path))["steps/acquire/wait"] == 2
    assert ended(journal(path))["steps/acquire"] == 1


@SLOW
def test_what_was_acquired_during_a_rotation_is_kept(tmp_path):
    body = "during: [{acquire: counter, for: 5 s, label: a}, {acquire: counter, for: 30 s, label: b}]"
    turning = f"{{rotate: table, at: 10 °/s, {body}}}"
    found = cut(tmp_path, 25.0, ON, turning, tail=OFF + TABLE_TAIL, bench=ROOT / "config" / "rate_table.yaml")
    assert ended(journal(found))["steps/rotate/acquire"] == 1
    assert resumed(found).outcome.problems == []
    counted = ended(journal(found))
    assert (counted["steps/rotate/acquire"], counted["steps/rotate/acquire#2"], counted["steps/rotate"]) == (1, 1, 1)
    assert sum(entry.kind == "turning" for entry in journal(found)) == 2


@SLOW
def test_a_movement_by_an_angle_is_not_made_twice(tmp_path):
    path = cut(tmp_path, 20.0, "{move: head, to: 10°}", "{move: head, by: 20°}", "{wait: 30 s}")
    resumed(path)
    moved = [entry.data["angle_deg"] for entry in journal(path) if "angle_deg" in entry.data]
    assert moved[-1] == pytest.approx(30.0, abs=0.01)
    assert len(moved) == 3


@SLOW
def test_nothing_is_switched_on_for_a_teardown(tmp_path):
    teardown = "teardown: [{wait: 20 s}, {set: supply, output: off}]\n"
    found = cut(tmp_path, 15.0, ON, "{wait: 5 s}", tail=teardown + TAIL)
    resumed(found)
    assert [first_visit(step) for step in after(found)] == ["teardown/wait", "teardown/set"]


# What is refused


GROUP = "{group: order, restart_at: %s, steps: [{acquire: counter, for: 20 s, label: a}, {wait: 20 s}]}"


def test_a_group_with_a_restart_point_is_done_again_as_a_whole(tmp_path):
    path = cut(
        tmp_path,
        50.0,
        ON,
        "{acquire: counter, for: 10 s, label: first}",
        GROUP % "begin",
        "{wait: 5 s}",
        no_report=False,
    )
    assert ended(journal(path))["steps/order/acquire"] == 1
    result = resumed(path)
    assert result.outcome.how == "completed"
    assert after(path) == ["steps/set~2", "steps/order/acquire~2", "steps/order/wait~2", "steps/wait", "teardown/set"]
    (entry,) = (each for each in journal(path) if each.kind == "run_resumed")
    assert entry.data["restarted"] == ["steps/order"]
    page = (path / "report.html").read_text("utf-8")
    assert "Done again from its first step: steps/order." in page
    assert result.results is not None
    assert [(each.step, each.attempt, each.ended) for each in result.results.journal_records.superseded] == [
        ("steps/order/acquire", 1, True)
    ]


def test_a_group_with_a_restart_point_that_has_ended_is_passed_over(tmp_path):
    path = cut(tmp_path, 55.0, ON, GROUP % "begin", "{wait: 60 s}")
    resumed(path)
    assert after(path) == ["steps/set~2", "steps/order/wait~2", "steps/wait~2", "teardown/set"]


@SLOW
def test_a_group_that_was_begun_again_is_rebuilt_and_begun_again(tmp_path):
    path = cut(tmp_path, 40.0, ON, GROUP % "begin", "{wait: 5 s}")
    copy = tmp_path / "copy"
    shutil.copytree(path, copy)
    resumed(copy)
    begins = next(entry.at_s for entry in journal(copy) if entry.kind == "run_resumed")
    interrupted_again(path, begins + 30.0)
    assert resumed(path).outcome.how == "completed"
    assert ended(journal(path))["steps/order/acquire"] == 3
    assert after(path)[1:3] == ["steps/order/acquire~3", "steps/order/wait~3"]


def test_a_group_that_is_never_resumed_is_refused_with_its_name(tmp_path):
    path = cut(tmp_path, 40.0, ON, GROUP % "never", "{wait: 5 s}")
    with pytest.raises(InputError, match="steps/order was under way, and must not be repeated; start a new run"):
        resumed(path)


@pytest.fixture(scope="module")
def left(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that nobody resumes."""
    folder = tmp_path_factory.mktemp("left")
    copy_bench(folder / "config")
    return interrupted(folder / "runs", 30.0, "smoke", folder / "config" / "simulated.yaml")


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        resumed(path)
    return "\n".join(caught.value.problems)


def test_a_bench_file_that_was_changed_is_named(left):
    bench = left.parents[1] / "config" / "simulated.yaml"
    text = bench.read_text("utf-8")
    bench.write_text(text.replace("rate: 20 °/s", "rate: 19 °/s"), "utf-8")
    assert "bench.yaml has changed since the run began" in refusal(left)
    bench.write_text(text, "utf-8")


def test_a_run_under_way_is_not_resumed(left):
    directory = RunDirectory.reopen(left)
    try:
        assert "this one is running" in refusal(left)
        with pytest.raises(InputError, match="under way in another process"):
            RunDirectory.reopen(left)
    finally:
        directory.release()


def test_a_run_that_has_ended_is_not_resumed(undisturbed):
    assert "only an interrupted run is resumed; this one is completed" in refusal(undisturbed)


def test_another_program_does_not_resume_it(left, monkeypatch):
    monkeypatch.setattr("bench.app.resume._version", lambda: "0.0.1")
    assert "this is 0.0.1" in refusal(left)


def test_without_a_yes_nothing_is_done(left, capsys):
    before = journal(left)
    assert main(["resume", str(left)]) == 2
    shown = capsys.readouterr().err
    assert "Under way, and to be done again: steps/temperature=20/position=90/acquire" in shown
    assert "confirm it with --interrupted" in shown
    assert journal(left) == before


def test_altered_rows_are_not_built_upon(tmp_path):
    path = interrupted(tmp_path, 30.0, "smoke", BENCH)
    with closing(sqlite3.connect(path / "run.db")) as database, database:
        database.execute("UPDATE journal SET at_s = at_s + 1 WHERE seq = 5")
    assert "It is not resumed" in refusal(path)


@SLOW
def test_a_world_that_goes_otherwise_is_noticed(tmp_path, monkeypatch):
    path = interrupted(tmp_path, 50.0, "smoke", BENCH)
    monkeypatch.setattr("bench.engine.actions.came_from", lambda *_: "above")
    quiet = Quiet()
    with pytest.raises(InputError, match="its simulated bench cannot be rebuilt"):
        resumed(path, quiet)
    assert [entry.kind for entry in journal(path)].count("run_resumed") == 0


# Simulated faults go on


def faults_of(path: Path) -> list[tuple[str, str]]:
    """Each fault that began or ended, in the order of the journal."""
    return [(entry.kind, entry.data["fault"]) for entry in journal(path) if entry.kind.startswith("fault_")]


def scenario(folder: Path, *faults: str) -> Path:
    path = folder / "faults.yaml"
    lines = "\n".join(f"  - {fault}" for fault in faults)
    path.write_text(f"schema: itb-scenario/1\ntitle: Test\nfaults:\n{lines}\n", "utf-8")
    return path


ACQUIRE = "{acquire: counter, for: 10 s, label: a}"


def test_faults_of_a_scenario_go_on_in_a_resumed_run(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text(steps(ON, "{wait: 8 s}", "{wait: 20 s}", ACQUIRE, "{wait: 2 s}") + OFF + TAIL, "utf-8")
    faults = scenario(
        tmp_path,
        "{at: 5 s, device: chamber, fault: silent, for: 1 s}",
        "{at: 40 s, device: chamber, fault: delay, for: 5 s}",
        "{after: steps/acquire, at: 1 s, device: head, fault: half_open, for: 500 ms}",
    )
    found = interrupted(tmp_path / "runs", 15.0, path, BENCH, scenario=str(faults))
    assert faults_of(found) == [("fault_begins", "silent"), ("fault_ends", "silent")]
    result = resumed(found)
    assert (result.outcome.how, result.outcome.problems) == ("completed", [])
    assert faults_of(found) == [
        (kind, fault) for fault in ("silent", "delay", "half_open") for kind in ("fault_begins", "fault_ends")
    ]
    during = [entry.data["since_s"] for entry in journal(found) if "since_s" in entry.data]
    assert during == [40.0, 45.0]  # both while the run was interrupted
    assert examine(found).damage == ()


def test_a_fault_that_lasts_through_an_interruption_is_there_after_it(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text(steps("{wait: 20 s}", ON, "{wait: 1 s}") + OFF + TAIL, "utf-8")
    faults = scenario(tmp_path, "{at: 30 s, device: supply, fault: silent}")
    found = interrupted(tmp_path / "runs", 15.0, path, BENCH, scenario=str(faults))
    result = resumed(found)
    assert result.outcome.how == "error"
    assert "supply" in result.problems[0]


@SLOW
def test_drawn_faults_of_a_rehearsal_are_drawn_again(tmp_path):
    prepared = prepare(RunRequest("smoke", bench=str(BENCH), runs=tmp_path))
    twice = [with_drawn_faults(prepared, 5).loaded.bench.simulation.faults for _ in range(2)]
    found = interrupted(tmp_path / "runs", 8.0, "smoke", BENCH, rehearsed=5)
    again = prepare_again(read_interrupted(found))
    assert [again.loaded.bench.simulation.faults] * 2 == twice
