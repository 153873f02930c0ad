"""The driver of Weiss and Vötsch chambers against the simulated one: what is its own; see test_chambers.py as well."""

import asyncio
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest
from pydantic import ValidationError

from drivers.description import known_drivers
from drivers.dialects.simserv.description import DESCRIPTION, SimservOptions
from drivers.errors import InstrumentFault, NotSettled, Refused, WrongIdentity
from tests.support.chambers import START_C, Rig, with_rig
from tests.support.chambers_ascii import SIMSERV

IN_FORCE = replace(SIMSERV, options={"set_point_reads": "in_force"})
both_readings = pytest.mark.parametrize("dialect", [SIMSERV, IN_FORCE], ids=["target", "in_force"])


def test_it_is_installed_under_its_name() -> None:
    assert known_drivers()["simserv"] is DESCRIPTION
    assert DESCRIPTION.channels_of(SimservOptions()) == {"process_value": "°C", "set_point": "°C"}


@pytest.mark.parametrize("data", [{"set_point_reads": "nominal"}, {"step": "15 s"}])
def test_a_wrong_bench_file_is_told_what_is_wrong(data: Mapping[str, Any]) -> None:
    with pytest.raises(ValidationError, match=r"target|unknown key"):
        SimservOptions.model_validate(data)


def test_it_tells_its_type_and_serial_number() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver(pin={"model": "WT3-180/70", "serial": "SIM-01", "maker": "Vötsch"}) as driver:
            identity = await driver.identify()
        assert (identity.maker, identity.model, identity.serial) == ("Vötsch", "WT3-180/70", "SIM-01")
        assert identity.verified

    with_rig(SIMSERV, use)


@pytest.mark.parametrize(
    ("pin", "problem"),
    [
        ({"serial": "59226009"}, "serial number is 'SIM-01', expected '59226009'"),
        ({"model": "WT3-340/70"}, "model is 'WT3-180/70', the bench file says 'WT3-340/70'"),
    ],
)
def test_a_chamber_that_the_bench_file_does_not_name_is_refused(pin: Mapping[str, str], problem: str) -> None:
    async def use(rig: Rig) -> None:
        with pytest.raises(WrongIdentity, match=problem):
            await rig.driver(pin=pin).__aenter__()

    with_rig(SIMSERV, use)


def test_a_chamber_in_fahrenheit_is_refused() -> None:
    async def use(rig: Rig) -> None:
        rig.wire.alter = lambda request, answer: b"1\xb6\xb0F\r\n" if request.startswith(b"11023") else answer
        with pytest.raises(WrongIdentity, match="not a temperature in °C; received unit '°F'"):
            await rig.driver().__aenter__()

    with_rig(SIMSERV, use)


@both_readings
def test_a_ramp_is_told_by_where_it_is(dialect: Any) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            ramp = asyncio.create_task(driver.ramp_to(30.0, 1.0))
            for _ in range(59):
                await asyncio.sleep(10.0)
                state = await driver.state()
                assert state.set_point_c == pytest.approx(rig.set_point_c(), abs=0.06)
                assert state.target_c == 30.0
            await ramp
            assert rig.now_s() == pytest.approx(600.0, abs=5.0)

    with_rig(dialect, use)


@both_readings
def test_a_ramp_that_replaces_another_begins_where_that_was(dialect: Any) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            ramp = asyncio.create_task(driver.ramp_to(90.0, 1.0))
            await asyncio.sleep(600.0)
            ramp.cancel()
            began_s = rig.now_s()
            await driver.ramp_to(25.0, 0.5)
            assert rig.now_s() - began_s == pytest.approx(600.0, abs=10.0)
            assert rig.set_point_c() == pytest.approx(25.0, abs=0.05)

    with_rig(dialect, use)


@pytest.mark.parametrize("foreign_c", [50.0, 10.0, 21.0])
def test_a_foreign_set_point_is_seen_by_where_the_ramp_should_be(foreign_c: float) -> None:
    """One beyond the end of the ramp, 50 °C, is seen when the ramp should have ended."""

    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            ramp = asyncio.create_task(driver.ramp_to(30.0, 3.0))
            await asyncio.sleep(120.0)
            IN_FORCE.set_point(rig.instrument, foreign_c)

            async def watch() -> None:
                await ramp
                while True:
                    await driver.poll()
                    await asyncio.sleep(5.0)

            with pytest.raises(InstrumentFault, match="another master changed the set point"):
                await watch()
            assert rig.now_s() < 200.0 + 60.0
            await driver.make_safe()
            await asyncio.sleep(3600.0)
            assert (await driver.state()).target_c == 25.0

    with_rig(IN_FORCE, use)


def test_the_wrong_reading_is_told_by_the_option_that_may_be_wrong() -> None:
    """The bench file says `target` and the chamber tells where its ramp is."""

    async def use(rig: Rig) -> None:
        rig.instrument._reads = "in_force"
        async with rig.driver() as driver:
            with pytest.raises(Refused, match=r"options\.set_point_reads in the bench file may be wrong"):
                await driver.ramp_to(30.0, 1.0)

    with_rig(SIMSERV, use)


def test_making_safe_ramps_as_the_gradient_is() -> None:
    async def use(rig: Rig) -> None:
        rig.instrument.gradients[11066] = 0.5
        async with rig.driver() as driver:
            await driver.make_safe()
            await asyncio.sleep(300.0)
            assert (await driver.state()).set_point_c == pytest.approx(START_C + 2.5, abs=0.05)
            assert rig.set_point_c() == pytest.approx(START_C + 2.5, abs=0.05)

    with_rig(SIMSERV, use)


@both_readings
def test_hold_stops_where_it_is(dialect: Any) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            ramp = asyncio.create_task(driver.ramp_to(30.0, 1.0))
            await asyncio.sleep(300.0)
            await driver.hold()
            with pytest.raises(NotSettled):
                await ramp
            assert rig.set_point_c() == pytest.approx(25.0, abs=0.1)

    with_rig(dialect, use)
