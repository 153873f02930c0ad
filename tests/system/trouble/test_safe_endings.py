"""Whatever ends a run, and whenever: the bench is made safe in bounded time, and the record tells how it ended."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import json
import os
import signal
from pathlib import Path

import pytest

from bench.app import finish, truth
from bench.app.execute import execute
from bench.app.request import RunRequest, prepare
from bench.cli.exits import of_run
from bench.config.bench import load_bench
from bench.engine import stepper
from bench.report.revision import examined
from bench.rig import OPEN_S
from bench.runner import run as runner
from bench.runner.quiet import Quiet
from bench.runner.signals import TEXTS
from bench.store.reader import RunReader
from bench.store.unsafe import read_unsafe
from bench.store.user_state import state_folder
from bench.store.writer import RunWriter
from tests.support.engines import run_plan
from tests.support.runs import ROOT, copy_bench, read_json, run_short
from tests.support.sequences import BENCH, plan_of, steps

OFF = "teardown: [wait: 1 s]\n"


@pytest.fixture(autouse=True)
def _no_signal_is_ignored():
    """As on a terminal: what a script starts in the background ignores SIGINT and SIGQUIT."""
    ignored = [number for number in TEXTS if signal.getsignal(number) is signal.SIG_IGN]
    for number in ignored:
        signal.signal(number, signal.SIG_DFL)
    yield
    for number in ignored:
        signal.signal(number, signal.SIG_IGN)


class Sends(Quiet):
    """Sends signals to this process when a step begins, or `opening`."""

    def __init__(self, at: str, *numbers: signal.Signals) -> None:
        super().__init__()
        self._at, self._numbers = at, numbers

    def run_begins(self, *_: object) -> None:
        self._send("opening")

    def step_begins(self, planned, index) -> None:
        self._send(planned.id)

    def _send(self, where: str) -> None:
        if self._at in where:
            numbers, self._numbers = self._numbers, ()
            for number in numbers:
                os.kill(os.getpid(), number)


def smoke(tmp_path, observer, bench=ROOT / "config/simulated.yaml", *, sequence="smoke", no_report=True, **wishes):
    request = RunRequest(sequence, bench=str(bench), runs=tmp_path / "runs", no_report=no_report, **wishes)
    return execute(prepare(request), observer)


def events(result, *kinds):
    with RunReader(result.path) as reader:
        return list(reader.events(*kinds))


def ended_by(result):
    manifest = read_json(result, "manifest.json")
    return manifest["state"], manifest["verdict"], manifest["ended_by"]


@pytest.mark.parametrize("at", ["opening", "setup/", "/soak", "teardown/"])
@pytest.mark.parametrize("number", TEXTS)
def test_every_signal_in_every_phase_leaves_the_bench_safe_and_is_recorded(tmp_path, at, number):
    result = smoke(tmp_path, Sends(at, number))
    by, text = TEXTS[number]
    assert (of_run(result), *ended_by(result)) == (4, "aborted", "ABORTED", by)
    assert result.problems == [text]
    assert [event.data["unsafe"] for event in events(result, "made_safe")] == [{}]
    torn_down = [event.step for event in events(result, "step_ended") if event.step.startswith("teardown/")]
    assert len(torn_down) == (2 if number is signal.SIGINT and at in ("setup/", "/soak") else 0)


def test_a_signal_while_instruments_are_opened_ends_the_opening(tmp_path, monkeypatch):
    each = runner.Rig._each

    async def disturbed(self, act, limit_s):
        if not self.identities and limit_s == OPEN_S:
            os.kill(os.getpid(), signal.SIGTERM)
            await asyncio.sleep(5)
        return await each(self, act, limit_s)

    monkeypatch.setattr(runner.Rig, "_each", disturbed)
    result = smoke(tmp_path, Quiet())
    assert (of_run(result), *ended_by(result)) == (4, "aborted", "ABORTED", "terminate")
    assert events(result, "identified") == []
    assert set(read_json(result, "manifest.json")["not_reached"]) >= {"chamber", "supply"}


def test_a_terminal_that_fails_before_the_first_device_ends_the_run_in_words(tmp_path):
    class Gone(Quiet):
        def run_begins(self, *_: object) -> None:
            raise OSError(errno.EIO, "Input/output error")

    result = smoke(tmp_path, Gone())
    assert (of_run(result), *ended_by(result)) == (3, "error", "ERROR", None)
    assert "Input/output error" in result.problems[0]


def test_signals_one_after_the_other_do_not_cut_the_making_safe(tmp_path, monkeypatch):
    make_safe = runner.Rig.make_safe

    async def disturbed(self, *arguments):
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            os.kill(os.getpid(), number)
            await asyncio.sleep(0.01)
        return await make_safe(self, *arguments)

    monkeypatch.setattr(runner.Rig, "make_safe", disturbed)
    result = smoke(tmp_path, Sends("/soak", signal.SIGTERM))
    assert (of_run(result), *ended_by(result)) == (4, "aborted", "ABORTED", "terminate")
    assert [event.data["unsafe"] for event in events(result, "made_safe")] == [{}]


@pytest.mark.parametrize(("module", "where"), [(truth, "truth_of"), (finish, "calibration_files")])
def test_a_signal_while_results_are_written_hides_nothing_and_drops_the_report(tmp_path, monkeypatch, module, where):
    write = getattr(module, where)

    def disturbed(*arguments):
        os.kill(os.getpid(), signal.SIGTERM)
        return write(*arguments)

    monkeypatch.setattr(module, where, disturbed)
    result = smoke(tmp_path, Quiet(), no_report=False)
    assert (of_run(result), *ended_by(result)) == (3, "completed", "PASS", None)
    assert read_json(result, "results.json")["verdict"] == "PASS"
    assert result.report is None
    assert not (result.path / "report.html").exists()
    assert "no report was written, because a signal arrived meanwhile (SIGTERM)" in result.problems[0]
    assert read_json(result, "manifest.json")["problems"] == result.problems
    assert examined(result.path).damage == ()


def test_a_signal_while_the_report_is_written_is_the_reason_in_the_manifest(tmp_path, monkeypatch):
    def disturbed(_):
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr("bench.report.write.write_report", disturbed)
    result = smoke(tmp_path, Quiet(), no_report=False)
    assert (of_run(result), *ended_by(result)) == (3, "completed", "PASS", None)
    assert "no report was written, because a signal arrived meanwhile (SIGINT)" in result.problems[0]
    assert read_json(result, "manifest.json")["problems"] == result.problems
    assert examined(result.path).damage == ()


def test_what_is_ignored_when_the_process_begins_stays_ignored(tmp_path):
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        result = smoke(tmp_path, Sends("/soak", signal.SIGHUP))
    finally:
        signal.signal(signal.SIGHUP, before)
    assert (of_run(result), *ended_by(result)) == (0, "completed", "PASS", None)


async def deaf(*_):
    while True:
        with contextlib.suppress(asyncio.CancelledError):
            await asyncio.sleep(600)


async def ends_as_if_nothing_was(*_):
    try:
        await asyncio.sleep(600)
    except asyncio.CancelledError:
        return {}


def when(at_s, act):
    async def script(engine):
        await asyncio.sleep(at_s)
        act(engine)

    return script


@pytest.mark.parametrize("act", ["stop", "abort"])
def test_a_step_that_does_not_end_is_left_behind(tmp_path, monkeypatch, act):
    monkeypatch.setattr(stepper, "perform", deaf)
    plan = plan_of(tmp_path, steps("wait: 1 h", "wait: 1 s"))
    ran = run_plan(tmp_path / "run", plan, BENCH, when(10, lambda engine: getattr(engine, act)()))
    assert ran.outcome.how == "aborted"
    assert ran.made_safe == {}
    assert ran.events[-1].at_s < 10 + 15 + 15
    assert "steps/wait has not ended within 19 s after it was cancelled" in ran.outcome.problems[1]
    assert ran.steps("step_begins") == ["steps/wait"]


def test_a_step_that_does_not_end_after_a_fault_is_left_behind_and_the_teardown_runs(tmp_path, monkeypatch):
    perform = stepper.perform
    monkeypatch.setattr(
        stepper, "perform", lambda step, name, bench: (deaf if "steps/" in name else perform)(step, name, bench)
    )
    plan = plan_of(tmp_path, steps("wait: 1 h") + OFF)
    faults = "[{device: supply, kind: silent, at: 10 s}]"
    bench = load_bench(copy_bench(tmp_path / "config", faults=faults)).bench
    ran = run_plan(tmp_path / "run", plan, bench)
    assert ran.outcome.how == "error"
    assert ran.steps() == ["teardown/wait"]
    assert set(ran.made_safe) == {"supply"}
    assert ran.events[-1].at_s < 60


@pytest.mark.parametrize("act", ["stop", "abort"])
def test_no_step_begins_after_one_that_ends_as_if_it_had_not_been_told_to(tmp_path, monkeypatch, act):
    monkeypatch.setattr(stepper, "perform", ends_as_if_nothing_was)
    plan = plan_of(tmp_path, steps("{group: g, steps: [wait: 1 h, wait: 2 h]}", "wait: 3 h"))
    ran = run_plan(tmp_path / "run", plan, BENCH, when(10, lambda engine: getattr(engine, act)()))
    assert ran.outcome.how == "aborted"
    assert ran.steps("step_begins") == ["steps/g/wait"]


def test_a_teardown_that_does_not_end_is_left_behind_by_an_abort(tmp_path, monkeypatch):
    plan = plan_of(tmp_path, steps("wait: 1 s") + OFF)

    async def script(engine):
        await asyncio.sleep(5)
        assert engine.in_teardown
        engine.abort()

    monkeypatch.setattr(
        stepper, "perform", lambda step, name, bench: deaf() if "teardown" in name else asyncio.sleep(0, {})
    )
    ran = run_plan(tmp_path / "run", plan, BENCH, script)
    assert (ran.outcome.how, ran.made_safe) == ("aborted", {})
    assert ran.events[-1].at_s < 40


SUPPLY_GONE = "[{device: supply, kind: silent, at: 30 s}]"


def test_what_is_not_safe_is_in_two_places_also_when_the_store_fails(tmp_path, monkeypatch):
    event = RunWriter.event

    def failing(self, kind, step="", **data):
        if kind == "fault":
            self._database.close()  # as if the disk had gone
        event(self, kind, step, **data)

    monkeypatch.setattr(RunWriter, "event", failing)
    observer = Quiet()
    bench = copy_bench(tmp_path / "config", faults=SUPPLY_GONE)
    result = smoke(tmp_path, observer, bench, settings=("soak=10 min",))
    assert of_run(result) == 6
    manifest = read_json(result, "manifest.json")
    assert "no answer" in manifest["unsafe"]["supply"]
    assert manifest["instruments"]["chamber"]["serial"] == "SIM-F4T-01"
    (notice,) = (text for text in observer.notices if text.startswith("What is not safe is recorded in "))
    record = Path(notice.rpartition(" ")[2])
    assert record.parent == state_folder() / "unsafe"
    kept = json.loads(record.read_text("utf-8"))
    assert kept["run"] == str(result.path)
    assert kept["unsafe"]["supply"]["connection"].startswith("sim+tcp://")
    assert any("the run store" in problem for problem in result.problems)


def test_what_is_not_safe_is_recorded_elsewhere_where_the_directory_takes_nothing(tmp_path, monkeypatch):
    def failing(*_):
        raise finish.StoreError("manifest.json: cannot be written")

    monkeypatch.setattr("bench.store.seal.write_both", failing)
    bench = copy_bench(tmp_path / "config", faults=SUPPLY_GONE)
    result = smoke(tmp_path, Quiet(), bench, settings=("soak=10 min",))
    assert of_run(result) == 6
    assert "manifest.json: cannot be written" in result.problems
    assert "no answer" in read_unsafe(result.path)["supply"]


def test_what_opened_is_made_safe_when_an_instrument_is_missing(tmp_path):
    bench, observer = copy_bench(tmp_path / "config", faults="[{device: supply, kind: silent, at: 0 s}]"), Quiet()
    trace = tmp_path / "bench.trace"
    result = smoke(tmp_path, observer, bench, trace=trace)
    assert of_run(result) == 3
    assert events(result, "step_begins") == []
    assert [event.data["unsafe"] for event in events(result, "made_safe")] == [{}]
    assert [event.data["device"] for event in events(result, "not_reached")] == ["supply"]
    assert list(read_json(result, "manifest.json")["not_reached"]) == ["supply"]
    assert any(text.startswith("No step was started. Made safe: chamber, head, ") for text in observer.notices)
    assert any(text.startswith("NOT REACHED, so nothing was sent: supply.") for text in observer.notices)
    passed = trace.read_text("utf-8").splitlines()
    assert {line.split(" > ")[1] for line in passed if " supply > " in line} == {'"*IDN?\\n"'}
    assert any("source > " in line and "OUTP" in line for line in passed)


def test_an_instrument_that_the_sequence_does_not_use_may_be_missing(tmp_path):
    observer = Quiet()
    bench = copy_bench(tmp_path / "config", faults="[{device: source, kind: silent, at: 0 s}]")
    result = smoke(tmp_path, observer, bench, no_report=False)
    assert of_run(result) == 0
    assert list(read_json(result, "manifest.json")["not_reached"]) == ["source"]
    assert any("The run does not use source and goes on without it." in text for text in observer.notices)
    assert "source" in (result.path / "report.html").read_text("utf-8")


def test_an_instrument_that_the_sequence_does_not_use_may_fail_and_is_made_safe_or_named(tmp_path):
    bench = copy_bench(tmp_path / "config", faults="[{device: source, kind: silent, at: 5 min}]")
    result = smoke(tmp_path, Quiet(), bench, settings=("soak=10 min",))
    assert of_run(result) == 6
    assert ended_by(result) == ("completed", "PASS", None)
    assert list(result.outcome.unsafe) == list(read_json(result, "manifest.json")["unsafe"]) == ["source"]
    (left_out,) = events(result, "device_left_out")
    assert left_out.data["device"] == "source"


@pytest.mark.parametrize("where", ["_Group", "RunWriter._write"])
def test_a_thread_of_the_store_that_dies_keeps_nobody_waiting(tmp_path, monkeypatch, where):
    def no_memory(*_):
        raise MemoryError

    monkeypatch.setattr(f"bench.store.writer.{where}", no_memory)
    monkeypatch.setattr("bench.loop.THREAD_ANSWER_LIMIT_S", 1.0)
    result = smoke(tmp_path, Quiet())
    assert of_run(result) == 3
    assert "the run store has stopped (MemoryError())" in result.problems[0]


def test_a_sequence_without_limits_is_not_judged(tmp_path, bench_here):
    path = tmp_path / "waits.yaml"
    path.write_text("schema: itb-sequence/1\ntitle: T\nneeds: {}\nsteps:\n  - wait: 1 s\n", "utf-8")
    result = smoke(tmp_path, Quiet(), sequence=str(path), no_report=False)
    assert (of_run(result), *ended_by(result)) == (5, "completed", "NOT JUDGED", None)
    page = (result.path / "report.html").read_text("utf-8")
    assert '<div class="verdict NOT-JUDGED">NOT JUDGED</div>' in page
    checked = bench_here("check", path)
    assert (checked.returncode, "nothing-judged" in checked.stderr) == (0, True)


def test_a_poll_that_the_making_safe_cuts_short_is_no_fault(tmp_path):
    path = tmp_path / "waits.yaml"
    path.write_text("schema: itb-sequence/1\ntitle: Waits\nneeds: {}\nsteps:\n  - wait: 100 s\n", "utf-8")
    run = run_short(tmp_path / "runs", sequence=str(path))
    assert run.problems == []
    with RunReader(run.path) as reader:
        kinds = [event.kind for event in reader.events()]
    assert "made_safe" in kinds
    assert not {"fault", "device_left_out"} & set(kinds)
