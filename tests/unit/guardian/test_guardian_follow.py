"""Chambers after a run are looked at until they have arrived, beside all who want the bench as well."""

from __future__ import annotations

import asyncio
import os
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bench.clock import wall_utc
from bench.errors import InUseError, StoreError
from bench.guardian import follow as module
from bench.guardian.follow import Follower, Following, end_on_sigterm, guardian_of, in_own_process
from bench.runner.held import LOOKS, Kind, Owner, energising_addresses, owners, real_addresses
from bench.store.energised import energised, note_energised
from bench.store.lockout import lock_out
from drivers.transport.wires import RealWires
from tests.support.guarded import FakeChamber, FakeSupply, at

FILE = "followed.jsonl"
BY = "the guardian of a run"
LOOK = ["enter", "identify", "state", "exit"]


class Ends:
    """The request to end, which notes for how long it was waited for instead of waiting."""

    def __init__(self, then: Callable[[int], object] = lambda _count: None) -> None:
        self.waits: list[float] = []
        self._then, self._is_set = then, False

    def wait(self, limit_s: float) -> None:
        self.waits.append(limit_s)
        self._then(len(self.waits))

    def set(self) -> None:
        self._is_set = True

    def is_set(self) -> bool:
        return self._is_set


@pytest.fixture
def chamber(monkeypatch) -> FakeChamber:
    """The chamber of the bench, at 60 °C."""
    found = FakeChamber(at(60.0, 60.0))

    def device_of(role: str, entry: object, wires: object) -> FakeChamber:
        assert (role, getattr(entry, "driver", ""), type(wires)) == ("chamber", "watlow_f4t", RealWires)
        return found

    monkeypatch.setattr(module, "device_of", device_of)
    return found


@pytest.fixture
def clock(monkeypatch) -> list[float]:
    """The time of supervisions in s."""
    now = [0.0]

    class At:
        def elapsed_s(self) -> float:
            return now[0]

    monkeypatch.setattr(module, "Stopwatch", At)
    return now


@pytest.fixture
def follower(run, monkeypatch) -> Follower:
    monkeypatch.setattr(module, "_pause", lambda _s: None)
    return guardian_of(run, 7)


@pytest.fixture
def held(follower, bench, chamber, clock) -> Following:
    following = Following(follower, bench, [], ["chamber"])
    following._ends = Ends()
    return following


@pytest.fixture
def sent(follower, bench, chamber, clock) -> Following:
    """Supervision of a chamber that was commanded to 25 °C."""
    chamber.now = at(60.0, 25.0)
    following = Following(follower, bench, ["supply", "chamber"])
    following._ends = Ends()
    return following


@pytest.fixture
def others(monkeypatch) -> list[set[Owner]]:
    """Who else has the address, of each time that is asked; the last one remains."""
    found: list[set[Owner]] = [set()]
    monkeypatch.setattr(module, "owners", lambda _addresses: found.pop(0) if len(found) > 1 else found[0])
    return found


def events(entries) -> list[str]:
    return [each["event"] for each in entries(FILE)]


def address(bench):
    return energising_addresses(bench)["chamber"]


def test_a_guardian_follows_in_the_name_of_its_run(run):
    assert guardian_of(run, 7) == Follower(BY, run, "a run", 7)


def test_what_was_commanded_is_on_record_and_only_what_takes_time_is_followed(sent, entries):
    sent.close()
    commanded = {"by": BY, "event": "commanded"}
    assert entries(FILE) == [
        {**commanded, "role": "supply", "what": "off", "is_complete": True},
        {**commanded, "role": "chamber", "what": "set point 25 °C", "is_complete": False},
    ]
    assert list(sent.courses) == ["chamber"]
    assert not sent.courses["chamber"].is_held


def test_a_held_chamber_was_not_commanded(held, entries):
    held.close()
    assert entries(FILE) == []
    assert held.courses["chamber"].is_held
    assert held.courses["chamber"].hold_ends_s == 1800.0


def test_others_find_the_supervision_while_it_lasts(sent, bench):
    addresses = energising_addresses(bench)
    with sent as entered:
        assert entered is sent
        (owner,) = owners([addresses["chamber"]], LOOKS)
        assert (owner.process, owner.words, owner.kind) == (os.getpid(), BY, Kind.VISIT)
        assert owners([addresses["supply"]], LOOKS) == set()
        assert owners(addresses.values()) == set()
    assert owners([addresses["chamber"]], LOOKS) == set()


