"""The driver of SCPI supplies against the simulated one, in virtual time."""

import asyncio
from typing import Any

import pytest
from pydantic import ValidationError

from drivers.capabilities import Source
from drivers.description import Nothing, known_drivers
from drivers.dialects.scpi_supply.description import DESCRIPTION, SupplyLimits, SupplyOptions
from drivers.dialects.scpi_supply.driver import ScpiSupply
from drivers.errors import BeyondLimit, InstrumentFault, Refused, WrongIdentity
from drivers.transport.memory import Line
from drivers.values import SourceReading
from tests.support.supply import LIMITS, Supply, now_s, with_driver, with_supply

# The bench file and connecting


def test_it_is_installed_under_its_name() -> None:
    assert known_drivers()["scpi_supply"] is DESCRIPTION
    assert DESCRIPTION.channels_of(Nothing()) == {"voltage": "V", "current": "A"}


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        (LIMITS | {"voltage": {"max": "0 V"}}, "more than 0"),
        (LIMITS | {"voltage": {"max": "16 A"}}, "expected a quantity in V"),
        ({"voltage": LIMITS["voltage"]}, "missing"),
        (LIMITS | {"power": {}}, "unknown key; expected voltage or current"),
    ],
)
def test_a_wrong_bench_file_is_told_what_is_wrong(data: Any, problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        SupplyLimits.model_validate(data)


def test_it_identifies_itself() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        assert isinstance(driver, Source)
        identity = await driver.identify()
        assert (identity.model, identity.serial, identity.verified) == ("SIM-PSU", "SIM-PSU-01", True)
        assert supply.commands() == []

    with_driver(use)


def test_another_supply_is_refused_before_anything_is_set() -> None:
    async def use(supply: Supply) -> None:
        with pytest.raises(WrongIdentity, match="serial is 'SIM-PSU-01', the bench file says 'OTHER'"):
            await supply.driver(serial="OTHER").__aenter__()
        assert supply.wire.requests == [b"*IDN?\n"]

    with_supply(use)


# Setting and reading


def test_limit_and_level_are_set_before_the_output_goes_on() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        assert supply.commands() == [b"CURR 0.2", b"VOLT 15", b"OUTP ON"]
        assert supply.unit_powered
        reading = await driver.read()
        assert reading == SourceReading(15.0, pytest.approx(supply.load_a, abs=1e-5), True)
        await driver.set(0, limit=0, output=False)
        assert supply.commands()[3:] == [b"OUTP OFF"]
        assert not supply.unit_powered
        assert await driver.read() == SourceReading(0.0, 0.0, False)
        await driver.set(15, limit=0.2, output=True)
        assert supply.commands()[4:] == [b"OUTP ON"]  # the rest was so already

    with_driver(use)


def test_it_works_over_a_serial_line() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        assert (await driver.read()).output

    with_driver(use, address="serial:///dev/ttyUSB0?baud=19200", line=Line.serial(19200))


@pytest.mark.parametrize(
    ("level_v", "limit_a", "problem"),
    [
        (16.1, 0.1, "the level 16.1 V is outside 0 V to 16 V"),
        (-1, 0.1, "the level -1 V"),
        (15, 0.21, "the current limit 0.21 A is outside 0 A to 0.2 A"),
        (float("nan"), 0.1, "the level nan V"),
    ],
)
def test_beyond_the_limits_nothing_is_sent(level_v: float, limit_a: float, problem: str) -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        sent = len(supply.wire.requests)
        with pytest.raises(BeyondLimit, match=problem):
            await driver.set(level_v, limit=limit_a, output=True)
        assert len(supply.wire.requests) == sent

    with_driver(use)


def test_polling_takes_one_exchange_and_gives_both_channels() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        sent = len(supply.wire.requests)
        found = await driver.poll()
        assert len(supply.wire.requests) == sent + 1
        assert found["voltage"][0].value == 15
        assert found["current"][0] == (pytest.approx(now_s()), pytest.approx(supply.load_a, abs=1e-5))

    with_driver(use)


@pytest.mark.parametrize("word", [b"CURR 0.2", b"VOLT 15", b"OUTP ON"])
def test_a_command_whose_answer_is_lost_is_sent_once_and_decided_by_the_read_back(word: bytes) -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        supply.wire.mute(word)
        await driver.set(15, limit=0.2, output=True)
        assert supply.commands() == [b"CURR 0.2", b"VOLT 15", b"OUTP ON"]
        assert supply.unit_powered

    with_driver(use)


@pytest.mark.parametrize("word", [b"CURR 0.2", b"VOLT 15", b"OUTP ON"])
def test_a_command_that_is_lost_is_refused_and_not_repeated(word: bytes) -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        supply.wire.lose = lambda request: request.startswith(word)
        with pytest.raises(Refused, match="not executed; sent " + word.decode()):
            await driver.set(15, limit=0.2, output=True)
        assert supply.wire.count(word) == 1
        assert not supply.unit_powered

    with_driver(use)


def test_a_stuck_output_is_refused() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        supply.faults.begin("stuck")
        with pytest.raises(Refused, match=r"sent OUTP ON; received 15 V, limit 0.2 A, output off"):
            await driver.set(15, limit=0.2, output=True)

    with_driver(use)


def test_an_error_of_the_instrument_is_quoted_and_its_queue_emptied() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        supply.instrument.trip()
        supply.wire.alter = lambda request, answer: (
            b'-221,"Settings conflict"\n' if request.startswith(b"VOLT") else answer
        )
        with pytest.raises(Refused, match='sent VOLT 15; received -221,"Settings conflict"'):
            await driver.set(15, limit=0.2, output=True)
        assert not supply.unit_powered

    with_driver(use)


def test_a_second_setting_ends_the_first() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        first = asyncio.create_task(driver.set(15, limit=0.2, output=True))
        await asyncio.sleep(0.005)
        await driver.set(12, limit=0.2, output=True)
        with pytest.raises(Refused, match="ended by another command"):
            await first
        assert (await driver.read()).voltage_v == 12
        await driver.poll()

    with_driver(use)


# The watchdog


def watched(use: Any) -> None:
    async def main(supply: Supply) -> None:
        async with supply.driver(watchdog="30 s") as driver:
            await use(supply, driver)

    with_supply(main)


def test_the_watchdog_is_armed_before_the_output_goes_on_and_fed_by_polls() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        assert supply.commands()[-2:] == [b"OUTP:PROT:WDOG:DEL 30", b"OUTP ON"]
        assert supply.wire.requests[-4] == b"OUTP:PROT:WDOG:DEL 30;:OUTP:PROT:WDOG ON;:SYST:ERR?\n"
        for _ in range(20):
            await asyncio.sleep(10)
            assert (await driver.poll())["voltage"][0].value == 15
        await driver.set(0, limit=0, output=False)
        assert supply.commands()[-2:] == [b"OUTP OFF", b"OUTP:PROT:WDOG OFF"]
        await asyncio.sleep(100)
        await driver.poll()

    watched(use)


def test_a_supply_that_nobody_speaks_to_goes_off_and_is_a_fault_afterwards() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        await asyncio.sleep(31)
        with pytest.raises(InstrumentFault, match="its watchdog protection has tripped"):
            await driver.poll()
        assert not supply.unit_powered
        await driver.make_safe()
        with pytest.raises(InstrumentFault, match=r"watchdog protection has tripped.*clear the protection"):
            await driver.set(15, limit=0.2, output=True)
        assert not supply.unit_powered

    watched(use)


def test_a_delay_is_to_the_second() -> None:
    async def use(supply: Supply) -> None:
        async with supply.driver(watchdog="0.51 min") as driver:
            await driver.set(15, limit=0.2, output=True)
            await driver.poll()
        assert b"OUTP:PROT:WDOG:DEL 31" in supply.commands()

    with_supply(use)


def test_a_watchdog_that_somebody_else_ends_is_a_fault() -> None:
    async def use(supply: Supply, driver: ScpiSupply) -> None:
        await driver.set(15, limit=0.2, output=True)
        supply.instrument.session().feed(b"OUTP:PROT:WDOG OFF\n")
        with pytest.raises(InstrumentFault, match="the supply was set to 15 V"):
            await driver.poll()

    watched(use)


@pytest.mark.parametrize("watchdog", ["9 s", "3601 s", "30 V"])
def test_a_watchdog_that_no_supply_has_is_refused(watchdog: str) -> None:
    with pytest.raises(ValidationError, match="watchdog"):
        SupplyOptions.model_validate({"watchdog": watchdog})
