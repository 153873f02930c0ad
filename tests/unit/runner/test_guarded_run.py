"""A run starts its guardian, beats while it goes on, and dismisses it; programs of a line stand for the guardian."""

from __future__ import annotations

import asyncio
import hashlib
import json
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from bench.config.bench import LoadedBench, load_bench
from bench.engine.ending import Outcome
from bench.engine.pulse import GUARDIAN_LATE, GUARDIAN_OK, NO_GUARDIAN
from bench.guardian.watch import Over
from bench.loop import REAL_TIME, run
from bench.runner import guard as module
from bench.runner.guard import Guard, GuardError, _send_heartbeats, guarded, try_guardian
from bench.runner.signals import Signals
from tests.support.guarded import bench_file
from tests.support.runs import ROOT

BEGINS = "import json, os, signal, socket, sys, time; link = socket.socket(fileno=int(sys.argv[2]))\n"
LISTENS = (
    BEGINS
    + """
found = [int(link.type), sys.argv[1:]]
found += [os.getsid(0) == os.getpid(), os.readlink("/proc/self/fd/0"), os.readlink("/proc/self/fd/1")]
link.send(b"armed")
while not (found[-1] or "").startswith("over "):
    found.append(link.recv(5000).decode())
json.dump(found, open(sys.argv[4] + "/found.json", "w"))
"""
)
ROLES = ("chamber", "head", "supply", "source")


class Writer:
    """A record with commits that wait for the disk."""

    commits = (7, True)


@pytest.fixture
def loaded(tmp_path) -> LoadedBench:
    return load_bench(bench_file(tmp_path))


@pytest.fixture
def memory(tmp_path, monkeypatch) -> Path:
    """What the kernel is told about the memory of the run."""
    path = tmp_path / "oom_score_adj"
    path.write_text("0\n", "ascii")
    monkeypatch.setattr(module, "MEMORY_PRESSURE", path)
    return path


@pytest.fixture
def plays(loaded, tmp_path, memory, monkeypatch):
    """Play a run of a block under a guardian with a program; return what the guardian has found."""
    monkeypatch.setattr(module, "BEAT_S", 0.01)

    def play(program: str, block: Any = None, signals: Signals | None = None) -> list[Any]:
        monkeypatch.setattr(module, "PROGRAM", program)

        async def main() -> None:
            async with guarded(loaded, tmp_path, signals or Signals(), Writer()) as guard:  # type: ignore[arg-type]
                await asyncio.sleep(0.05)
                if block is not None:
                    block(guard)

        run(main(), REAL_TIME)
        path = tmp_path / "found.json"
        return json.loads(path.read_text("utf-8")) if path.exists() else []

    return play


def test_a_guardian_is_told_of_its_run_and_gets_beats_and_the_end(plays, loaded, tmp_path):
    guards: list[Guard] = []

    def block(guard: Guard) -> None:
        guards.append(guard)
        assert guard.pulse.guardian == GUARDIAN_OK
        guard.end = Over(("supply",), ("chamber",))

    kind, arguments, is_leader, stdin, stdout, *messages = plays(LISTENS, block)
    assert kind == module.socket.SOCK_SEQPACKET  # a message is whole, or is not
    assert json.loads(arguments[0]) == sys.path
    text = loaded.document.text
    assert arguments[2:] == [
        str(os.getpid()), str(tmp_path), str(loaded.document.path), hashlib.sha256(text.encode()).hexdigest(),
    ]  # fmt: skip
    assert (is_leader, stdin, stdout) == (True, "/dev/null", "/dev/null")
    assert json.loads(messages[-1].removeprefix("over ")) == {"safe": ["supply"], "held": ["chamber"]}
    beats = [json.loads(each.removeprefix("beat ")) for each in messages[:-1]]
    assert [each["turns"] for each in beats] == list(range(len(beats)))
    assert len(beats) >= 2
    assert beats[0] == {"turns": 0, "commits": 7, "waits": True, "polls": {}, "may_hold": False}
    assert (guards[0].roles, list(guards[0].pulse.may_be_held)) == (ROLES, ["chamber"])


def test_beats_have_the_polls_of_what_may_be_energised():
    beats: list[dict[str, Any]] = []

    async def main() -> None:
        near, far = module.socket.socketpair(module.socket.AF_UNIX, module.socket.SOCK_SEQPACKET)
        with near, far:
            guard = Guard(ROLES)
            guard.pulse.polls = {"head": 3, "counter": 9}
            guard.pulse.may_hold = lambda: True
            beating = asyncio.create_task(_send_heartbeats(near, 0, Signals(), guard, Writer()))  # type: ignore[arg-type]
            await asyncio.sleep(0.03)
            beating.cancel()
            beats.append(json.loads(far.recv(5000).removeprefix(b"beat ")))

    run(main(), REAL_TIME)
    assert beats == [{"turns": 0, "commits": 7, "waits": True, "polls": {"head": 3}, "may_hold": True}]


def test_after_an_error_the_end_names_nothing(plays, tmp_path):
    def block(guard: Guard) -> None:
        guard.end = Over(("supply",), ())
        raise KeyError("a bug")

    with pytest.raises(KeyError):
        plays(LISTENS, block)
    *_, last = json.loads((tmp_path / "found.json").read_text("utf-8"))
    assert json.loads(last.removeprefix("over ")) == {"safe": [], "held": []}


