"""Commands to a run that is under way, from another process, over its control socket."""

from __future__ import annotations

import json
import os
import pty
import pwd
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from bench.errors import InputError
from bench.runner.control import socket_address
from bench.runner.tell import send_command
from bench.store.reader import RunReader
from tests.support.runs import ROOT

pytestmark = [pytest.mark.integration, pytest.mark.slow]
PACED = ("smoke", "--speed", "20", "--set", "soak=1 min", "--set", "gate=40 s")


class Running:
    """`bench run` as a process, found again by its run directory."""

    def __init__(self, runs: Path, *arguments: str, bench: str = "simulated", stdin: int | None = None) -> None:
        self.runs = runs
        self.process = subprocess.Popen(
            [sys.executable, "-m", "bench", "run", *arguments, "--no-report", "--bench", bench, "--runs", str(runs)],
            stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT,
            env={**os.environ, "USER": "tired"},
        )  # fmt: skip
        self.wait_for(lambda: bool(list(runs.glob("*/runner.json"))))
        (self.path,) = runs.iterdir()

    def wait_for(self, condition: Callable[[], bool]) -> None:
        for _ in range(400):
            if condition():
                return
            time.sleep(0.05)
        raise AssertionError("it did not come to pass within 20 s")

    def send_command(self, *words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "bench", words[0], "last", *words[1:], "--runs", str(self.runs)],
            capture_output=True, text=True, check=False, cwd=ROOT, timeout=30,
        )  # fmt: skip

    def steps(self, kind: str) -> list[str]:
        with RunReader(self.path) as reader:
            return [event.step for event in reader.events(kind)]

    def operator(self) -> list[str]:
        """What the operator did: held and released the run, or what his action is called."""
        with RunReader(self.path) as reader:
            events = reader.events("held", "released", "operator", "end_requested")
            return [event.data.get("action", event.kind) for event in events]

    def finish(self) -> int:
        _, self.said = self.process.communicate(timeout=40)
        return self.process.returncode


@pytest.fixture
def started(tmp_path) -> Iterator[Callable[..., Running]]:
    runs: list[Running] = []

    def start(*arguments: str, **process: Any) -> Running:
        runs.append(Running(tmp_path / "runs", *arguments, **process))
        return runs[-1]

    yield start
    for run in runs:
        if run.process.poll() is None:
            run.process.kill()
        run.process.communicate()


def test_a_paused_run_holds_before_its_next_step_goes_on_and_stops_after_a_step(started):
    run = started(*PACED)
    reported = run.send_command("pause")
    assert reported.stdout == f"{run.path.name}: the run pauses before its next step\n"
    run.wait_for(lambda: run.operator() == ["held"])
    held = run.steps("step_begins")
    time.sleep(1.0)  # twenty seconds of bench time
    assert run.steps("step_begins") == held
    assert run.send_command("resume").stdout.endswith(": the run continues\n")
    run.wait_for(lambda: run.steps("step_begins") != held)
    assert run.send_command("stop", "--after-step").stdout.endswith(": the teardown runs after the current step\n")
    assert run.finish() == 4
    assert run.operator() == ["held", "released", "stop after step"]
    user = pwd.getpwuid(os.getuid()).pw_name
    for said in (
        f"pause by {user}: the run pauses before its next step", "Held before step",
        f"resume by {user}: the run continues",
        f"stop after step by {user}: the teardown runs after the current step",
    ):  # fmt: skip
        assert said in run.said
    with RunReader(run.path) as reader:
        commands = [(event.data["command"], event.data["by"]) for event in reader.events("command")]
    assert commands == [("pause", user), ("resume", user), ("stop_after_step", user)]
    assert run.steps("step_ended") == run.steps("step_begins"), "no step was cut short"
    assert run.steps("step_ended")[-2:] == ["teardown/set", "teardown/move"]


def test_a_stop_ends_the_step(started):
    run = started("smoke", "--speed", "20", "--set", "soak=1 h")
    run.wait_for(lambda: "steps/temperature=20/soak" in run.steps("step_begins"))
    assert run.send_command("stop").stdout.endswith(": the current step is interrupted, then the teardown runs\n")
    assert run.finish() == 4
    assert "steps/temperature=20/soak" not in run.steps("step_ended")
    assert "teardown/set" in run.steps("step_ended")


