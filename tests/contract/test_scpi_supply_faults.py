"""The driver of SCPI supplies: surprises and the safe state."""

import asyncio
from typing import Any

import pytest

from drivers.dialects.scpi_supply.driver import ScpiSupply
from drivers.errors import (
    BadAnswer,
    BeyondLimit,
    CannotConnect,
    InstrumentFault,
    LinkLost,
    NoAnswer,
    Refused,
    WrongIdentity,
)
from tests.support.supply import Supply, now_s, with_driver, with_supply

# Surprises


def test_a_trip_is_a_fault_within_one_poll() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        await driver.poll()
        supply.instrument.trip()
        for _ in range(2):
            with pytest.raises(InstrumentFault, match=r"was set to 15 V, .* output on; received 15 V, .* output off"):
                await driver.poll()

    with_driver(use)


@pytest.mark.parametrize("line", [b"VOLT 12\n", b"CURR 0.15\n", b"OUTP OFF\n", b"*RST\n"])
def test_a_second_master_is_a_fault_within_one_poll(line: bytes) -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        supply.instrument.session().feed(line)
        with pytest.raises(InstrumentFault, match="another master"):
            await driver.poll()

    with_driver(use)


def test_an_output_that_somebody_switched_on_is_a_fault() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.poll()
        await driver.make_safe()
        supply.instrument.session().feed(b"VOLT 5;:OUTP ON\n")
        with pytest.raises(InstrumentFault, match=r"output off; received .* output on"):
            await driver.poll()

    with_driver(use)


def test_a_power_failure_is_a_fault() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        supply.instrument.restart()
        with pytest.raises(InstrumentFault):
            await driver.poll()

    with_driver(use)


@pytest.mark.parametrize("answer", [b"9.91E37;0;1;15;0.2\n", b"NAN;0;1;15;0.2\n", b"15;0;1\n", b"15;0;1;15;0.2;7\n"])
def test_an_answer_that_is_no_reading_gives_no_value(answer: bytes) -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        supply.wire.alter = lambda request, good: answer if b"MEAS" in request else good
        with pytest.raises(BadAnswer, match="an invalid answer"):
            await driver.poll()
        supply.wire.alter = lambda _request, good: good
        await driver.poll()

    with_driver(use)


def test_measured_values_that_stand_still_are_given_as_they_are() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        await driver.poll()
        supply.faults.begin("frozen")
        await driver.set(10, limit=0.2, output=True)
        assert (await driver.poll())["voltage"][0].value == 15

    with_driver(use)


@pytest.mark.parametrize(("kind", "error"), [("silent", NoAnswer), ("cut", LinkLost)])
def test_a_lost_supply_is_reported_in_time(kind: Any, error: type[Exception]) -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        supply.faults.begin(kind)
        start_s = now_s()
        with pytest.raises(error):
            await driver.poll()
        assert now_s() - start_s <= 5.1  # it is asked twice, on a line that is quiet again

    with_driver(use)


# The safe state


def test_making_safe_is_idempotent() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        await driver.make_safe()
        assert not supply.unit_powered
        await driver.make_safe()
        await driver.poll()

    with_driver(use)


def test_making_safe_switches_off_at_once_though_a_question_is_not_answered() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        supply.wire.mute(b"MEAS")
        poll = asyncio.create_task(driver.poll())
        await asyncio.sleep(0.5)
        start_s = now_s()
        safe = asyncio.create_task(driver.make_safe())
        await asyncio.sleep(0.01)
        assert not supply.unit_powered
        supply.wire.alter = lambda _request, answer: answer
        await safe
        assert now_s() - start_s < 5
        with pytest.raises(Refused, match="aborted, the instrument"):
            await poll

    with_driver(use)


@pytest.mark.parametrize("requests", range(1, 8))
@pytest.mark.parametrize("later_s", [0.0, 0.0005, 0.001, 0.0015])
def test_making_safe_ends_a_setting_wherever_it_is(requests: int, later_s: float) -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        setting = asyncio.create_task(driver.set(15, limit=0.2, output=True))
        await supply.wire.heard(2 + requests)
        await asyncio.sleep(later_s)
        await driver.make_safe()
        await asyncio.gather(setting, return_exceptions=True)
        assert not supply.unit_powered
        safe = supply.wire.requests.index(b"OUTP OFF\n")
        assert not [request for request in supply.wire.requests[safe:] if b"OUTP ON" in request]

    with_driver(use)


