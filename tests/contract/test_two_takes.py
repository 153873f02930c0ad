"""What enters a result over a serial line without checksum is asked twice, over TCP once; in virtual time."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.errors import BadAnswer
from tests.support.head import ENSEMBLE, XPS, Dialect, Head
from tests.support.source import Source6220, SourceRig
from tests.support.supply import Supply

BEHIND_A_SERVER = "socket://192.168.1.20:4001"


def with_head(dialect: Dialect, use: Callable[[Head, Any], Awaitable[None]], address: str = BEHIND_A_SERVER) -> None:
    async def main() -> None:
        head = Head(dialect)
        head.address = address
        async with head.driver() as driver:
            await use(head, driver)

    run(main(), AS_FAST_AS_POSSIBLE)


def with_source(address: str, use: Callable[[SourceRig, Any], Awaitable[None]]) -> None:
    async def main() -> None:
        source = Source6220(address)
        async with source.driver() as driver:
            await driver.set(0.0012, limit=5, output=True)
            source.wire.requests.clear()
            await use(source, driver)

    run(main(), AS_FAST_AS_POSSIBLE)


def with_supply(use: Callable[[Supply, Any], Awaitable[None]], address: str = BEHIND_A_SERVER) -> None:
    async def main() -> None:
        supply = Supply(address)
        async with supply.driver() as driver:
            await driver.set(15, limit=0.2, output=True)
            supply.wire.requests.clear()
            await use(supply, driver)

    run(main(), AS_FAST_AS_POSSIBLE)


each_dialect = pytest.mark.parametrize("dialect", [ENSEMBLE, XPS], ids=lambda dialect: dialect.description.name)


@each_dialect
@pytest.mark.parametrize(("address", "takes"), [("tcp://127.0.0.1:8000", 1), (BEHIND_A_SERVER, 2)])
def test_the_angle_at_a_dwell_is_asked_as_often_as_its_way_needs(dialect: Dialect, address: str, takes: int) -> None:
    async def use(head: Head, driver: Any) -> None:
        await driver.move_to(30, approach="direct", settle_s=0)
        for ask in (driver.angle, driver.poll):
            before = head.wire.count(dialect.angle)
            await ask()
            assert head.wire.count(dialect.angle) - before == takes
        assert head.notes == []

    with_head(dialect, use, address)


@each_dialect
def test_an_angle_that_came_wrong_once_is_right_and_it_is_noted(dialect: Dialect) -> None:
    async def use(head: Head, driver: Any) -> None:
        await driver.move_to(30, approach="direct", settle_s=0)
        head.wire.garble_once(b"30", b"70", where=dialect.angle)
        assert (await driver.angle()).value == pytest.approx(30)
        assert head.notes == ["the angle was reported as 70.000000°, then as 30.000000°; repeated: 30.000000°"]

    with_head(dialect, use)


@each_dialect
def test_an_angle_that_is_another_each_time_is_no_reading(dialect: Dialect) -> None:
    async def use(head: Head, driver: Any) -> None:
        await driver.move_to(30, approach="direct", settle_s=0)
        digits = iter(b"123")
        head.wire.alter = lambda request, answer: (
            answer.replace(b"30", b"3" + bytes([next(digits)])) if dialect.angle in request else answer
        )
        with pytest.raises(BadAnswer, match=r"reported three times, .*31\.0+°; 32\.0+°; 33\.0+°.* no checksum"):
            await driver.angle()

    with_head(dialect, use)


@each_dialect
def test_an_axis_that_moves_is_looked_at_as_before(dialect: Dialect) -> None:
    async def use(head: Head, driver: Any) -> None:
        async with asyncio.TaskGroup() as group:
            moving = group.create_task(driver.move_to(90, approach="direct", settle_s=0))
            angles = []
            while not moving.done():
                (reading,) = (await driver.poll())["angle"]
                angles.append(reading.value)
                await asyncio.sleep(0.05)
        assert angles == sorted(angles)
        assert len({round(angle) for angle in angles}) > 20
        assert head.notes == []

    with_head(dialect, use)


@pytest.mark.parametrize(("address", "takes"), [("serial:///dev/ttyUSB0?baud=19200", 2), ("tcp://10.0.0.5:1394", 1)])
def test_the_level_of_a_source_is_asked_as_often_as_its_way_needs(address: str, takes: int) -> None:
    async def use(source: SourceRig, driver: Any) -> None:
        for ask in (driver.poll, driver.read):
            await ask()
        assert len(source.wire.requests) == 2 * takes

    with_source(address, use)


def test_a_level_that_came_wrong_once_is_no_second_master() -> None:
    async def use(source: SourceRig, driver: Any) -> None:
        source.wire.garble_once(b"1.2", b"5.2", where=b"RANG?")
        assert (await driver.poll())["current"][0].value == pytest.approx(0.0012)
        (note,) = source.notes
        assert note.startswith("what the source is set to was reported as 0.0052 A in the 0.02 A range")
        assert "; repeated: 0.0012 A in" in note

    with_source("serial:///dev/ttyUSB0?baud=19200", use)


@pytest.mark.parametrize(("address", "takes"), [("tcp://127.0.0.1:5025", 1), (BEHIND_A_SERVER, 2)])
def test_a_supply_is_asked_as_often_as_its_way_needs(address: str, takes: int) -> None:
    async def use(supply: Supply, driver: Any) -> None:
        for ask in (driver.poll, driver.read):
            await ask()
        assert len(supply.wire.requests) == 2 * takes
        assert supply.notes == []

    with_supply(use, address)


def test_a_setting_of_a_supply_that_came_wrong_once_is_no_second_master() -> None:
    async def use(supply: Supply, driver: Any) -> None:
        supply.wire.garble_once(b";1;15", b";1;35", where=b"MEAS")
        assert (await driver.poll())["voltage"][0].value == pytest.approx(15)
        (note,) = supply.notes
        assert note.startswith("what the supply is set to was reported as 35 V, limit 0.2 A, output on, then as 15 V")

    with_supply(use)


def test_what_a_supply_measures_is_no_reading_while_two_takes_differ_and_no_error_either() -> None:
    async def use(supply: Supply, driver: Any) -> None:
        supply.wire.garble_once(b"15.0", b"11.0", where=b"MEAS")
        assert await driver.poll() == {"voltage": [], "current": []}
        (note,) = supply.notes
        assert note.startswith("11 V and 0.06 A were reported, then 15 V and 0.06 A: no reading")
        assert len((await driver.poll())["voltage"]) == 1

    with_supply(use)
