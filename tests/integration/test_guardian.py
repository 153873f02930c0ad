"""The guardian of a run, on real processes and wires; a client that is no part of the program reads the instruments."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from bench.app.execute import execute
from bench.app.request import RunRequest, prepare
from bench.guardian.notes import SHOWN_WITHIN_S, WRITTEN_WITHIN_S
from bench.guardian.watch import LEASE_S
from bench.runner import guard
from bench.runner.quiet import Quiet
from bench.runner.tell import send_command
from bench.store.reader import RunReader
from tests.support.energised import SAFE, SEQUENCE, Process, Wires, wires
from tests.support.guardians import guardian_of, has_ended, has_made_safe, until

pytestmark = pytest.mark.integration
WITHIN_S = 8.0


@pytest.fixture(scope="module")
def bench(tmp_path_factory) -> Iterator[Wires]:
    with wires(tmp_path_factory.mktemp("served")) as served:
        yield served


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state/inertial-test-bench"


def running(bench: Wires, folder: Path, step: str = "steps/wait") -> tuple[Process, int]:
    run = Process(bench.bench, folder)
    run.until_step(step)
    return run, guardian_of(run.process.pid)


def rescued(run: Process, guardian: int, within_s: float) -> list[dict]:
    """The incident of a run that was killed, once its guardian has made the bench safe."""
    until(lambda: has_made_safe(run.path) or has_ended(guardian), within_s, lambda: run.told.read_text("utf-8"))
    assert run.path is not None
    return [json.loads(line) for line in (run.path / "incident.jsonl").read_text("utf-8").splitlines()]


@pytest.mark.parametrize("step", ["setup/wait", "steps/wait"])
def test_a_run_that_is_killed_leaves_a_safe_bench(bench, tmp_path, state, step):
    run, guardian = running(bench, tmp_path, step)
    assert json.loads(send_command(run.path, "status"))["guardian"] == "ok"
    run.process.kill()
    run.process.wait(5)
    incident = rescued(run, guardian, WITHIN_S)
    assert bench.state() == SAFE
    assert incident[0]["why"] == "the process of the run has died"
    assert {each["role"]: each["state"] for each in incident if each["event"] == "lane"} == dict.fromkeys(
        ("chamber", "head", "supply", "source"), "safe"
    )
    assert incident[-1] | {"event": "ends", "unsafe": {}} == incident[-1]
    until(lambda: "the bench is safe" in run.told.read_text("utf-8"), SHOWN_WITHIN_S)
    until(lambda: not list((state / "energised").iterdir()), WRITTEN_WITHIN_S)
    assert (state / "incident.jsonl").read_text("utf-8").count("\n") == len(incident)


def test_a_run_that_stands_still_is_killed_and_never_writes_again(bench, tmp_path):
    run, guardian = running(bench, tmp_path)
    os.kill(run.process.pid, signal.SIGSTOP)
    incident = rescued(run, guardian, LEASE_S + WITHIN_S)
    assert bench.state() == SAFE
    assert "did not respond" in incident[0]["why"]
    with contextlib.suppress(ProcessLookupError):
        os.kill(run.process.pid, signal.SIGCONT)
    assert run.process.wait(5) == -signal.SIGKILL
    assert bench.state() == SAFE


def test_a_run_that_loses_its_guardian_ends_safe(bench, tmp_path):
    run, guardian = running(bench, tmp_path)
    os.kill(guardian, signal.SIGKILL)
    assert run.code() == 4
    assert bench.state() == SAFE
    assert run.manifest()["ended_by"] == "guardian"


def test_a_guardian_is_not_ended_by_signals_and_ends_with_its_run(bench, tmp_path):
    run, guardian = running(bench, tmp_path)
    for number in (signal.SIGHUP, signal.SIGINT, signal.SIGTERM, signal.SIGQUIT):
        os.kill(guardian, number)
    assert os.getsid(guardian) == guardian
    own, of_guardian, of_run = (
        int(Path(f"/proc/{each}/oom_score_adj").read_text("ascii")) for each in ("self", guardian, run.process.pid)
    )
    assert (of_guardian, of_run) == (own, own + 500)
    lines = dict(line.split(":", 1) for line in Path(f"/proc/{guardian}/status").read_text("ascii").splitlines())
    assert int(lines["VmRSS"].split()[0]) < 80 * 1024
    run.send(signal.SIGTERM)
    assert run.code() == 4
    assert has_ended(guardian)


def test_a_terminal_that_nobody_reads_holds_no_rescue_up(bench, tmp_path):
    reads, writes = os.pipe()
    os.set_blocking(writes, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(writes, b"full")
    os.set_blocking(writes, True)
    run = Process(bench.bench, tmp_path, stderr=writes)
    run.until_step("steps/wait")
    guardian = guardian_of(run.process.pid)
    run.process.kill()
    run.process.wait(5)
    until(lambda: has_made_safe(run.path) or has_ended(guardian), WITHIN_S + WRITTEN_WITHIN_S)
    assert bench.state() == SAFE
    os.close(reads)
    os.close(writes)


def test_files_in_the_current_directory_are_not_taken_for_the_program(bench, tmp_path):
    here = tmp_path / "here"
    (here / "bench").mkdir(parents=True)
    for name in ("bench/__init__.py", "asyncio.py", "select.py"):
        (here / name).write_text("raise SystemExit('taken from the current directory')\n", "utf-8")
    command = str(Path(sys.executable).with_name("bench"))
    run = Process(bench.bench, tmp_path, "--set", "time=1 s", cwd=here, program=[command])
    assert run.code() == 0, run.told.read_text("utf-8")


def test_without_a_guardian_nothing_is_energised(bench, tmp_path, monkeypatch):
    monkeypatch.setattr(guard, "PROGRAM", "raise SystemExit(3)")
    sequence = tmp_path / "energised.yaml"
    sequence.write_text(SEQUENCE, "utf-8")
    options = RunRequest(str(sequence), bench=str(bench.bench), runs=tmp_path / "runs", units=("QF-0001",))
    before = bench.state()
    result = execute(prepare(options), Quiet())
    assert result.outcome.how == "error"
    (problem,) = result.problems
    assert "guardian of the run could not be started (it has ended). Nothing was energised" in problem
    with RunReader(result.path) as reader:
        kinds = {event.kind for event in reader.events()}
    assert kinds == {"run_begins"}
    assert bench.state() == before
