"""Units of systemd keep from a run nothing that it needs: system calls, and what it reads about its computer."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

import pytest

from tests.support.guardians import guardian_of
from tests.support.runs import ROOT
from tests.support.served import on_real_wires, simulating

UNITS = sorted((ROOT / "config/services").glob("*.service"))
HARMLESS = {"mbind", "set_mempolicy", "sched_setaffinity"}  # a library for arithmetic tries them, and does without
AS_ROOT = {"fchown", "chown"}  # SQLite, if the user is root; that of a unit is not
pytestmark = pytest.mark.integration


def settings(unit, key):
    return re.findall(rf"^{key}=(.*)$", unit.read_text("utf-8"), re.MULTILINE)


def system_calls(*names):
    """System calls of sets such as @privileged, with the sets that these contain."""
    shown = subprocess.run(["systemd-analyze", "syscall-filter", *names], capture_output=True, text=True, check=True)
    words = {line.strip() for line in shown.stdout.splitlines()[1:] if line.strip() and "#" not in line}
    inner = {word for word in words if word.startswith("@")} - set(names)
    return (words - inner - set(names)) | (system_calls(*inner) if inner else set())


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_a_refused_system_call_is_an_error_and_not_the_end_of_the_process(unit):
    assert settings(unit, "SystemCallFilter") == ["@system-service", "~@privileged @resources"]
    assert settings(unit, "SystemCallErrorNumber") == ["EPERM"]


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_a_run_can_read_which_start_of_the_computer_it_is(unit):
    assert settings(unit, "ProcSubset") == []  # with pid there is no /proc/sys, and no interrupted run would go on


@pytest.mark.slow
@pytest.mark.peer("strace")
@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
def test_a_run_and_its_guardian_use_no_system_call_that_their_unit_refuses(tmp_path):
    refused = system_calls("@privileged", "@resources")
    allowed = system_calls("@system-service", "@default") - refused
    assert {"mbind", "chown"} <= refused
    assert {"openat", "execve", "socket"} <= allowed
    used_file, inject = tmp_path / "used", ",".join(f"?{name}" for name in sorted(refused))
    strace = ["strace", "-f", "-qq", "-e", "signal=none", "-e", f"inject={inject}:error=EPERM", "-o", str(used_file)]
    bench = on_real_wires(tmp_path)
    with simulating(bench), subprocess.Popen(
        [*strace, sys.executable, "-m", "bench", "run", "smoke", "--bench", str(bench), "--uut", "a=QF-1"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path, start_new_session=True,
    ) as run:  # fmt: skip
        try:
            until(run, "about")
            (process,) = children(run.pid)
            guardian_in_time(process)
            os.kill(process, signal.SIGTERM)
            until(run, "report")
            end_guardians(tmp_path)  # one may follow the chamber, for minutes
            said = run.communicate(timeout=60)
        finally:
            with suppress(ProcessLookupError):
                os.killpg(run.pid, signal.SIGKILL)
            end_guardians(tmp_path)
    assert run.returncode == 4, said  # ended by another program, and the bench is safe
    used = set(re.findall(r"^\d+ +(\w+)\(", used_file.read_text("utf-8", errors="replace"), re.MULTILINE))
    assert len(used) > 50
    assert used - allowed <= HARMLESS | AS_ROOT


def guardian_in_time(process):
    for _ in range(200):
        with suppress(ValueError):
            return guardian_of(process)
        threading.Event().wait(0.1)
    raise AssertionError("the run has no guardian")


def end_guardians(folder):
    """End the guardians of runs in a folder, which the words of their processes name."""
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            words = (process / "cmdline").read_bytes()
            if b"bench.guardian" in words and f"{folder}/runs/".encode() in words:
                os.kill(int(process.name), signal.SIGKILL)


def until(process, word):
    """Read the messages of a process up to a line with a word."""
    while word not in (line := process.stderr.readline()):
        assert line, process.communicate()


def children(process):
    shown = subprocess.run(["ps", "-o", "pid=", "--ppid", str(process)], capture_output=True, text=True, check=True)
    return list(map(int, shown.stdout.split()))