@pytest.mark.parametrize("problem", [InUseError("another follows it"), StoreError("cannot be locked")])
def test_a_chamber_that_another_follows_is_followed_all_the_same(sent, monkeypatch, problem):
    def refuses(*_arguments: object) -> None:
        raise problem

    monkeypatch.setattr(module, "address_lock", refuses)
    with sent as entered:
        assert entered is sent


def test_a_chamber_is_looked_at_until_its_air_has_arrived(sent, chamber, clock, entries, told):
    def nearer(count: int) -> None:
        clock[0] += 60.0
        chamber.now = at(60.0 - 9 * count, 25.0)

    sent._ends = Ends(nearer)
    rounds: list[int] = []
    assert sent.follow(lambda: rounds.append(len(chamber.calls))) is True
    sent.close()
    assert rounds == [4, 8, 12, 16, 20]
    assert chamber.calls == LOOK * 5
    assert events(entries) == ["commanded", "commanded", "arrived"]
    arrived = {"by": BY, "event": "arrived", "role": "chamber", "air_c": 24.0, "set_point_c": 25.0}
    assert entries(FILE)[-1] == arrived
    assert told() == ""


def test_it_is_looked_at_less_and_less_often(sent, clock):
    ends = Ends(lambda count: sent.end() if count == 8 else None)
    sent._ends = ends
    sent.follow()
    sent.close()
    assert ends.waits == [1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0, 30.0]


def test_the_end_of_a_hold_is_not_overslept(held, chamber, clock):
    waits: list[float] = []
    clock[0] = 1780.0

    def later(count: int) -> None:
        waits.append(held._ends.waits[-1])
        clock[0] += waits[-1] if count < 20 else 5000.0

    held._ends = Ends(later)
    held.courses["chamber"].hold_ends_s = 1800.0
    held.follow()
    held.close()
    assert waits[:6] == [1.0, 2.0, 4.0, 8.0, 5.0, 30.0]
    assert chamber.calls.count("make_safe") == 1


def test_nor_is_one_that_is_due_within_a_second(held, clock):
    clock[0] = 1799.5
    held._ends = Ends(lambda _count: held.end())
    held.follow()
    held.close()
    assert held._ends.waits == [0.5]


def test_air_that_does_not_arrive_is_on_record_and_told(sent, chamber, clock, entries, told):
    chamber.now = at(60.0, 40.0)
    assert sent.follow() is False
    sent.close()
    why = "the set point was changed by another master from 25 °C to 40 °C"
    ended = {"by": BY, "event": "not_arrived", "role": "chamber", "why": why, "air_c": 60.0, "set_point_c": 40.0}
    assert entries(FILE)[-1] == ended
    title = "a run: chamber HAS NOT ARRIVED at its safe set point"
    assert told() == f"{title}\n{title}\n{why}\n"


def test_an_alert_that_fails_is_on_record(sent, chamber, bench, entries):
    sent._bench = bench.model_copy(update={"alert": bench.alert.model_copy(update={"exec": ("/no/program",)})})
    chamber.now = at(60.0, 40.0)
    sent.follow()
    sent.close()
    last = entries(FILE)[-1]
    assert (last["event"], last["role"]) == ("alert", "chamber")
    assert last["problem"].startswith("the alert program /no/program cannot be run")


def test_without_an_alert_program_the_record_has_to_do(sent, chamber, bench, entries):
    sent._bench = bench.model_copy(update={"alert": None})
    chamber.now = at(60.0, 40.0)
    assert sent.follow() is False
    sent.close()
    assert events(entries)[-1] == "not_arrived"


def test_a_hold_that_is_over_is_ended_by_making_the_chamber_safe(held, run, bench, chamber, clock, entries):
    at_chamber = str(address(bench))
    note_energised(run, Path("/bench.yaml"), wall_utc(), {"chamber": at_chamber, "supply": "tcp://10.0.0.2:1"})

    def later(count: int) -> None:
        clock[0] = 1800.0 if count == 1 else 1900.0
        if count == 2:
            assert held.courses["chamber"].state == at(60.0, 25.0)
            assert not held.courses["chamber"].is_held
            chamber.now = at(25.0, 25.0)

    held._ends = Ends(later)
    assert held.follow() is True
    held.close()
    assert chamber.calls == [*LOOK, "enter", "identify", "state", "make_safe", "state", "exit", *LOOK]
    assert events(entries) == ["held", "reading", "hold_ends", "commanded", "arrived"]
    assert entries(FILE)[2]["why"] == "the hold time has expired"
    assert [dict(each.connections) for each in energised(lambda _: None)] == [{"supply": "tcp://10.0.0.2:1"}]


