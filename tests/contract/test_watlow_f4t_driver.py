"""The driver of the Watlow F4T against the simulated one: the bench file, identity, ramps."""

import asyncio
import math
from typing import Any

import pytest
from pydantic import ValidationError

from drivers.capabilities import ThermalChamber
from drivers.description import known_drivers
from drivers.dialects.watlow_f4t.description import DESCRIPTION, F4TOptions
from drivers.dialects.watlow_f4t.wire import ControlMode, DisplayUnit, LoopRegister
from drivers.errors import BadAnswer, BeyondLimit, InstrumentFault, LinkLost, NotSettled, WrongIdentity
from drivers.kinds.chamber.description import ChamberLimits, ChamberSafe
from simulators.instruments.chambers.watlow_f4t import SimulatedF4T
from simulators.physics.thermal import ChamberPhysics
from tests.support.chamber import LIMITS, WRITES, Chamber, with_chamber


def test_it_is_installed_under_its_name() -> None:
    assert known_drivers()["watlow_f4t"] is DESCRIPTION
    assert DESCRIPTION.channels_of(F4TOptions()) == {"process_value": "°C", "set_point": "°C"}


@pytest.mark.parametrize(
    ("model", "data", "problem"),
    [
        (F4TOptions, {"unit_id": 0}, "is 0, expected at least 1"),
        (F4TOptions, {"unit_id": 248}, "is 248, expected at most 247"),
        (F4TOptions, {"loop": 5}, "is 5, expected at most 4"),
        (F4TOptions, {"word_order": "little"}, "low_first"),
        (F4TOptions, {"poll": "5 min"}, "at most 30 s"),
        (F4TOptions, {"word_oder": "low_first"}, "did you mean 'word_order'"),
        (ChamberLimits, {**LIMITS, "temperature": {"min": "50 °C", "max": "50 °C"}}, "min is not below max"),
        (ChamberLimits, {"temperature": LIMITS["temperature"]}, "missing"),
        (ChamberLimits, {**LIMITS, "ramp_rate": {"max": "0 °C/min"}}, "more than 0"),
        (ChamberSafe, {"temperature": "25"}, "has no unit"),
    ],
)
def test_a_wrong_bench_file_is_told_what_is_wrong(model: Any, data: Any, problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        model.model_validate(data)


# Connecting


def test_it_identifies_itself_by_what_the_wire_can_tell() -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver(pin={"serial": "SIM-F4T-01"}) as driver:
            assert isinstance(driver, ThermalChamber)
            identity = await driver.identify()
        assert (identity.maker, identity.model, identity.serial) == ("Watlow", "F4T", "SIM-F4T-01")
        assert not identity.verified
        assert identity.fingerprint == "display unit °C, set point -70 to 180 °C"
        assert {request[7] for request in chamber.requests} == {3}

    with_chamber(use)


def test_a_controller_in_fahrenheit_is_refused_with_the_remedy() -> None:
    async def use(chamber: Chamber) -> None:
        driver = chamber.driver()
        with pytest.raises(WrongIdentity, match=r"not °C; sent read register 6730; received 30.*°F.*to °C at the"):
            await driver.__aenter__()
        with pytest.raises(WrongIdentity):  # and not used behind that refusal
            await driver.make_safe()
        assert not [request for request in chamber.requests if request[7] in WRITES]

    with_chamber(use, display_unit=DisplayUnit.FAHRENHEIT)


def test_the_wrong_word_order_is_noticed_before_anything_is_written() -> None:
    async def use(chamber: Chamber) -> None:
        driver = chamber.driver(word_order="high_first")
        with pytest.raises(WrongIdentity, match=r"are implausible.*Check options\.word_order"):
            await driver.__aenter__()

    with_chamber(use, word_order="low_first")


def test_set_point_limits_that_are_no_numbers_are_a_bad_answer() -> None:
    async def use(chamber: Chamber) -> None:
        with pytest.raises(BadAnswer, match=r"nan .*sent read 2 registers at 2774; received 0000 7fc0"):
            await chamber.driver().__aenter__()

    with_chamber(use, set_point_limits_c=(math.nan, 180.0))


def test_a_safe_temperature_that_could_not_be_commanded_is_refused_at_the_start() -> None:
    async def use(chamber: Chamber) -> None:
        with pytest.raises(BeyondLimit, match=r"120 °C is beyond the limits of the bench file"):
            await chamber.driver(safe={"temperature": "120 °C"}).__aenter__()
        with pytest.raises(BeyondLimit, match=r"25 °C is beyond the limits of the controller, 30 to 180 °C"):
            await chamber.driver().__aenter__()

    with_chamber(use, set_point_limits_c=(30.0, 180.0))


def test_before_it_was_opened_it_says_so() -> None:
    async def use(chamber: Chamber) -> None:
        with pytest.raises(LinkLost, match="Open the device first"):
            await chamber.driver().ramp_to(30.0, 1.0)

    with_chamber(use)


# Ramps


@pytest.mark.parametrize(
    ("simulator", "options"),
    [
        ({}, {}),
        ({"word_order": "high_first"}, {"word_order": "high_first"}),
        ({"loop": 2, "unit_id": 7}, {"loop": 2, "unit_id": 7}),
        ({}, {"block_reads": False}),
    ],
)
def test_a_ramp_lasts_distance_over_rate_and_the_air_follows(simulator: Any, options: Any) -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver(**options) as driver:
            began_s = chamber.now_s()
            await driver.ramp_to(30.0, 1.0)
            assert chamber.now_s() - began_s == pytest.approx(600.0, abs=1.5)
            set_point_c, air_c = chamber.look()
            assert set_point_c == pytest.approx(30.0, abs=2e-4)
            assert 28.0 < air_c < 30.0
            hottest_c = 0.0
            for _ in range(600):
                await asyncio.sleep(1.0)
                state = await driver.state()
                hottest_c = max(hottest_c, state.process_value_c)
            assert 30.05 < hottest_c < 31.0
            assert (state.set_point_c, state.target_c) == (30.0, 30.0)

    with_chamber(use, physics=ChamberPhysics(limit_cycle_c=0.0), **simulator)


def test_a_ramp_down_and_up_again_each_takes_its_time() -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            for target_c, rate_c_per_min, seconds in ((-40.0, 3.0, 1200.0), (55.5, 0.5, 11460.0)):
                began_s = chamber.now_s()
                await driver.ramp_to(target_c, rate_c_per_min)
                assert chamber.now_s() - began_s == pytest.approx(seconds, abs=1.5)

    with_chamber(use)


def test_a_ramp_to_where_it_is_returns_after_the_read_back() -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            began_s = chamber.now_s()
            await driver.ramp_to(20.0, 1.0)
            assert chamber.now_s() - began_s < 0.1
            assert len(chamber.writes_to(LoopRegister.SET_POINT)) == 1

    with_chamber(use)


def test_polls_give_process_value_and_set_point_while_it_ramps() -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver, asyncio.TaskGroup() as group:
            ramp = group.create_task(driver.ramp_to(22.0, 1.0))
            set_points_c = []
            while not ramp.done():
                readings = await driver.poll()
                assert {name: len(channel) for name, channel in readings.items()} == {
                    "process_value": 1, "set_point": 1,
                }  # fmt: skip
                assert readings["set_point"][0].at_s == pytest.approx(chamber.now_s(), abs=0.01)
                set_points_c.append(readings["set_point"][0].value)
                await asyncio.sleep(0.77)
            assert set_points_c[0] == 20.0
            assert set_points_c[-1] == pytest.approx(22.0, abs=1.0 / 60)
            assert set_points_c == sorted(set_points_c)

    with_chamber(use)


@pytest.mark.parametrize(
    ("temperature_c", "rate_c_per_min", "problem"),
    [
        (100.1, 1.0, r"100.1 °C is beyond the limits of the bench file, -50 to 100 °C; nothing was sent"),
        (-50.1, 1.0, r"-50.1 °C is beyond the limits of the bench file"),
        (math.nan, 1.0, r"nan °C is beyond"),
        (80.2, 1.0, r"80.2 °C is beyond the limits of the controller, -40.1 to 80.1 °C"),
        (-40.2, 1.0, r"-40.2 °C is beyond the limits of the controller"),
        (30.0, 3.1, r"3.1 °C/min is beyond the limits of the bench file, above 0, at most 3 °C/min"),
        (30.0, 0.0, r"0 °C/min is beyond"),
        (30.0, math.nan, r"nan °C/min is beyond"),
    ],
)
def test_beyond_a_limit_nothing_is_sent(temperature_c: float, rate_c_per_min: float, problem: str) -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            asked = len(chamber.requests)
            with pytest.raises(BeyondLimit, match=problem):
                await driver.ramp_to(temperature_c, rate_c_per_min)
            assert len(chamber.requests) == asked

    with_chamber(use, set_point_limits_c=(-40.1, 80.1))


def test_the_limits_of_the_controller_are_allowed_to_the_last_bit() -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            await driver.ramp_to(80.1, 3.0)
            assert (await driver.state()).target_c == pytest.approx(80.1, abs=1e-5)

    with_chamber(use, set_point_limits_c=(-40.1, 80.1))


def test_hold_stops_a_ramp_where_it_is() -> None:
    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            ramp = asyncio.create_task(driver.ramp_to(30.0, 1.0))
            await asyncio.sleep(300.0)
            await driver.hold()
            with pytest.raises(NotSettled, match="the ramp to 30 °C was replaced by another command"):
                await ramp
            await asyncio.sleep(300.0)
            state = await driver.state()
            assert state.set_point_c == state.target_c == pytest.approx(25.0, abs=0.01)

    with_chamber(use)


def test_a_ramp_that_does_not_end_is_told_after_a_tenth_and_two_minutes() -> None:
    class Paused(SimulatedF4T):
        def _follow_set_point(self) -> None:
            """The ramp is paused at the controller."""

    async def use(chamber: Chamber) -> None:
        async with chamber.driver() as driver:
            with pytest.raises(NotSettled, match=r"ramp to 30 °C of 600 s has not ended; received active set point 20"):
                await driver.ramp_to(30.0, 1.0)
            assert chamber.now_s() == pytest.approx(600.0 * 1.1 + 120.0, abs=2.0)

    with_chamber(use, simulator=Paused)


def test_out_of_auto_no_ramp_is_commanded() -> None:
    async def use(chamber: Chamber) -> None:
        chamber.write_behind_its_back(LoopRegister.CONTROL_MODE, (ControlMode.OFF,))
        async with chamber.driver() as driver:
            with pytest.raises(
                InstrumentFault, match="does not follow its set point; received control loop 1 is not in auto, mode off"
            ):
                await driver.ramp_to(30.0, 1.0)
            await driver.state()  # nothing was commanded, so looking is no complaint
            assert chamber.writes_to(LoopRegister.SET_POINT) == []

    with_chamber(use)