def test_making_safe_connects_and_identifies_again() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        supply.wire.drop()
        await asyncio.sleep(0.1)
        await driver.make_safe()
        assert not supply.unit_powered
        assert len(supply.wire.connections) == 2

    with_driver(use)


def test_making_safe_does_not_touch_another_supply() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        supply.wire.drop()
        await asyncio.sleep(0.1)
        supply.wire.alter = lambda request, answer: answer.replace(b"SIM-PSU-01", b"SIM-PSU-02")
        with pytest.raises(WrongIdentity):
            await driver.make_safe()
        assert supply.wire.count(b"OUTP OFF") == 0

    with_driver(use)


def test_what_cannot_be_made_safe_says_so_in_time() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        supply.faults.begin("stuck")
        with pytest.raises(Refused, match="not executed; sent OUTP OFF"):
            await driver.make_safe()
        supply.faults.begin("silent")
        start_s = now_s()
        with pytest.raises(NoAnswer):
            await driver.make_safe()
        assert now_s() - start_s <= 5
        supply.wire.drop()
        supply.wire.broken = True
        await asyncio.sleep(0.1)
        with pytest.raises(CannotConnect):
            await driver.make_safe()

    with_driver(use)


# What some supplies tell beyond the core

ALL = ("maximum", "over_voltage", "over_current")


@pytest.mark.parametrize(("trip", "reported"), [("over_voltage", "over-voltage"), ("over_current", "over-current")])
def test_a_protection_that_trips_is_told_by_its_name_and_never_cleared_from_here(trip: str, reported: str) -> None:
    async def use(supply: Supply) -> None:
        async with supply.driver(answers=ALL) as driver:
            await driver.set(15, limit=0.2, output=True)
            await driver.poll()
            supply.instrument.trip(trip)
            assert not supply.unit_powered
            for _ in range(2):
                with pytest.raises(
                    InstrumentFault, match=rf"its {reported} protection has tripped; received .* output off"
                ):
                    await driver.poll()
            sent = supply.wire.count(b"OUTP ON")
            with pytest.raises(InstrumentFault, match=f"{reported} protection"):
                await driver.set(15, limit=0.2, output=True)
            assert supply.wire.count(b"OUTP ON") == sent
            await driver.make_safe()
            assert not [line for line in supply.wire.requests if b"CLE" in line]

    with_supply(use)


def test_a_supply_that_does_not_tell_of_its_protection_shows_it_in_its_output() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        supply.instrument.trip("over_voltage")
        with pytest.raises(InstrumentFault, match="Look for a trip"):
            await driver.poll()
        with pytest.raises(Refused, match="-221"):
            await driver.set(15, limit=0.2, output=True)
        assert supply.wire.count(b"PROT") == 0

    with_driver(use)


def test_what_the_supply_itself_cannot_do_is_refused_before_it_is_set() -> None:
    async def use(supply: Supply) -> None:
        supply.wire.alter = lambda request, answer: b"10.000;3.0000\n" if b"MAX" in request else answer
        async with supply.driver(answers=("maximum",)) as driver:
            with pytest.raises(BeyondLimit, match=r"the level 15 V is outside 0 V to 10 V\. Nothing was set"):
                await driver.set(15, limit=0.2, output=True)
            assert supply.commands() == []
            await driver.set(10, limit=0.2, output=True)
            assert supply.unit_powered

    with_supply(use)


@pytest.mark.parametrize("answer", [b"32\n", b"32;MAX\n", b"32;3;1\n"])
def test_a_maximum_that_is_no_answer_sets_nothing(answer: bytes) -> None:
    async def use(supply: Supply) -> None:
        supply.wire.alter = lambda request, good: answer if b"MAX" in request else good
        async with supply.driver(answers=ALL) as driver:
            with pytest.raises(BadAnswer):
                await driver.set(15, limit=0.2, output=True)
            assert supply.commands() == []

    with_supply(use)