def test_a_chamber_that_cannot_be_made_safe_is_tried_again(held, chamber, clock, monkeypatch, entries):
    monkeypatch.setattr(module, "limits_to_make_safe", lambda _bench: {"chamber": 0.05})
    chamber.hangs = True

    def later(count: int) -> None:
        clock[0] = 1800.0 + count
        chamber.hangs = count < 2
        if count == 3:
            held.end()

    held._ends = Ends(later)
    held.follow()
    held.close()
    assert chamber.calls.count("make_safe") == 2
    assert [each for each in events(entries) if each != "reading"] == [
        "held", "not_seen", "hold_ends", "commanded", "ended",
    ]  # fmt: skip


def test_a_glance_is_one_look(sent, chamber, entries):
    assert sent.glance("it was looked at once") is True
    sent.close()
    assert chamber.calls == LOOK
    assert entries(FILE)[-1] == {"by": BY, "event": "ended", "role": "chamber", "why": "it was looked at once"}


@pytest.mark.parametrize(
    ("state", "good", "event"), [(at(25.0, 25.0), True, "arrived"), (at(9.0, 9.0), False, "not_arrived")]
)
def test_a_glance_tells_what_it_sees(sent, chamber, entries, state, good, event):
    chamber.now = state
    assert sent.glance("") is good
    sent.close()
    assert events(entries)[2:] == [event]


@pytest.mark.parametrize(
    "act",
    [
        lambda both: both.glance(""),
        lambda both: both.follow(),
        lambda both: both.follow(looked=both.end),
        lambda both: (both._look("chamber", both.courses["chamber"]), both._end())[1],
    ],
)
def test_one_chamber_that_has_not_arrived_is_not_made_good_by_another(sent, chamber, bench, monkeypatch, act):
    sent._courses["second"] = module.Course(bench.devices["chamber"], 0.0, held=False)
    sent._addresses["second"] = address(bench)
    cold = FakeChamber(at(25.0, 25.0), "second")
    chamber.now = at(9.0, 9.0)
    monkeypatch.setattr(module, "device_of", lambda role, *_: chamber if role == "chamber" else cold)
    sent._bench = bench.model_copy(update={"devices": {**bench.devices, "second": bench.devices["chamber"]}})
    assert act(sent) is False
    sent.close()


def test_who_ends_the_supervision_leaves_no_chamber_held(held, chamber, entries):
    held.end()
    assert held.follow() is True
    held.close()
    assert chamber.calls == ["enter", "identify", "state", "make_safe", "state", "exit"]
    assert events(entries) == ["held", "hold_ends", "commanded", "ended"]
    assert entries(FILE)[1]["why"] == "its guardian was ended"
    assert "why" not in entries(FILE)[-1]


def test_the_reason_for_which_a_hold_has_ended_before_stays(held, chamber, clock, entries):
    clock[0] = 1800.0
    held.end()
    held.follow()
    held.close()
    assert entries(FILE)[1]["why"] == "the hold time has expired"


def test_a_held_chamber_that_does_not_answer_at_the_end_is_tried_again_and_then_told(
    held, chamber, entries, monkeypatch
):
    chamber.is_silent, pauses = True, list[float]()
    monkeypatch.setattr(module, "_pause", pauses.append)
    held.end()
    assert held.follow() is True
    held.close()
    assert chamber.calls.count("enter") == 1 + module.LAST_TRIES
    assert pauses == [module.BETWEEN_TRIES_S] * module.LAST_TRIES
    assert entries(FILE)[-1] == {"by": BY, "event": "ended", "role": "chamber", "why": "still held"}
    assert {each["why"] for each in entries(FILE)[:-1]} == {"chamber: does not answer"}


def test_an_end_that_is_asked_for_hides_no_failure(sent, chamber):
    chamber.now = at(60.0, 40.0)
    assert sent.follow(looked=sent.end) is False
    sent.close()


def test_a_chamber_that_has_failed_before_the_end_is_not_forgotten(held, chamber, clock, monkeypatch):
    held.courses["chamber"].lock_out("locked out by A.")
    assert held._write("chamber", held.courses["chamber"]) is False
    assert held._end() is True  # it was told before
    held.courses["chamber"].noted.append(module.Noted("not_arrived", "again"))
    assert held._end() is False
    held.close()


