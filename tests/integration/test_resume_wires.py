"""A run over real wires that is killed, made safe by its guardian, and goes on in another process."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from bench.store.energised import energised
from bench.store.verify import examine
from tests.support.energised import SAFE, Process, Wires, wires
from tests.support.guardians import guardian_of, has_ended, has_made_safe, until
from tests.support.killed import ended, journal
from tests.support.runs import ROOT

pytestmark = pytest.mark.integration
SAFE_WITHIN_S = 20.0


@pytest.fixture(scope="module")
def bench(tmp_path_factory) -> Iterator[Wires]:
    with wires(tmp_path_factory.mktemp("served")) as served:
        yield served


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def killed(bench: Wires, folder: Path, step: str = "steps/wait") -> Process:
    """A run that was killed in a step, and whose guardian has made the bench safe."""
    run = Process(bench.bench, folder, "--set", "time=4 s")
    run.until_step(step)
    guardian = guardian_of(run.process.pid)
    run.process.kill()
    run.process.wait(5)
    until(lambda: has_made_safe(run.path) or has_ended(guardian), SAFE_WITHIN_S, lambda: run.told.read_text("utf-8"))
    return run


def bench_command(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "bench", *words], capture_output=True, text=True, cwd=ROOT, check=False,
        stdin=subprocess.DEVNULL,
    )  # fmt: skip


def test_a_killed_run_goes_on_and_ends_safe(bench, tmp_path):
    run = killed(bench, tmp_path)
    path = run.path
    assert path is not None
    assert bench.state() == SAFE
    latched = bench_command("resume", str(path), "--interrupted")
    assert latched.returncode == 2
    assert "is latched: its guardian made the bench safe: the process of the run has died" in latched.stderr
    assert bench_command("acknowledge", str(path), "--reason", "killed for a test").returncode == 0
    refused = bench_command("resume", str(path))
    assert refused.returncode == 2
    assert "confirm it with --interrupted" in refused.stderr
    done = bench_command("resume", str(path), "--interrupted")
    assert done.returncode in (0, 5), done.stderr  # one supply reading is judged
    assert bench.state() == SAFE
    entries = journal(path)
    at_s = [entry.at_s for entry in entries]
    assert at_s == sorted(at_s)
    again = next(entry for entry in entries if entry.kind == "run_resumed")
    assert again.data["boot"] == entries[0].data["boot"] != ""
    assert 0 < again.data["outage_s"] < 120
    assert [step for step, count in ended(entries).items() if count > 1] == [
        "setup/ramp", "setup/set", "setup/set#2", "setup/wait",
    ]  # fmt: skip
    assert ended(entries)["steps/measure"] == 1
    assert examine(path).damage == ()
    assert list(energised(lambda _: None)) == []


def test_a_bench_that_nobody_has_made_safe_is_made_safe_first(bench, tmp_path):
    run = Process(bench.bench, tmp_path, "--set", "time=8 s")
    run.until_step("steps/wait")
    os.kill(guardian_of(run.process.pid), signal.SIGKILL)
    run.process.kill()  # both at once, as when the computer loses its power
    run.process.wait(5)
    path = run.path
    assert path is not None
    refused = bench_command("resume", str(path), "--interrupted")
    assert refused.returncode == 2
    assert "may still be energised. Make the bench safe first: bench make-safe" in refused.stderr
    with contextlib.suppress(ProcessLookupError):
        assert bench_command("make-safe", "--bench", str(bench.bench), "--if-left-on").returncode == 0
    assert bench.state() == SAFE
    assert bench_command("resume", str(path), "--interrupted").returncode in (0, 5)
    assert bench.state() == SAFE


AFTER_A_START = """
import sys
import bench.app.beginning, bench.app.pending
bench.app.pending.boot_id = bench.app.beginning.boot_id = lambda: "another-boot"
from bench.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


def after_a_start(*words: str) -> subprocess.CompletedProcess[str]:
    """The command line on a computer that has started again."""
    return subprocess.run(
        [sys.executable, "-c", AFTER_A_START, *words], capture_output=True, text=True, cwd=ROOT, check=False,
        stdin=subprocess.DEVNULL,
    )  # fmt: skip


def test_after_a_start_of_the_computer_a_run_goes_on_as_its_bench_file_allows(bench, tmp_path):
    file = bench.edited(tmp_path / "own", "none", lambda line: line)
    file.write_text(file.read_text("utf-8") + "resume: {attempts: 1, within: 10 min}\n", "utf-8")
    run = Process(file, tmp_path, "--set", "time=6 s")
    run.until_step("steps/wait")
    os.kill(guardian_of(run.process.pid), signal.SIGKILL)
    run.process.kill()
    run.process.wait(5)
    assert run.path is not None
    runs = str(run.runs)
    same = bench_command("resume", "--pending", "--runs", runs)
    assert same.returncode == 0
    assert "not lost by it; a person decides" in same.stderr
    done = after_a_start("resume", "--pending", "--runs", runs)
    assert done.returncode in (0, 5), done.stderr
    assert "resumed after the start of this computer" in done.stderr
    assert bench.state() == SAFE
    boots = [entry.data["boot"] for entry in journal(run.path) if "boot" in entry.data]
    assert boots[1:] == ["another-boot"]
    assert ended(journal(run.path))["steps/measure"] == 1
    assert list(energised(lambda _: None)) == []
    assert after_a_start("resume", "--pending", "--runs", runs).returncode == 0  # none is left