def test_a_paused_run_can_be_aborted(started):
    run = started(*PACED)
    run.send_command("pause")
    run.wait_for(lambda: run.operator() == ["held"])
    assert run.send_command("abort").stdout.endswith(": no teardown; all devices are made safe\n")
    assert run.finish() == 4
    assert not [step for step in run.steps("step_begins") if step.startswith("teardown")]
    with RunReader(run.path) as reader:
        assert [event.data for event in reader.events("made_safe")] == [{"unsafe": {}}]


def test_at_full_speed_there_is_no_pause_but_a_stop(started):
    run = started("tumble_static")
    reported = run.send_command("pause")
    assert reported.returncode == 2
    assert "a run at full speed cannot be paused; start it with --speed 60, for example" in reported.stderr
    assert run.send_command("stop").returncode == 0
    assert run.finish() == 4


def test_a_run_that_is_over_takes_no_commands_and_leaves_no_socket(started):
    run = started("smoke")
    names = json.loads((run.path / "runner.json").read_text("utf-8"))
    listening = Path("/proc/net/unix").read_text("utf-8")
    assert names["socket"] in listening
    assert names["stop"] in listening
    assert run.finish() == 0
    assert names["socket"] not in Path("/proc/net/unix").read_text("utf-8")
    assert not (run.path / "runner.json").exists()
    reported = run.send_command("stop")
    assert reported.returncode == 2
    assert reported.stderr == f"{run.path.name}: this run is not running; its state is completed\n"


def test_a_killed_run_is_told_to_be_interrupted(started):
    run = started(*PACED)
    run.process.kill()
    run.process.communicate()
    reported = run.send_command("pause")
    assert reported.returncode == 2
    assert reported.stderr == f"{run.path.name}: this run is not running; its state is interrupted\n"


def test_nonsense_is_answered_with_what_is_known_and_the_silent_keep_nobody_waiting(started):
    run = started(*PACED)
    address = json.loads((run.path / "runner.json").read_text("utf-8"))["socket"]
    silent = [socket.socket(socket.AF_UNIX) for _ in range(5)]
    for client in silent:
        client.connect(socket_address(address))
    for line in (b"\n", b"{}\n", b'{"command": "dance"}\n', b"[" * 4000 + b"\n", b"\xff\n", b"x" * 9000):
        with socket.socket(socket.AF_UNIX) as client:
            client.settimeout(5)
            client.connect(socket_address(address))
            client.sendall(line)
            answer = json.loads(client.makefile("rb").readline())
        known = "pause, resume, stop, stop_after_step, abort, skip, repeat, answer, status, order, halt, finish, alive"
        assert answer == {"refused": f"expected one of {known}"}
    began_s = time.monotonic()
    assert run.send_command("abort").returncode == 0
    assert time.monotonic() - began_s < 5
    for client in silent:
        client.close()
    assert run.finish() == 4
    assert (run.path / "results.json").exists()


def test_a_step_is_skipped_or_begun_anew_and_the_run_goes_on(started):
    run = started("smoke", "--speed", "20", "--set", "soak=10 min")
    soak = "steps/temperature=20/soak"
    run.wait_for(lambda: soak in run.steps("step_begins"))
    assert run.send_command("repeat").stdout.endswith(f": repeated: {soak}\n")
    run.wait_for(lambda: f"{soak}~2" in run.steps("step_begins"))
    reported = run.send_command("skip")
    assert reported.stdout.endswith(f": skipped: {soak}~2\n")
    assert run.finish() == 7  # what was left out makes the run incomplete
    assert run.steps("left_out") == [f"{soak}~2"]
    assert "steps/temperature=20/position=270/acquire" in run.steps("step_ended")
    manifest = json.loads((run.path / "manifest.json").read_text("utf-8"))
    assert (manifest["state"], manifest["verdict"]) == ("completed", "INCOMPLETE")


def test_the_step_before_a_pause_is_done_again_while_the_run_is_held(started):
    run = started(*PACED)
    soak = "steps/temperature=20/soak"
    run.wait_for(lambda: soak in run.steps("step_begins"))
    run.send_command("pause")
    run.wait_for(lambda: run.operator() == ["held"])
    assert run.send_command("repeat").stdout.endswith(": repeated: the last one\n")
    run.wait_for(lambda: f"{soak}~2" in run.steps("step_ended"))
    assert "steps/temperature=20/position=0/move" not in run.steps("step_begins")
    run.send_command("resume")
    run.wait_for(lambda: "steps/temperature=20/position=0/move" in run.steps("step_begins"))
    run.send_command("abort")
    assert run.finish() == 4


