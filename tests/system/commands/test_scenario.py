"""Faults of a scenario in whole runs: each at its time, for as long as it says, and told in journal and report."""

from __future__ import annotations

import pytest

from bench.app.faults import FaultPlayer
from bench.app.laboratory import make_laboratory, unit_files
from bench.config.bench import load_bench
from bench.config.scenario import ScriptedFault
from bench.reduce.stored_run import open_run
from bench.report.write import write_report
from bench.store.reader import RunReader
from tests.support.runs import ROOT, run_short

LONG = ("soak=60 min",)


def run_with(tmp_path, *faults, settings=LONG, **options):
    path = tmp_path / "scenario.yaml"
    head = "schema: itb-scenario/1\ntitle: A test\nfaults:\n"
    path.write_text(head + "".join(f"  - {fault}\n" for fault in faults), "utf-8")
    result = run_short(tmp_path / "runs", sequence="smoke", settings=settings, scenario=path, **options)
    with RunReader(result.path) as reader:
        events = list(reader.events("fault_begins", "fault_ends", "device_note", "step_failed"))
    return result, [(event.kind, event.at_s, event.data) for event in events]


def of(events, *kinds):
    return [(kind, round(at_s), data["victim"], data["fault"]) for kind, at_s, data in events if kind in kinds]


FAULT = ("fault_begins", "fault_ends")


def test_a_silence_that_ends_is_borne_and_told(tmp_path):
    result, events = run_with(tmp_path, "{at: 20 min, device: chamber, fault: silent, for: 4 s}")
    assert (result.outcome.how, result.problems) == ("completed", [])
    assert of(events, *FAULT) == [
        ("fault_begins", 1200, "chamber", "silent"), ("fault_ends", 1204, "chamber", "silent"),
    ]  # fmt: skip
    (note,) = [data["text"] for kind, _, data in events if kind == "device_note"]
    assert note.startswith("asked again: chamber: no answer within 3 s")
    assert (result.path / "scenario.yaml").read_text("utf-8").startswith("schema: itb-scenario/1")
    with open_run(result.path) as stored:
        page = write_report(stored).read_text("utf-8")
    assert "Fault injected, 20 min after the start: chamber silent." in page
    assert "Injected fault removed, 20 min after the start: chamber silent." in page


def test_without_an_end_it_lasts(tmp_path):
    result, events = run_with(tmp_path, "{at: 20 min, device: chamber, fault: silent}")
    assert result.outcome.how == "error"
    assert "chamber: no answer within 3 s" in result.problems[0]
    assert set(result.outcome.unsafe) == {"chamber"}
    assert of(events, *FAULT) == [("fault_begins", 1200, "chamber", "silent")]


def test_after_a_step_the_time_counts_from_its_end(tmp_path):
    step = "steps/temperature=20/position=0/acquire"
    result, events = run_with(tmp_path, f"{{after: {step}, at: 1 s, device: head, fault: emergency_stop}}", settings=())
    with RunReader(result.path) as reader:
        (ended_s,) = [event.at_s for event in reader.events("step_ended") if event.step == step]
    ((_, began_s, _),) = [event for event in events if event[0] == "fault_begins"]
    assert began_s == pytest.approx(ended_s + 1.0, abs=1e-3)
    assert result.outcome.how == "error"
    assert "head: axis X has a fault: emergency stop" in result.problems[0]
    assert result.outcome.unsafe == {}


def test_a_step_that_is_done_again_brings_its_faults_once():
    reported = []
    bench = load_bench(ROOT / "config/simulated.yaml").bench
    fault = ScriptedFault.model_validate({"after": "steps/move", "device": "head", "fault": "stuck"})
    laboratory = make_laboratory(bench, unit_files(bench, None), 1, lambda: 0.0)
    player = FaultPlayer(laboratory, [fault], lambda kind, each: reported.append((kind, each.kind)))
    player.step_ended("steps/other")
    assert reported == []
    for step in ("steps/move~2", "steps/move~3"):
        player.step_ended(step)
    assert reported == [("fault_begins", "stuck")]


@pytest.mark.parametrize(
    ("fault", "how", "reported"),
    [
        ("delay", "completed", ""),
        ("split", "completed", ""),
        ("duplicate", "error", "supply: more than one line was received"),
        ("flip", "error", "supply: "),
        ("cut_short", "error", "supply: "),
    ],
)
def test_what_a_line_does_to_answers_is_borne_or_told(tmp_path, fault, how, reported):
    result, _ = run_with(tmp_path, f"{{at: 20 min, device: supply, fault: {fault}, for: 11 s}}")
    assert result.outcome.how == how, result.problems
    assert "".join(result.problems[:1]).startswith(reported)


def test_units_break_too_and_a_bench_file_says_it_by_its_own_key(tmp_path):
    _, events = run_with(tmp_path, "{at: 5 s, unit: a, fault: current, for: 5 s}", settings=())
    assert of(events, *FAULT)[0] == ("fault_begins", 5, "unit a", "current")
