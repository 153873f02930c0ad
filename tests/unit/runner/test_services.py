"""Units for systemd, and what a run tells it over its socket."""

from __future__ import annotations

import os
import re
import shutil
import socket
import subprocess
import uuid
from pathlib import Path

import pytest

from bench.app.service import Service
from bench.lanes import longest_lane_s
from bench.rig import OWN_LIMIT_S
from bench.runner.notify import VARIABLE, notify
from bench.runner.quiet import Quiet
from bench.store.machine_state import FOLDERS, STANDARD, problem_to_write
from bench.store.machine_state import VARIABLE as MACHINE
from drivers.safe_state import LONGEST_S
from tests.support.runs import ROOT
from tests.support.sequences import plan_of, steps

UNIT = ROOT / "config" / "services" / "bench-run@.service"
needs_systemd = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")


INSTANCES = ("bench-run@night.service", "bench-resume.service", "bench-station.service", "bench-item@0a1b-1.service")


@pytest.fixture(params=INSTANCES)
def unit(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    """A unit, with a program that is there."""
    path = tmp_path / request.param
    text = (UNIT.parent / re.sub("@.*[.]", "@.", path.name)).read_text("utf-8")
    path.write_text(text.replace("/opt/inertial-test-bench/bin/bench", "/bin/true"), "utf-8")
    return path


@needs_systemd
@pytest.mark.integration
def test_the_unit_is_valid(unit: Path) -> None:
    done = subprocess.run(["systemd-analyze", "verify", str(unit)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@needs_systemd
@pytest.mark.integration
def test_the_unit_is_exposed_to_little(unit: Path) -> None:
    done = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", "--threshold=20", str(unit)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout[-300:]


@pytest.mark.integration
@pytest.mark.skipif(shutil.which("systemd-tmpfiles") is None or os.geteuid() != 0, reason="needs root and systemd")
def test_the_folder_of_all_users_is_made_for_their_group(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "etc").mkdir()
    (tmp_path / "etc" / "passwd").write_text("bench:x:47110:47110::/:/bin/false\n", "utf-8")
    (tmp_path / "etc" / "group").write_text("bench:x:47110:\n", "utf-8")
    text = (UNIT.parent / "bench.tmpfiles.conf").read_text("utf-8")
    command = ["systemd-tmpfiles", f"--root={tmp_path}", "--create", "-"]
    done = subprocess.run(command, input=text, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    machine = tmp_path / STANDARD.lstrip("/")
    for path in (machine, *(machine / name for name in FOLDERS)):
        assert (path.stat().st_mode & 0o7777, path.stat().st_gid) == (0o2770, 47110)
    monkeypatch.setenv(MACHINE, str(machine))
    assert problem_to_write() == ""


def test_a_stop_leaves_time_to_make_the_bench_safe_twice() -> None:
    (line,) = (line for line in UNIT.read_text("utf-8").splitlines() if line.startswith("TimeoutStopSec="))
    longest_s = longest_lane_s({"table": LONGEST_S + OWN_LIMIT_S})
    assert int(line.partition("=")[2]) > 2 * longest_s  # by the guardian, and by make-safe after it


ITEM = f"bench-item@{'0a' * 16}-1.service"
ASKED = """
const asked = [], polkit = {Result: {YES: "yes", NOT_HANDLED: "no"}, addRule: rule => asked.push(rule)};
RULES
const [id, user, group, unit, verb] = process.argv.slice(1);
const subject = {user, isInGroup: name => name === group};
console.log(asked[0]({id, lookup: name => ({unit, verb})[name]}, subject));
"""


@pytest.mark.skipif(shutil.which("node") is None, reason="node, which reads the rules of polkit, is not installed")
@pytest.mark.parametrize(
    ("user", "group", "unit", "verb", "answer"),
    [
        ("bench", "bench", ITEM, "start", "yes"),
        ("bench", "bench", ITEM, "stop", "yes"),
        ("bench", "bench", ITEM, "restart", "no"),
        ("anna", "bench", ITEM, "start", "no"),
        ("anna", "bench", "bench-run@night.service", "start", "yes"),
        ("anna", "users", "bench-run@night.service", "start", "no"),
        ("bench", "bench", "bench-station.service", "stop", "no"),
        ("bench", "bench", f"{ITEM}.ssh.service", "start", "no"),
        ("bench", "bench", f"x-{ITEM}", "start", "no"),
        ("bench", "bench", "bench-item@../x-1.service", "start", "no"),
    ],
)
def test_polkit_lets_a_group_start_runs_and_the_station_its_items(
    user: str, group: str, unit: str, verb: str, answer: str
) -> None:
    script = ASKED.replace("RULES", (UNIT.parent / "50-bench.rules").read_text("utf-8"))
    words = ["node", "-e", script, "org.freedesktop.systemd1.manage-units", user, group, unit, verb]
    assert subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip() == answer


def test_an_item_of_the_queue_has_a_name_that_polkit_knows() -> None:
    pattern = re.search(r"/\^(bench-item@.*)\$/", (UNIT.parent / "50-bench.rules").read_text("utf-8"))
    assert pattern is not None
    assert re.fullmatch(pattern[1], f"bench-item@{uuid.uuid4().hex}-12.service")  # as Queue.submit makes them


@pytest.mark.parametrize("kind", ["path", "abstract"])
def test_a_run_tells_its_service_manager(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name = str(tmp_path / "notify") if kind == "path" else f"@inertial-test-bench-{tmp_path.name}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(f"\0{name[1:]}" if kind == "abstract" else name)
        manager.settimeout(5)
        monkeypatch.setenv(VARIABLE, name)
        (planned,) = plan_of(tmp_path, steps("{wait: 1 s}"))
        Service(Quiet()).step_begins(planned, 0)
        notify("READY=1", "STATUS=two\nlines")
        assert manager.recv(1000) == b"STATUS=step 1: steps/wait"
        assert manager.recv(1000) == b"READY=1\nSTATUS=two lines"


@pytest.mark.parametrize("name", ["", "relative", "/no/such/socket", "@nobody-listens-here"])
def test_without_a_manager_nothing_is_told(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, name)
    notify("READY=1")
