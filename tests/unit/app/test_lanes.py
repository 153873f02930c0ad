"""A lane connects to an instrument, makes it safe and closes; in virtual time, with instruments of any behaviour."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from bench import lanes as module
from bench.lanes import CONNECT_S, Lane, longest_lane_s, make_safe_in_lanes
from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.capabilities import Device
from drivers.errors import BadAnswer, CannotConnect, InstrumentFault, LinkLost, NoAnswer, Refused, WrongIdentity
from drivers.values import ChamberState, SourceReading
from tests.support.guarded import FakeAxis, FakeChamber, FakeSupply, at, does, forever, raises

LIMIT_S = 7.0


class Plays:
    """Plays lanes: `ended` are those that ended, in order, each with the time."""

    def __init__(self) -> None:
        self.ended: list[tuple[str, float]] = []
        self.took_s = 0.0

    def __call__(self, *devices: Device, limits_s: dict[str, float] | None = None, **options: Any) -> list[Lane]:
        async def main() -> list[Lane]:
            loop = asyncio.get_running_loop()
            await asyncio.sleep(100.0)  # what a lane takes does not depend on when it begins
            begun_s = loop.time()

            def noted(lane: Lane) -> None:
                self.ended.append((lane.role, round(loop.time() - begun_s, 3)))

            by_role = {each.name: each for each in devices}
            limits = dict.fromkeys(by_role, LIMIT_S) | (limits_s or {})
            found = await make_safe_in_lanes(by_role, limits, noted, **options)
            self.took_s = loop.time() - begun_s
            return found

        return run(main(), AS_FAST_AS_POSSIBLE)


@pytest.fixture
def plays() -> Plays:
    return Plays()


def test_every_instrument_has_its_lane(plays):
    devices = FakeChamber(at(60.0, 60.0)), FakeAxis("head"), FakeSupply()
    found = plays(*devices)
    assert [lane._replace(took_s=0.0) for lane in found] == [
        Lane("chamber", "safe", "", 0.0, 60.0), Lane("head", "safe", "", 0.0), Lane("supply", "safe", "", 0.0),
    ]  # fmt: skip
    assert devices[1].calls == ["enter", "identify", "make_safe", "exit"]
    assert devices[2].calls == ["enter", "identify", "make_safe", "read", "exit"]
    assert sorted(plays.ended) == [("chamber", 0.0), ("head", 0.0), ("supply", 1.0)]
    assert found[2].took_s == pytest.approx(1.0)


def test_without_instruments_there_is_nothing_to_wait_for(plays):
    assert plays() == []


def test_no_lane_is_longer_than_is_said(plays):
    assert longest_lane_s({}) == pytest.approx(2 * 10 + 2 + 10 + 1)
    assert longest_lane_s({"a": 3.0, "b": 7.0}) == pytest.approx(longest_lane_s({}) + 7)


@pytest.mark.parametrize("problem", [CannotConnect("head", "no"), LinkLost("head", "no"), NoAnswer("head", "no")])
def test_a_connection_is_tried_again_for_a_while(plays, monkeypatch, problem):
    head = FakeAxis("head")
    calls = does(head, "__aenter__", raises(*[problem] * 5, None), monkeypatch)
    (lane,) = plays(head)
    assert (lane.state, len(calls)) == ("safe", 6)
    assert lane.took_s == pytest.approx(5 * module.AGAIN_S)


def test_one_that_never_connects_is_not_reached_and_nothing_is_sent(plays, monkeypatch):
    head = FakeAxis("head")
    calls = does(head, "__aenter__", raises(CannotConnect("head", "nobody is there")), monkeypatch)
    (lane,) = plays(head)
    assert lane._replace(took_s=0.0) == Lane("head", "not reached", "head: nobody is there", 0.0)
    assert lane.took_s == pytest.approx(CONNECT_S - module.AGAIN_S)
    assert len(calls) == 20
    assert head.calls == []


def test_a_connection_that_hangs_is_not_reached(plays, monkeypatch):
    head = FakeAxis("head")
    does(head, "__aenter__", forever, monkeypatch)
    (lane,) = plays(head)
    assert lane[1:3] == ("not reached", "head: not finished within 10 s")
    assert lane.took_s == pytest.approx(CONNECT_S)


def test_another_instrument_gets_no_command(plays, monkeypatch):
    head = FakeAxis("head")
    does(head, "identify", raises(WrongIdentity("head", "is another one")), monkeypatch)
    (lane,) = plays(head)
    assert lane[1:3] == ("not reached", "head: is another one")
    assert head.calls == ["enter", "exit"]


@pytest.mark.parametrize("kind", [NoAnswer, BadAnswer, LinkLost, InstrumentFault])
def test_one_that_does_not_say_what_it_is_is_made_safe_all_the_same(plays, monkeypatch, kind):
    head = FakeAxis("head")
    does(head, "identify", raises(kind("head", "no")), monkeypatch)
    (lane,) = plays(head)
    assert (lane.state, head.calls) == ("safe", ["enter", "make_safe", "exit"])


def test_one_that_takes_too_long_to_say_it_too(plays, monkeypatch):
    head = FakeAxis("head")
    does(head, "identify", forever, monkeypatch)
    (lane,) = plays(head)
    assert lane.state == "safe"
    assert lane.took_s == pytest.approx(CONNECT_S)


@pytest.mark.parametrize(
    ("problem", "why"),
    [
        (Refused("head", "does not stop"), "head: does not stop"),
        (TimeoutError(), "head: not finished within 7 s"),
        (KeyError("axis"), "head: KeyError: 'axis'"),
    ],
)
def test_one_that_is_not_made_safe_says_why(plays, monkeypatch, problem, why):
    head = FakeAxis("head")
    does(head, "make_safe", raises(problem), monkeypatch)
    (lane,) = plays(head)
    assert lane[1:3] == ("unsafe", why)
    assert head.calls == ["enter", "identify", "exit"]


def test_each_has_its_own_limit_and_delays_no_other(plays, monkeypatch):
    head, supply = FakeAxis("head"), FakeSupply()
    does(head, "make_safe", forever, monkeypatch)
    found = plays(head, supply, limits_s={"head": 3.0, "supply": 5.0})
    assert [(lane.role, lane.state, lane.why) for lane in found] == [
        ("head", "unsafe", "head: not finished within 3 s"), ("supply", "safe", ""),
    ]  # fmt: skip
    assert plays.ended == [("supply", 1.0), ("head", 3.0)]


def test_an_output_that_is_on_again_is_not_safe(plays, monkeypatch):
    supply = FakeSupply()
    does(supply, "read", lambda _: SourceReading(1.0, 0.1, True), monkeypatch)
    (lane,) = plays(supply)
    assert lane[1:3] == (
        "unsafe",
        "supply: was switched on again after it was made safe. Look for the program or the person that does it.",
    )


@pytest.mark.parametrize("act", [raises(NoAnswer("supply", "no")), raises(BadAnswer("supply", "no")), forever])
def test_an_output_that_is_not_read_again_is_safe(plays, monkeypatch, act):
    supply = FakeSupply()
    does(supply, "read", act, monkeypatch)
    (lane,) = plays(supply)
    assert lane[1:3] == ("safe", "")
    assert lane.took_s <= 2.001


@pytest.mark.parametrize("act", [raises(NoAnswer("chamber", "no")), raises(BadAnswer("chamber", "no")), forever])
def test_air_that_is_not_read_is_not_told(plays, monkeypatch, act):
    chamber = FakeChamber(at(60.0, 60.0))
    does(chamber, "state", act, monkeypatch)
    (lane,) = plays(chamber)
    assert lane[1:3] == ("safe", "")
    assert lane.air_c is None
    assert lane.took_s == 0.0


def test_a_connection_that_does_not_close_changes_nothing(plays, monkeypatch):
    head, supply = FakeAxis("head"), FakeSupply()
    calls = does(head, "__aexit__", forever, monkeypatch)
    does(supply, "__aexit__", raises(RuntimeError()), monkeypatch)
    found = plays(head, supply)
    assert [lane.state for lane in found] == ["safe", "safe"]
    assert calls == [0]
    assert plays.took_s == pytest.approx(10.0)


def test_a_driver_that_does_not_end_is_abandoned(plays, monkeypatch):
    head, supply, freed = FakeAxis("head"), FakeSupply(), list[bool]()

    async def stubborn(*_: object) -> None:
        while not freed:
            try:
                await asyncio.sleep(1000)
            except asyncio.CancelledError:
                freed[len(freed) :] = [True] * (len(plays.ended) > 1)

    monkeypatch.setattr(head, "make_safe", stubborn)
    found = plays(head, supply)
    why = "head: not finished within 40 s, and its driver does not end"
    assert found[0] == Lane("head", "unsafe", why, 40.0)
    assert found[1].state == "safe"
    assert plays.ended[:2] == [("supply", 1.0), ("head", 40.0)]
    assert plays.took_s == pytest.approx(40.0)


def test_a_chamber_is_held_that_is_in_order(plays):
    chamber = FakeChamber(at(60.0, 60.0))
    (lane,) = plays(chamber, hold=["chamber"])
    assert lane._replace(took_s=0.0) == Lane("chamber", "held", "", 0.0, 60.0)
    assert chamber.calls == ["enter", "identify", "state", "hold", "state", "exit"]


def test_only_those_are_held_that_may(plays):
    chamber, head = FakeChamber(at(60.0, 60.0)), FakeAxis("head")
    found = plays(chamber, head, hold=["head"])
    assert [lane.state for lane in found] == ["safe", "safe"]


@pytest.mark.parametrize("name", ["state", "hold"])
def test_a_chamber_that_is_not_in_order_is_made_safe_and_not_held(plays, monkeypatch, name):
    chamber = FakeChamber(at(60.0, 60.0))
    does(
        chamber,
        name,
        lambda count: raises(InstrumentFault("chamber", "alarm"))(0) if not count else chamber.now,
        monkeypatch,
    )
    (lane,) = plays(chamber, hold=["chamber"])
    assert lane.state == "safe"
    assert "make_safe" in chamber.calls


def test_a_chamber_that_does_not_answer_in_time_is_not_held(plays, monkeypatch):
    chamber = FakeChamber(at(60.0, 60.0))
    does(chamber, "hold", forever, monkeypatch)
    (lane,) = plays(chamber, hold=["chamber"], limits_s={"chamber": 12.0})
    assert (lane.state, lane.took_s) == ("safe", pytest.approx(5.0))


def test_where_somebody_works_outputs_go_off_and_chambers_stop(plays):
    chamber, supply = FakeChamber(ChamberState(40.0, 50.0, 60.0)), FakeSupply()
    found = plays(chamber, supply, only_off=True, hold=["chamber"])
    assert found[0][1:3] == (
        "unsafe",
        "chamber: was stopped at a set point of 60 °C, since somebody works at the bench. "
        "When the lockout is lifted: bench make-safe.",
    )
    assert chamber.calls == ["enter", "identify", "hold", "state", "exit"]
    assert (found[1].state, supply.output) == ("safe", False)
