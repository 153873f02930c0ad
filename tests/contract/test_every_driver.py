"""What every driver must do, whatever its instrument: one table over all that are installed."""

import asyncio
from contextlib import nullcontext, suppress
from dataclasses import replace
from typing import get_args
from unittest import mock

import pytest

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.description import known_drivers
from drivers.errors import DriverError, NoAnswer, WrongIdentity
from tests.support import instruments
from tests.support.every_driver import EVERY, Opened, bench_of, calls_of

SILENT_S = 30.0  # the longest that a call may take on an instrument that says nothing
PACING_S = 0.35  # the longest that a line has to be still before a question
TICK_S = 0.01
QUESTIONS = ("identify", "poll", "angle", "rate", "read", "state", "wait_for_data")
NAMES = ("maker", "model", "serial", "firmware")
every_driver = pytest.mark.parametrize("driver", EVERY)


def now_s() -> float:
    return asyncio.get_running_loop().time()


def test_a_driver_that_is_installed_and_not_among_the_instruments_fails_all_that_try_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    others = {**known_drivers(), "toy_chamber": known_drivers()["watlow_f4t"]}
    monkeypatch.setattr(instruments, "known_drivers", lambda: others)
    for what in get_args(instruments.What):
        with pytest.raises(AssertionError, match="toy_chamber: not both installed and in"):
            instruments.tried(what)


def test_an_instrument_that_something_does_not_try_has_a_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    untold = {name: replace(each, apart={}) for name, each in instruments.INSTRUMENTS.items()}
    monkeypatch.setattr(instruments, "INSTRUMENTS", untold)
    for what, name in (("bad lines", "can_counter"), ("orders", "agilent_34970a"), ("swaps", "agilent_34970a")):
        with pytest.raises(AssertionError, match=f"{name}: {what} must try it, or .* must say why not"):
            instruments.tried(what)


# Who is there


async def identity_of(driver: str, **pin: str):
    async with Opened(driver).driver(**pin) as device:
        return await device.identify()


@every_driver
def test_another_instrument_is_refused_by_whatever_its_wire_tells(driver: str) -> None:
    async def main() -> None:
        found = await identity_of(driver)
        for name in NAMES:
            if name in EVERY[driver].tells.split():
                assert getattr(found, name)
                with pytest.raises(WrongIdentity, match=f"{name}|kind"):
                    await identity_of(driver, **{name: "SOMEBODY ELSE"})
            else:
                stated = await identity_of(driver, **{name: "AS STATED"})
                assert getattr(stated, name) == "AS STATED"
                assert name != "serial" or (not stated.verified and stated.fingerprint)

    run(main(), AS_FAST_AS_POSSIBLE)


@every_driver
def test_the_instrument_of_the_bench_file_is_taken(driver: str) -> None:
    async def main() -> None:
        found = await identity_of(driver)
        pin = {name: getattr(found, name) for name in EVERY[driver].tells.split()}
        again = await identity_of(driver, **pin)
        assert again == found

    run(main(), AS_FAST_AS_POSSIBLE)


# Acknowledged at once, told later

LAGGING = (
    "set",
    "off",
    "ramp_to",
    "hold",
    "move_to",
    "rotate_at",
    "oscillate",
    "stop",
    "measure",
    "poll",
    "read",
    "state",
)
COMMANDS_NOTHING = frozenset({"can_counter", "can_telemetry"})  # what only sends


@every_driver
@pytest.mark.parametrize("lag_s", [0.3, 1.0])
def test_a_setting_that_is_told_later_than_it_is_acknowledged_is_waited_for(driver: str, lag_s: float) -> None:
    async def main() -> None:
        with mock.patch("simulators.faults.instrument_faults.LAG_S", lag_s):
            opened = Opened(driver)
            opened.faults.begin("lag")
            async with opened.driver() as device:
                for name, call in calls_of(driver).items():
                    if name not in LAGGING or driver in COMMANDS_NOTHING:
                        continue
                    await call(device)
                    await device.poll()
                await device.make_safe()
                await device.poll()

    run(main(), AS_FAST_AS_POSSIBLE)