def test_a_run_that_takes_the_bench_ends_the_supervision(sent, chamber, others, entries):
    others[:] = [{Owner(1, os.getuid(), "a run of smoke", Kind.RUN)}]
    assert sent.follow() is True
    sent.close()
    assert chamber.calls == []
    assert entries(FILE)[-1]["event"] == "handed_over"
    assert entries(FILE)[-1]["why"] == "a run of smoke, process 1 has taken the bench"


def test_another_program_is_waited_for(sent, chamber, others, clock, entries):
    others[:] = [{Owner(1, os.getuid(), "bench console")}]
    clock[0] = 600.0
    sent._look("chamber", sent.courses["chamber"])
    assert sent.courses["chamber"].why_unseen == "the bench is in use by bench console, process 1"
    assert not sent.courses["chamber"].is_over
    clock[0] = 601.0
    sent._look("chamber", sent.courses["chamber"])
    assert chamber.calls == []
    assert sent.courses["chamber"].end.event == "handed_over"
    sent.close()


def test_the_run_itself_and_this_process_are_no_others(sent, chamber, others, monkeypatch):
    pauses: list[float] = []
    monkeypatch.setattr(module, "_pause", pauses.append)
    runner, own = Owner(7, 0, "the run", Kind.RUN), Owner(os.getpid(), 0, "this one", Kind.OTHER)
    others[:] = [{runner}, {runner, own}, {own}]
    sent._look("chamber", sent.courses["chamber"])
    assert chamber.calls == LOOK
    assert pauses == [module.BETWEEN_TRIES_S] * 2
    sent.close()


def test_at_a_bench_that_is_locked_out_nothing_is_asked(sent, chamber, bench, tmp_path):
    connections = {role: str(each) for role, each in real_addresses(bench).items()}
    lock_out(tmp_path / "bench.yaml", wall_utc(), "A. Person", "the coil is changed", connections)
    sent._look("chamber", sent.courses["chamber"])
    assert chamber.calls == []
    assert sent.courses["chamber"].end.event == "not_arrived"
    assert sent.courses["chamber"].end.why.startswith("the bench is locked out by A. Person since 2")
    sent.close()


def test_the_address_is_held_as_a_short_look_meanwhile(sent, chamber, bench, monkeypatch):
    found: list[Owner] = []

    async def identify() -> None:
        found.extend(owners([address(bench)]))

    monkeypatch.setattr(chamber, "identify", identify)
    sent._look("chamber", sent.courses["chamber"])
    (owner,) = found
    assert (owner.words, owner.kind) == (f"a short look of {BY}", Kind.VISIT)
    assert owners([address(bench)]) == set()
    sent.close()


def test_an_address_that_is_taken_meanwhile_is_in_use(sent, chamber, clock, monkeypatch):
    def taken(*_arguments: object) -> None:
        raise InUseError("it is in use")

    monkeypatch.setattr(module, "address_lock", taken)
    clock[0] = 601.0
    sent._look("chamber", sent.courses["chamber"])
    assert sent.courses["chamber"].end == module.Noted("handed_over", "it is in use")
    sent.close()


def test_nothing_is_waited_for_after_the_last_chamber_has_arrived(sent, chamber):
    chamber.now = at(25.0, 25.0)
    with sent:
        assert sent.follow()
    assert sent.courses["chamber"].end.event == "arrived"
    assert sent._ends.waits == []


def test_a_chamber_that_does_not_answer_is_unseen_and_left(sent, chamber, clock):
    chamber.is_silent = True
    clock[0] = 601.0
    sent._look("chamber", sent.courses["chamber"])
    assert chamber.calls == ["enter", "exit"]
    assert sent.courses["chamber"].end.event == "not_arrived"
    assert sent.courses["chamber"].end.why.endswith("for 10 min: chamber: does not answer")
    sent.close()


def test_what_is_no_chamber_is_not_looked_at(sent, monkeypatch):
    supply = FakeSupply()
    monkeypatch.setattr(module, "device_of", lambda *_: supply)
    sent._look("chamber", sent.courses["chamber"])
    assert sent.courses["chamber"].why_unseen.rstrip().endswith("TypeError: chamber is not a chamber")
    assert supply.calls == []
    sent.close()


