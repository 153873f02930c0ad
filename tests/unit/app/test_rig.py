"""The devices of a bench are opened, made safe and closed together, and none of them holds up another."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

import pytest

from bench.loop import AS_FAST_AS_POSSIBLE, run
from bench.rig import CLOSE_S, GRACE_S, MAKE_SAFE_S, OPEN_S, OpenError, Rig, device_of, limits_to_make_safe
from drivers.capabilities import Device
from drivers.dialects.scpi_supply.driver import ScpiSupply
from drivers.errors import CannotConnect, NoAnswer, Refused, WrongIdentity
from drivers.safe_state import SafeState, at_rest
from drivers.transport.wires import RealWires
from drivers.values import Identity
from tests.support.guarded import FakeAxis, FakeChamber, FakeSupply, at, does, forever, guarded, raises


def rig_of(*devices: Device, **options: Any) -> Rig:
    return Rig({each.name: each for each in devices}, **options)


def played(act: Callable[[], Awaitable[object]]) -> float:
    """Return how long it took, in s."""

    async def main() -> float:
        begun_s = asyncio.get_running_loop().time()
        await act()
        return asyncio.get_running_loop().time() - begun_s

    return run(main(), AS_FAST_AS_POSSIBLE)


def test_every_device_is_opened_identified_and_closed_in_reverse_order():
    head, supply = FakeAxis("head"), FakeSupply()
    order: list[str] = []
    rig = rig_of(head, supply)

    async def main() -> None:
        async with rig as entered:
            assert entered is rig
            assert rig.identities == {"head": Identity(), "supply": Identity()}
        order.extend([*head.calls, *supply.calls])

    played(main)
    assert order == ["enter", "identify", "exit"] * 2
    assert (rig.not_reached, rig.held, list(rig.devices)) == ({}, set(), ["head", "supply"])


def test_what_fails_to_open_is_named_and_the_others_are_closed(monkeypatch):
    head, supply, chamber = FakeAxis("head"), FakeSupply(), FakeChamber(at(20.0, 20.0))
    head.is_silent = True
    does(chamber, "__aenter__", raises(KeyError("x")), monkeypatch)
    rig = rig_of(head, supply, chamber)

    async def main() -> None:
        with pytest.raises(OpenError) as found:
            async with rig:
                pass
        assert str(found.value) == "head: does not answer\nchamber: KeyError: 'x'"

    played(main)
    assert rig.not_reached == {"head": "head: does not answer", "chamber": "chamber: KeyError: 'x'"}
    assert list(rig.devices) == ["supply"]
    assert supply.calls == ["enter", "exit"]


def test_only_what_is_needed_has_to_open():
    head, supply = FakeAxis("head"), FakeSupply()
    head.is_silent = True

    async def main() -> None:
        rig = rig_of(head, supply)
        await rig.open(needed=["supply"])
        assert list(rig.identities) == ["supply"]
        assert list(rig.not_reached) == ["head"]
        with pytest.raises(OpenError):
            await rig_of(head).open(needed=["supply", "head"])
        await rig.close()

    played(main)


def test_one_that_hangs_is_not_waited_for_longer_than_its_time(monkeypatch):
    head = FakeAxis("head")
    does(head, "__aenter__", forever, monkeypatch)
    rig = rig_of(head)

    async def main() -> None:
        with pytest.raises(OpenError, match=r"^head: not finished within 30 s$"):
            await rig.open()

    assert played(main) == pytest.approx(OPEN_S)


def test_another_instrument_gets_nothing_more_and_one_that_is_silent_is_made_safe(monkeypatch):
    head, supply = FakeAxis("head"), FakeSupply()
    does(head, "identify", raises(WrongIdentity("head", "is another one")), monkeypatch)
    does(supply, "identify", raises(NoAnswer("supply", "is silent")), monkeypatch)
    rig = rig_of(head, supply)

    async def main() -> None:
        with pytest.raises(OpenError, match=r"head: is another one\nsupply: is silent"):
            await rig.open()
        assert rig.not_reached == {"head": "head: is another one"}
        assert await rig.make_safe() == {}
        await rig.close()

    played(main)
    assert "make_safe" not in head.calls
    assert supply.output is False


def test_one_that_is_not_identified_and_not_needed_is_left_out(monkeypatch):
    head, supply = FakeAxis("head"), FakeSupply()
    does(head, "identify", raises(NoAnswer("head", "is silent")), monkeypatch)
    rig = rig_of(head, supply)

    async def main() -> None:
        await rig.open(needed=["supply"])
        await rig.close()

    played(main)
    assert rig.not_reached == {"head": "head: is silent"}
    assert (list(rig.devices), list(rig.identities)) == (["supply"], ["supply"])
    assert head.calls == ["enter", "exit"]


def test_an_opening_that_is_cancelled_leaves_out_what_is_not_open(monkeypatch):
    head, supply = FakeAxis("head"), FakeSupply()
    does(head, "__aenter__", forever, monkeypatch)
    rig = rig_of(head, supply)

    async def main() -> None:
        opening = asyncio.create_task(rig.open())
        await asyncio.sleep(1)
        opening.cancel()
        with pytest.raises(asyncio.CancelledError):
            await opening
        assert await rig.make_safe() == {}
        await rig.close()

    played(main)
    assert rig.not_reached == {"head": "head: its opening was cancelled"}
    assert supply.calls == ["enter", "make_safe", "exit"]


def test_a_device_that_does_not_close_is_abandoned(monkeypatch):
    head = FakeAxis("head")
    does(head, "__aexit__", forever, monkeypatch)

    async def main() -> None:
        async with rig_of(head):
            pass

    assert played(main) == pytest.approx(CLOSE_S)


def test_an_error_of_closing_is_told(monkeypatch):
    head = FakeAxis("head")
    does(head, "__aexit__", raises(CannotConnect("head", "is gone")), monkeypatch)

    async def main() -> None:
        with pytest.raises(CannotConnect, match="is gone"):
            async with rig_of(head):
                pass

    played(main)


@pytest.mark.parametrize(
    ("problem", "why"),
    [
        (Refused("head", "does not stop"), "head: does not stop"),
        (TimeoutError(), "head: not finished within 3 s"),
        (RuntimeError("a bug"), "head: RuntimeError: a bug"),
    ],
)
def test_one_that_is_not_made_safe_says_why_and_holds_up_no_other(monkeypatch, problem, why):
    head, supply = FakeAxis("head"), FakeSupply()
    does(head, "make_safe", raises(problem), monkeypatch)

    async def main() -> None:
        assert await rig_of(head, supply, limits_s={"head": 3.0}).make_safe() == {"head": why}

    played(main)
    assert supply.output is False


def test_one_that_hangs_has_its_own_limit(monkeypatch):
    head = FakeAxis("head")
    does(head, "make_safe", forever, monkeypatch)
    rig = rig_of(head, FakeSupply(), limits_s={"head": 3.0})

    async def main() -> None:
        assert await rig.make_safe() == {"head": "head: not finished within 3 s"}

    assert played(main) == pytest.approx(3.0)
    assert rig.safe_within_s == MAKE_SAFE_S + 2 * GRACE_S
    assert rig_of(head, limits_s={"head": 20.0}).safe_within_s == 20 + 2 * GRACE_S
    assert Rig({}).safe_within_s == 2 * GRACE_S


def test_a_driver_that_does_not_end_is_abandoned(monkeypatch):
    head, supply, freed = FakeAxis("head"), FakeSupply(), list[bool]()

    async def stubborn(*_: object) -> None:
        while not freed:
            with suppress(asyncio.CancelledError):
                await asyncio.sleep(1000)

    monkeypatch.setattr(head, "make_safe", stubborn)

    async def main() -> None:
        found = await rig_of(head, supply, limits_s={"head": 3.0, "supply": 4.0}).make_safe()
        assert found == {"head": "not finished within 4 s, and its driver does not end"}
        freed.append(True)
        for task in asyncio.all_tasks() - {asyncio.current_task()}:
            task.cancel()

    assert played(main) == pytest.approx(4.0 + 2 * GRACE_S)


def test_nothing_is_made_safe_where_there_is_nothing():
    async def main() -> None:
        assert await Rig({}).make_safe() == {}

    assert played(main) == 0.0


def test_chambers_that_may_are_held_and_others_are_not():
    chamber, supply = FakeChamber(at(60.0, 60.0)), FakeSupply()
    rig = rig_of(chamber, supply)

    async def main() -> None:
        assert await rig.make_safe(["chamber", "gone"]) == {}
        assert rig.held == {"chamber"}
        assert await rig.make_safe() == {}
        assert rig.held == set()

    played(main)
    assert chamber.calls == ["state", "hold", "make_safe"]
    assert supply.calls == ["make_safe"] * 2


def test_at_a_bench_that_is_locked_out_chambers_are_stopped():
    chamber, supply = FakeChamber(at(40.0, 50.0, 60.0)), FakeSupply()
    rig = rig_of(chamber, supply, is_locked_out=lambda: True)

    async def main() -> None:
        (why,) = (await rig.make_safe(["chamber"])).values()
        assert why.startswith("chamber: was stopped at a set point of 60 °C, since somebody works at the bench")

    played(main)
    assert chamber.calls == ["hold", "state"]
    assert (supply.output, rig.held) == (False, set())


def with_methods(name: str, *methods: str) -> Any:
    """Return a device that has more methods."""
    return type("Device", (FakeAxis,), dict.fromkeys(methods, forever))(name)


@pytest.mark.parametrize(
    ("kind", "device", "name"),
    [
        ("positioner", with_methods("it", "move_to", "angle", "stop"), "Positioner"),
        ("table", with_methods("it", "rotate_at", "oscillate", "stop", "rate", "angle"), "RateTable"),
        ("chamber", FakeChamber(at(20.0, 20.0), "it"), "ThermalChamber"),
        ("source", FakeSupply("it"), "Source"),
        ("counter", with_methods("it", "acquire", "wait_for_data", "drain", "last_seen"), "PulseCounter"),
        ("frame_source", with_methods("it", "acquire", "wait_for_data", "drain", "last_seen"), "FrameSource"),
        ("meter", with_methods("it", "measure"), "Meter"),
    ],
)
def test_a_role_gives_its_device_as_what_it_is(kind, device, name):
    rig = rig_of(FakeAxis("other"), device)
    for _ in range(2):
        assert getattr(rig, kind)("it") is device
        with pytest.raises(TypeError, match=rf"^other is not a {name}$"):
            getattr(rig, kind)("other")


def test_the_limits_are_those_of_the_drivers_and_of_a_hold(tmp_path):
    bench = guarded(tmp_path)
    limits_s = limits_to_make_safe(bench)
    assert limits_s["chamber"] == 7 + 3 + 2 + 5
    assert limits_s["supply"] == bench.devices["supply"].safe_state.within_s + 2
    assert set(limits_s) == set(bench.devices)
    assert at_rest(100.0, 50.0) == SafeState("at rest where it is", 2.0 + 5.0)
    head = bench.devices["head"]
    assert head.safe_state.words == "at rest where it is"
    assert limits_s["head"] == head.safe_state.within_s + 2


def test_a_driver_has_what_the_bench_file_says_of_its_device(tmp_path):
    entry, notes = guarded(tmp_path).devices["supply"], list[str]()
    device = device_of("supply", entry, RealWires(), notes.append)
    assert isinstance(device, ScpiSupply)
    assert device.name == "supply"