def test_a_question_is_answered_over_the_socket_by_name_and_the_status_shows_what_is_known(started, tmp_path):
    path = tmp_path / "ask.yaml"
    path.write_text(
        "schema: itb-sequence/1\ntitle: Ask\nneeds: {unit_temperature: thermometer}\nsteps:\n"
        "  - wait: 20 s\n  - {measure: unit_temperature, as: t}\n"
        "  - {prompt: How warm is the room?, input: {unit: °C, min: 0 °C, max: 50 °C}, as: room}\n"
        "  - if: ${room > '20 °C'}\n    then: [note: warm]\n    else: [note: cold]\n",
        "utf-8",
    )
    run = started(str(path), "--speed", "20")
    run.wait_for(lambda: "steps/prompt" in run.steps("asked"))
    status = json.loads(run.send_command("status", "--json").stdout)
    assert (status["state"], status["under_way"]) == ("running", ["steps/prompt"])
    assert status["variables"].keys() == {"t"}
    assert status["questions"][0]["expected"] == "a value in °C from 0 °C to 50 °C"
    assert "unit_temperature" in status["readings"]
    refused = run.send_command("answer", "60 °C")
    assert refused.returncode == 2
    assert "is 60 °C, expected at most 50 °C" in refused.stderr
    assert run.send_command("answer", "23.5 °C", "--by", "A. Person").returncode == 0
    assert run.finish() == 5  # nothing is judged
    assert "steps/then/note" in run.steps("step_ended")
    with RunReader(run.path) as reader:
        (answered,) = [event.data for event in reader.events("step_ended") if event.step == "steps/prompt"]
    assert (answered["value"], answered["unit"], answered["by"]) == (23.5, "°C", "A. Person")
    over = json.loads(run.send_command("status", "--json").stdout)
    assert over["variables"]["room"] == "23.5 °C"
    assert (over["state"], over["under_way"]) == ("completed", [])
    assert over["verdict"] == json.loads((run.path / "manifest.json").read_text("utf-8"))["verdict"]


def test_a_head_is_turned_by_whoever_answers_over_the_socket_or_on_the_terminal(started, tmp_path):
    path = tmp_path / "turn.yaml"
    path.write_text(
        "schema: itb-sequence/1\ntitle: Turn\n"
        "needs: {head: positioner, supply: power_supply, counter: pulse_counter}\nsteps:\n"
        "  - {set: supply, voltage: 15 V, current_limit: 120 mA, output: on}\n"
        "  - {move: head, to: 90°}\n  - {measure: counter.x, for: 5 s, as: up}\n"
        "  - {move: head, to: 270°}\n  - {measure: counter.x, for: 5 s, as: down}\n"
        "teardown:\n  - {set: supply, output: off}\n",
        "utf-8",
    )
    terminal, keyboard = pty.openpty()
    run = started(str(path), "--speed", "20", bench="by_hand", stdin=keyboard)
    run.wait_for(lambda: run.steps("asked") == ["head#1"])
    (question,) = json.loads(send_command(run.path, "status"))["questions"]
    assert (question["step"], question["expected"]) == ("head#1", "a value in °")
    with pytest.raises(InputError, match="expected a value in °"):
        send_command(run.path, "answer", answer="done")
    send_command(run.path, "answer", answer="93 deg", by="A. Hurry")
    run.wait_for(lambda: run.steps("asked") == ["head#1", "head#1~2"])
    assert run.send_command("answer", "90 deg", "--step", "head#1~2", "--by", "A. Person").returncode == 0
    run.wait_for(lambda: run.steps("asked")[2:] == ["head#2"])
    os.write(terminal, b"270 deg\n")
    assert run.finish() == 5  # nothing is judged
    os.close(terminal)
    os.close(keyboard)
    with RunReader(run.path) as reader:
        said = [(event.step, event.data["answer"], event.data["by"]) for event in reader.events("answered")]
        up, down = [event.data["value"] for event in reader.events("step_ended") if "reading" in event.data]
    assert said == [("head#1", "93 °", "A. Hurry"), ("head#1~2", "90 °", "A. Person"), ("head#2", "270 °", "tired")]
    assert up > 10_000
    assert down < -10_000
