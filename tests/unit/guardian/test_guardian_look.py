"""A single look at a chamber after a run, beside all who want the bench as well."""

from __future__ import annotations

import asyncio
import os
from typing import Any

import pytest

from bench.clock import wall_utc
from bench.errors import InUseError
from bench.guardian import follow as module
from bench.runner.held import Kind, Owner, energising_addresses, owners, real_addresses
from bench.store.lockout import lock_out
from tests.support.guarded import FakeChamber, FakeSupply, at

FILE = "followed.jsonl"
BY = "the guardian of a run"
LOOK = ["enter", "identify", "state", "exit"]


def address(bench):
    return energising_addresses(bench)["chamber"]


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