@pytest.mark.parametrize("hangs", ["identify", "state", "__aexit__"])
def test_a_look_ends_in_time(sent, chamber, monkeypatch, hangs):
    async def forever(*_arguments: object) -> None:
        await asyncio.sleep(3600)

    monkeypatch.setattr(module, "VISIT_S", 0.05)
    monkeypatch.setattr(module, "CLOSE_S", 0.05)
    monkeypatch.setattr(FakeChamber, hangs, forever)
    sent._look("chamber", sent.courses["chamber"])
    assert sent.courses["chamber"].why_unseen == ("" if hangs == "__aexit__" else "chamber: does not answer in time")
    sent.close()


def test_the_state_after_a_command_is_waited_for_in_bounded_time_too(held, chamber, clock, monkeypatch):
    monkeypatch.setattr(module, "VISIT_S", 0.05)

    async def state() -> Any:
        if "make_safe" in chamber.calls:
            await asyncio.sleep(3600)
        return chamber.now

    monkeypatch.setattr(chamber, "state", state)
    clock[0] = 1800.0
    held._look("chamber", held.courses["chamber"])
    assert not held.courses["chamber"].is_held
    assert held.courses["chamber"].why_unseen
    held.close()


def test_a_connection_that_breaks_while_it_is_closed_does_no_harm(sent, chamber, monkeypatch):
    closed: list[tuple[object, ...]] = []

    async def breaks(_self: object, *exc: object) -> None:
        closed.append(exc)
        raise RuntimeError

    monkeypatch.setattr(FakeChamber, "__aexit__", breaks)
    sent._look("chamber", sent.courses["chamber"])
    assert sent.courses["chamber"].why_unseen == ""
    assert closed == [(None, None, None)]
    sent.close()


def test_a_signal_ends_the_supervision(sent):
    before = signal.getsignal(signal.SIGTERM)
    try:
        end_on_sigterm(sent)
        os.kill(os.getpid(), signal.SIGTERM)
        assert sent._ends.is_set()
    finally:
        signal.signal(signal.SIGTERM, before)
    sent.close()


class InChild:
    """A supervision that writes what it finds about its process, and ends when it is told to."""

    def __init__(self, path: Path, entered: list[str]) -> None:
        self._path, self._found, self._ends = path, entered, threading.Event()

    def __enter__(self) -> InChild:
        self._found.append("entered")
        return self

    def __exit__(self, *_exc: object) -> None:
        with self._path.open("a") as file:
            file.write("\nleft")

    def end(self) -> None:
        self._ends.set()

    def follow(self) -> None:
        streams = [os.readlink(f"/proc/self/fd/{number}") for number in (0, 1, 2)]
        found = [os.getpid(), os.getsid(0), *streams, pipes(), *self._found]
        draft = self._path.with_suffix(".draft")
        draft.write_text(" ".join(map(str, found)))
        draft.rename(self._path)
        if self._ends.wait(10):
            with self._path.open("a") as file:
                file.write("\nasked to end")

    @staticmethod
    def _is_pipe(name: str) -> bool:
        return os.path.islink(f"/proc/self/fd/{name}") and os.readlink(f"/proc/self/fd/{name}").startswith("pipe")


def awaited(path: Path) -> list[str]:
    for _ in range(500):
        if path.exists():
            break
        threading.Event().wait(0.01)
    return path.read_text().split()


def pipes() -> int:
    return sum(map(InChild._is_pipe, os.listdir("/proc/self/fd")))


def test_a_process_of_its_own_follows_without_terminal_and_link(tmp_path):
    path, before = tmp_path / "child", pipes()
    in_own_process(lambda: InChild(path, []))
    process, session, *found = awaited(path)
    assert int(process) != os.getpid()
    assert session == process
    assert found == ["/dev/null", "/dev/null", "/dev/null", str(before), "entered"]
    os.kill(int(process), signal.SIGTERM)
    _, status = os.waitpid(int(process), 0)
    assert status == 0
    assert path.read_text().splitlines()[1:] == ["asked to end", "left"]
    assert pipes() == before


def test_a_process_that_cannot_follow_is_not_waited_for(tmp_path):
    path = tmp_path / "child"

    def fails() -> Following:
        path.write_text(str(os.getpid()))
        raise RuntimeError

    in_own_process(fails)
    (process,) = awaited(path)
    _, status = os.waitpid(int(process), 0)
    assert status == 0