# What takes how long


@every_driver
def test_no_call_waits_for_ever_on_an_instrument_that_says_nothing(driver: str) -> None:
    async def main() -> None:
        for name, call in calls_of(driver).items():
            opened = Opened(driver)
            async with opened.driver() as device:
                opened.faults.begin("silent")
                began_s = now_s()
                with suppress(DriverError):
                    await asyncio.wait_for(call(device), 10 * SILENT_S)
                assert now_s() - began_s <= SILENT_S, name

    run(main(), AS_FAST_AS_POSSIBLE)


@every_driver
def test_an_answer_is_waited_for_as_long_as_the_instrument_may_take_and_no_longer(driver: str) -> None:
    async def main() -> None:
        opened, reported_s = Opened(driver), list[float]()
        async with opened.driver(lambda _asked_again: reported_s.append(now_s())) as device:
            opened.faults.begin("silent")
            began_s = now_s()
            with suppress(NoAnswer):
                await device.identify()
            waited_s = reported_s[0] - began_s if reported_s else 0.0
            assert waited_s == pytest.approx(EVERY[driver].client_timeout_s, abs=PACING_S)

    run(main(), AS_FAST_AS_POSSIBLE)


@every_driver
@pytest.mark.parametrize("fault", ["silent", "cut"])
def test_an_instrument_that_is_not_there_is_told_in_time(driver: str, fault: str) -> None:
    async def main() -> None:
        opened = Opened(driver)
        opened.faults.begin(fault)
        began_s = now_s()
        device = opened.driver()
        with suppress(DriverError):
            async with device:
                await asyncio.wait_for(device.identify(), 10 * SILENT_S)
                if driver not in ("can_counter", "can_telemetry"):  # identify asks nothing of what only sends
                    raise AssertionError("it was identified")
        assert now_s() - began_s <= SILENT_S

    run(main(), AS_FAST_AS_POSSIBLE)


@every_driver
@pytest.mark.parametrize("fault", ["", "silent", "cut", "stuck", "delay"])
def test_making_safe_ends_in_time_from_any_state_and_twice(driver: str, fault: str) -> None:
    async def main() -> None:
        for name, call in {"nothing": None, **calls_of(driver)}.items():
            asked_only = fault in ("stuck", "delay") and name in QUESTIONS
            if asked_only or (fault in ("silent", "cut") and name != "nothing"):
                continue  # where that is the same again
            opened = Opened(driver)
            async with opened.driver() as device:
                under_way = asyncio.ensure_future(call(device)) if call is not None else None
                await asyncio.sleep(0.35)
                if fault:
                    opened.faults.begin(fault)
                for _ in range(2):
                    began_s = now_s()
                    with suppress(DriverError) if fault else nullcontext():
                        await asyncio.wait_for(device.make_safe(), 10 * SILENT_S)
                    assert now_s() - began_s <= opened.entry.safe_state.within_s + TICK_S, name
                if under_way is not None:
                    under_way.cancel()
                    await asyncio.gather(under_way, return_exceptions=True)

    run(main(), AS_FAST_AS_POSSIBLE)


@every_driver
def test_making_safe_energises_nothing(driver: str) -> None:
    async def main() -> None:
        opened = Opened(driver)
        async with opened.driver() as device:
            before = await device.poll()
            await device.make_safe()
            if hasattr(device, "read"):
                assert not (await device.read()).output
            if hasattr(device, "angle"):
                assert [each.value for each in before["angle"]] == [(await device.angle()).value]
                assert not opened.laboratory.world.axis.moving(now_s())

    run(main(), AS_FAST_AS_POSSIBLE)


def test_a_driver_says_what_making_safe_does_if_it_moves_or_energises_something() -> None:
    for name, member in EVERY.items():
        description = known_drivers()[name]
        words = bench_of(name).devices[member.role].safe_state.words
        energising = {"positioner", "rate_table", "thermal_chamber", "power_supply", "current_source"}
        assert bool(words) == bool(description.capabilities & energising), name