@pytest.mark.parametrize(
    ("program", "why"),
    [
        ("link.send(b'cannot no bench file\\xff')", "no bench file\ufffd"),
        ("", "it has ended"),
        ("time.sleep(60)", "no answer within 0.5 s"),
    ],
)
def test_without_a_guardian_nothing_begins(plays, monkeypatch, program, why):
    monkeypatch.setattr(module, "ARMED_WITHIN_S", 0.5 if "sleep" in program else 20.0)
    monkeypatch.setattr(module, "ENDS_WITHIN_S", 0.1)
    with pytest.raises(GuardError) as found:
        plays(BEGINS + program, lambda _guard: pytest.fail("the run has begun"))
    assert str(found.value) == f"The guardian of the run could not be started ({why}). Nothing was energised."


def test_without_a_process_for_it_too(plays, monkeypatch):
    monkeypatch.setattr(module.sys, "executable", "/no/python")
    with pytest.raises(GuardError, match=r"could not be started .*/no/python.*Nothing was energised"):
        plays(LISTENS)


def test_a_computer_that_does_not_let_itself_be_told_of_memory_is_used_all_the_same(plays, memory):
    memory.unlink()
    memory.mkdir()
    assert plays(LISTENS)


@pytest.mark.parametrize(("inherited", "raised"), [("-17", "483"), ("500", "1000"), ("800", "1000")])
def test_a_run_is_taken_before_its_guardian_whatever_both_inherit(plays, memory, inherited, raised):
    memory.write_text(f"{inherited}\n", "ascii")
    during: list[str] = []
    assert plays(LISTENS, lambda _guard: during.append(memory.read_text("ascii")))
    assert (during, memory.read_text("ascii")) == ([raised], inherited)


def test_a_guardian_that_does_not_end_is_killed(plays, monkeypatch, tmp_path):
    monkeypatch.setattr(module, "ENDS_WITHIN_S", 0.1)
    stays = BEGINS + "open(sys.argv[4] + '/pid', 'w').write(str(os.getpid())); link.send(b'armed'); time.sleep(60)"
    begun_s = time.monotonic()
    plays(stays)
    assert time.monotonic() - begun_s < 20
    assert not Path(f"/proc/{(tmp_path / 'pid').read_text()}").exists()


def test_a_link_that_is_broken_is_the_death_of_the_guardian():
    signals = Signals()

    async def main() -> None:
        near, far = module.socket.socketpair(module.socket.AF_UNIX, module.socket.SOCK_SEQPACKET)
        far.close()
        with near:
            await _send_heartbeats(near, 0, signals, Guard(), Writer())  # type: ignore[arg-type]

    run(main(), REAL_TIME)
    (found,) = signals.received
    assert (found.name, found.gentle, found.request) == ("the death of its guardian", False, module.LOST)


def test_a_guardian_that_takes_no_beat_is_late_and_is_woken(monkeypatch):
    woken: list[tuple[int, int]] = []
    guard, signals = Guard(), Signals()
    monkeypatch.setattr(module.os, "kill", lambda *arguments: woken.append(arguments))
    monkeypatch.setattr(module, "BEAT_S", 0.0)

    class Full:
        """A link that takes a beat now and then."""

        sent = 0

        def send(self, _beat: bytes) -> None:
            self.sent += 1
            if self.sent != 15:
                raise BlockingIOError

    link = Full()
    states: list[str] = []
    guard.pulse.may_hold = lambda: bool(states.append(guard.pulse.guardian))
    run(_send_heartbeats(link, 77, signals, guard, Writer()), REAL_TIME)  # type: ignore[arg-type]
    assert link.sent == 15 + module.STILL_BEATS + 1
    assert woken == [(77, signal.SIGCONT)] * (link.sent - 1)
    assert states[:2] == [NO_GUARDIAN, GUARDIAN_LATE]
    assert states[15] == GUARDIAN_OK
    assert [(each.name, each.request) for each in signals.received] == [("a guardian that hangs", module.STILL)]


def test_a_bench_of_simulators_needs_none(tmp_path, monkeypatch):
    simulated = load_bench(ROOT / "config" / "simulated.yaml")
    monkeypatch.setattr(module, "_start", lambda *_: pytest.fail("a guardian was started"))
    assert try_guardian(simulated, tmp_path) == 0.0

    async def main() -> None:
        async with guarded(simulated, tmp_path, Signals(), Writer()) as guard:  # type: ignore[arg-type]
            assert (guard.roles, guard.pulse.guardian) == ((), NO_GUARDIAN)

    run(main(), REAL_TIME)


def test_a_trial_starts_a_guardian_and_dismisses_it(loaded, tmp_path, memory, monkeypatch):
    monkeypatch.setattr(module, "PROGRAM", LISTENS)
    assert 0.0 < try_guardian(loaded, tmp_path) < 20.0
    *_, last = json.loads((tmp_path / "found.json").read_text("utf-8"))
    assert json.loads(last.removeprefix("over ")) == {"safe": [], "held": []}
    assert memory.read_text("ascii") == "0\n"  # nothing was energised


def test_what_a_run_leaves_is_told_to_its_guardian():
    guard = Guard(("chamber", "head", "supply", "source"))
    guard.leaves(Outcome(unsafe={"head": "stuck"}, not_reached={"source": "gone"}, held=["chamber"]))
    assert guard.end == Over(("supply",), ("chamber",))
