"""Chambers after a run are followed until they have arrived, and are left safe at the end."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from bench.clock import wall_utc
from bench.errors import InUseError, StoreError
from bench.guardian import follow as module
from bench.guardian.follow import Follower, Following, guardian_of
from bench.runner.held import LOOKS, Kind, energising_addresses, owners
from bench.store.energised import energised, note_energised
from tests.support.guarded import Ends, FakeChamber, at

FILE = "followed.jsonl"
BY = "the guardian of a run"
LOOK = ["enter", "identify", "state", "exit"]


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


def test_a_bench_without_a_chamber_has_nothing_to_follow(follower, bench, entries):
    following = Following(follower, bench, ["supply"])
    assert following.follow()
    following.close()
    assert [entry["event"] for entry in entries("followed.jsonl")] == ["commanded"]


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
