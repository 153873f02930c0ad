"""What every chamber does, whatever its controller speaks: each test for each dialect of tests/support/chambers.py."""

import asyncio

import pytest

from drivers.capabilities import ThermalChamber
from drivers.errors import (
    BeyondLimit,
    CannotConnect,
    DriverError,
    InstrumentFault,
    LinkLost,
    NoAnswer,
    NotSettled,
    Refused,
    WrongIdentity,
)
from drivers.kinds.chamber.driver import Chamber
from drivers.kinds.chamber.ramp import FAR_AWAY_POLL_S
from tests.support.chambers import START_C, Dialect, Rig, with_rig
from tests.support.instruments import INSTRUMENTS

ALL = [dialect for instrument in INSTRUMENTS.values() for dialect in instrument.dialects]
every_dialect = pytest.mark.parametrize("dialect", ALL, ids=str)
ANSWER_S, QUIET_S = 3.0, 1.5  # an answer that is waited for, and what draining a line adds


async def ramp_until(driver: Chamber, rig: Rig, target_c: float, seconds: float) -> asyncio.Task[None]:
    """A ramp at 1 °C/min, begun so many seconds ago."""
    ramp = asyncio.create_task(driver.ramp_to(target_c, 1.0))
    await asyncio.sleep(seconds)
    return ramp


# Connecting


@every_dialect
def test_it_identifies_itself_and_changes_nothing(dialect: Dialect) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver(pin={"serial": "SIM-01"}) as driver:
            assert isinstance(driver, ThermalChamber)
            identity = await driver.identify()
            assert identity == await driver.identify()
            assert identity.maker
            assert identity.serial == "SIM-01"
            assert identity.verified or identity.fingerprint
            state = await driver.state()
            assert state.set_point_c == state.target_c == pytest.approx(START_C)
        assert rig.commands() == []

    with_rig(dialect, use)


@every_dialect
def test_another_chamber_at_the_same_address_gets_no_command(dialect: Dialect) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            rig.wire.drop()
            dialect.stranger(rig.instrument)
            await asyncio.sleep(1.0)
            reported: list[type[DriverError]] = []
            for _ in range(2):  # the lost connection may be told first
                with pytest.raises((LinkLost, WrongIdentity)) as problem:
                    await driver.poll()
                reported.append(problem.type)
            assert reported[-1] is WrongIdentity
            with pytest.raises(WrongIdentity):
                await driver.make_safe()
        assert rig.commands() == []

    with_rig(dialect, use)


@every_dialect
def test_before_it_was_opened_it_says_so(dialect: Dialect) -> None:
    async def use(rig: Rig) -> None:
        with pytest.raises(LinkLost, match="Open the device first"):
            await rig.driver().ramp_to(30.0, 1.0)

    with_rig(dialect, use)


# Ramps


@every_dialect
@pytest.mark.parametrize(("target_c", "rate_c_per_min"), [(26.0, 1.0), (8.0, 3.0), (20.5, 0.5)])
def test_a_ramp_takes_distance_over_rate(dialect: Dialect, target_c: float, rate_c_per_min: float) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            began_s = rig.now_s()
            ramp = asyncio.create_task(driver.ramp_to(target_c, rate_c_per_min))
            takes_s = abs(target_c - START_C) / rate_c_per_min * 60
            await asyncio.sleep(takes_s / 2)
            assert rig.set_point_c() == pytest.approx((START_C + target_c) / 2, abs=dialect.within_c + 0.05)
            await ramp
            assert rig.now_s() - began_s == pytest.approx(takes_s, abs=17.0)  # a stair, and the exchanges before it
            assert rig.set_point_c() == pytest.approx(target_c, abs=1e-4)
            state = await driver.state()
            assert (state.set_point_c, state.target_c) == (pytest.approx(target_c, abs=1e-4),) * 2
            await asyncio.sleep(3600.0)
            assert (await driver.state()).process_value_c == pytest.approx(target_c, abs=0.7)

    with_rig(dialect, use)


@every_dialect
def test_a_ramp_to_where_it_is_returns_after_the_read_back(dialect: Dialect) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            began_s = rig.now_s()
            await driver.ramp_to(START_C, 1.0)
            assert rig.now_s() - began_s < 6.0
            assert len(rig.commands()) <= 1  # what is there already need not be sent

    with_rig(dialect, use)


@every_dialect
def test_hold_stops_a_ramp_where_it_is(dialect: Dialect) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            ramp = await ramp_until(driver, rig, 30.0, 300.0)
            await driver.hold()
            with pytest.raises(NotSettled, match="the ramp to 30 °C was replaced by another command"):
                await ramp
            held_c = rig.set_point_c()
            assert held_c == pytest.approx(25.0, abs=dialect.within_c + 0.05)
            await asyncio.sleep(300.0)
            assert rig.set_point_c() == pytest.approx(held_c, abs=0.1)
            assert (await driver.state()).target_c == pytest.approx(held_c, abs=0.1)

    with_rig(dialect, use)


@every_dialect
@pytest.mark.parametrize(("target_c", "rate_c_per_min"), [(100.2, 1.0), (-50.2, 1.0), (30.0, 3.1), (30.0, 0.0)])
def test_beyond_a_limit_of_the_bench_nothing_is_sent(dialect: Dialect, target_c: float, rate_c_per_min: float) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            asked = len(rig.wire.requests)
            with pytest.raises(BeyondLimit, match="bench file"):
                await driver.ramp_to(target_c, rate_c_per_min)
            assert len(rig.wire.requests) == asked

    with_rig(dialect, use)


@pytest.mark.parametrize("dialect", [dialect for dialect in ALL if dialect.limits], ids=str)
def test_beyond_a_limit_of_the_controller_nothing_is_sent(dialect: Dialect) -> None:
    async def use(rig: Rig) -> None:
        assert dialect.limits is not None
        dialect.limits(rig.instrument)
        async with rig.driver() as driver:
            asked = len(rig.wire.requests)
            for target_c in (80.3, -40.3):
                with pytest.raises(BeyondLimit, match=r"limits of the controller, -40\.1 to 80\.1 °C"):
                    await driver.ramp_to(target_c, 1.0)
            assert len(rig.wire.requests) == asked
            await driver.ramp_to(20.1, 1.0)
        with pytest.raises(BeyondLimit, match=r"90 °C is beyond the limits of the controller"):
            await rig.driver(safe={"temperature": "90 °C"}).__aenter__()

    with_rig(dialect, use)


# Somebody or something else


@every_dialect
@pytest.mark.parametrize("foreign_c", [50.0, 10.0])
def test_a_foreign_set_point_is_seen_by_the_next_look(dialect: Dialect, foreign_c: float) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            ramp = await ramp_until(driver, rig, 30.0, 100.5)
            dialect.set_point(rig.instrument, foreign_c)
            with pytest.raises(InstrumentFault, match="another master changed the set point"):
                await driver.poll()
            with pytest.raises(InstrumentFault, match="another master changed the set point"):
                await ramp
            await driver.make_safe()
            assert (await driver.state()).target_c == 25.0

    with_rig(dialect, use)


@every_dialect
def test_a_foreign_set_point_at_rest_is_seen_too(dialect: Dialect) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.ramp_to(21.0, 1.0)
            await driver.poll()
            dialect.set_point(rig.instrument, 21.2)
            await asyncio.sleep(60.0)
            with pytest.raises(InstrumentFault, match=r"set point 21 °C before; received set point 21\.2"):
                await driver.poll()

    with_rig(dialect, use)


@every_dialect
def test_a_chamber_that_follows_something_else_is_seen_and_made_safe(dialect: Dialect) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.ramp_to(21.0, 1.0)
            dialect.take_over(rig.instrument)
            with pytest.raises(InstrumentFault, match=r"somebody else changed|does not follow its set point"):
                await driver.poll()
            if not dialect.gives_back:
                with pytest.raises(InstrumentFault):
                    await driver.make_safe()
                return
            await driver.make_safe()
            assert (await driver.state()).target_c == 25.0
            await asyncio.sleep(7200.0)
            assert rig.air_c() == pytest.approx(25.0, abs=0.7)

    with_rig(dialect, use)


@every_dialect
def test_a_chamber_that_is_off_is_started_by_a_ramp_or_left_to_a_person(dialect: Dialect) -> None:
    async def use(rig: Rig) -> None:
        dialect.switch_off(rig.instrument)
        async with rig.driver() as driver:
            await driver.state()
            await driver.make_safe()  # it stays off
            with pytest.raises(InstrumentFault, match="does not follow its set point"):
                await driver.state()
            if not dialect.switched_on:
                with pytest.raises(InstrumentFault, match="does not follow its set point"):
                    await driver.ramp_to(22.0, 1.0)
                return
            await driver.ramp_to(22.0, 1.0)
            await driver.poll()
            assert rig.set_point_c() == pytest.approx(22.0, abs=dialect.within_c)

    with_rig(dialect, use)


@every_dialect
def test_a_frozen_process_value_is_seen_ten_minutes_into_a_ramp(dialect: Dialect) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            ramp = await ramp_until(driver, rig, 50.0, 100.0)
            rig.faults.begin("frozen")
            with pytest.raises(InstrumentFault, match=r"not changed for 10 min of a moving set point"):
                await ramp
            assert rig.now_s() == pytest.approx(700.0, abs=30.0)
            await driver.make_safe()

    with_rig(dialect, use)


@every_dialect
def test_a_set_point_that_sticks_is_seen(dialect: Dialect) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            rig.faults.begin("stuck")
            with pytest.raises(Refused):
                await driver.ramp_to(30.0, 1.0)
            with pytest.raises(Refused):
                await driver.make_safe()

    with_rig(dialect, use)


# Answers that do not come


@every_dialect
def test_a_set_point_whose_answer_is_lost_was_set_and_is_not_sent_twice(dialect: Dialect) -> None:
    async def use(rig: Rig) -> None:
        rig.wire.alter = lambda request, answer: b"" if dialect.commands(request) else answer
        async with rig.driver() as driver:
            await driver.ramp_to(START_C + 0.1, 3.0)
            sent = rig.commands()
            assert len(sent) == len(set(sent)) == 1
            assert rig.set_point_c() == pytest.approx(START_C + 0.1, abs=1e-4)

    with_rig(dialect, use)


@every_dialect
def test_a_set_point_that_is_lost_is_told_and_not_sent_twice(dialect: Dialect) -> None:
    async def use(rig: Rig) -> None:
        rig.wire.lose = dialect.commands
        async with rig.driver() as driver:
            with pytest.raises((NoAnswer, Refused)):
                await driver.ramp_to(START_C + 0.1, 3.0)
            assert len(rig.commands()) == 1
            assert rig.set_point_c() == START_C

    with_rig(dialect, use)


@every_dialect
def test_a_question_whose_answer_is_lost_is_asked_again(dialect: Dialect) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            lost = [True]
            rig.wire.lose = lambda _request: bool(lost) and lost.pop()
            assert (await driver.state()).set_point_c == START_C
            rig.faults.begin("silent")
            with pytest.raises(NoAnswer):
                await driver.poll()

    with_rig(dialect, use)


@every_dialect
@pytest.mark.parametrize("request_number", range(1, 26, 3))
def test_silence_from_any_request_on_is_told_within_bounded_time(dialect: Dialect, request_number: int) -> None:
    async def use(rig: Rig) -> None:
        silent_since_s: list[float] = []

        def lose(_request: bytes) -> bool:
            if len(rig.wire.requests) >= request_number:
                silent_since_s.append(rig.now_s())
            return bool(silent_since_s)

        async def ramp_up_and_up() -> None:
            async with rig.driver() as driver:
                for target_c in range(21, 100):
                    await driver.ramp_to(float(target_c), 3.0)

        rig.wire.lose = lose
        with pytest.raises(NoAnswer):
            await ramp_up_and_up()
        assert rig.now_s() - silent_since_s[0] < 4 * ANSWER_S + QUIET_S
        assert len(silent_since_s) <= 3  # it once, perhaps once more, and the question who is there
        assert len(rig.commands()) == len(set(rig.commands()))

    with_rig(dialect, use)


@every_dialect
def test_a_cut_in_a_ramp_is_told_soon(dialect: Dialect) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            ramp = await ramp_until(driver, rig, 30.0, 100.0)
            rig.faults.begin("cut")
            with pytest.raises((LinkLost, CannotConnect)):
                await ramp
            assert rig.now_s() < 100.0 + 15.0 + FAR_AWAY_POLL_S

    with_rig(dialect, use)


# The safe state


@every_dialect
def test_a_controller_that_acknowledges_before_it_tells_is_ramped_and_made_safe(dialect: Dialect) -> None:
    async def use(rig: Rig) -> None:
        rig.faults.begin("lag")
        async with rig.driver() as driver:
            await driver.ramp_to(21.0, 3.0)
            await driver.poll()
            assert rig.set_point_c() == pytest.approx(21.0, abs=dialect.within_c)
            began_s = rig.now_s()
            await driver.make_safe()
            assert rig.now_s() - began_s < rig.safe_within_s
            assert (await driver.state()).target_c == 25.0
            await asyncio.sleep(600.0)
            assert rig.set_point_c() == pytest.approx(25.0, abs=1e-4)
            if dialect.gives_back:
                dialect.take_over(rig.instrument)
                await asyncio.sleep(60.0)
                await driver.make_safe()
                assert (await driver.state()).target_c == 25.0

    with_rig(dialect, use)


@every_dialect
@pytest.mark.parametrize("requests", range(0, 24, 3))
def test_it_is_made_safe_from_any_moment_of_a_ramp(dialect: Dialect, requests: int) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            opened = len(rig.wire.requests)
            ramp = asyncio.create_task(driver.ramp_to(40.0, 3.0))
            if requests:
                await rig.wire.heard(opened + requests)
            ramp.cancel()
            began_s = rig.now_s()
            await driver.make_safe()
            assert rig.now_s() - began_s < rig.safe_within_s
            with pytest.raises(asyncio.CancelledError):
                await ramp
            await driver.make_safe()
            assert (await driver.state()).target_c == 25.0
            await asyncio.sleep(7200.0)
            assert rig.set_point_c() == pytest.approx(25.0, abs=1e-4)

    with_rig(dialect, use)


@every_dialect
def test_making_safe_ends_a_ramp_that_goes_on(dialect: Dialect) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver(safe={"temperature": "28 °C"}) as driver:
            ramp = await ramp_until(driver, rig, 90.0, 50.0)
            await driver.make_safe()
            with pytest.raises(NotSettled, match="replaced by another command"):
                await ramp
            assert (await driver.state()).target_c == 28.0

    with_rig(dialect, use)


@every_dialect
def test_making_safe_connects_again_after_a_lost_connection(dialect: Dialect) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            ramp = await ramp_until(driver, rig, 90.0, 100.2)
            ramp.cancel()
            rig.wire.drop()
            await asyncio.sleep(5.0)
            began_s = rig.now_s()
            await driver.make_safe()
            assert rig.now_s() - began_s < rig.safe_within_s
            assert len(rig.wire.connections) == 2
            assert (await driver.state()).target_c == 25.0

    with_rig(dialect, use)


@every_dialect
@pytest.mark.parametrize("fault", ["silent", "cut"])
def test_what_cannot_be_made_safe_says_so_in_time(dialect: Dialect, fault: str) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            rig.faults.begin(fault)  # type: ignore[arg-type]  # a parameter of the test
            began_s = rig.now_s()
            with pytest.raises((NoAnswer, LinkLost, CannotConnect), match="chamber: "):
                await driver.make_safe()
            assert rig.now_s() - began_s <= rig.safe_within_s + 0.01

    with_rig(dialect, use)


@every_dialect
def test_a_safe_set_point_whose_answer_is_lost_is_sent_once(dialect: Dialect) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            rig.wire.alter = lambda request, answer: b"" if dialect.commands(request) else answer
            await driver.make_safe()
            assert len(rig.commands()) == 1
            assert (await driver.state()).target_c == 25.0

    with_rig(dialect, use)


@every_dialect
def test_making_safe_heals_when_the_silence_ends(dialect: Dialect) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            rig.wire.lose = lambda _request: rig.now_s() < 9.0
            with pytest.raises(NoAnswer):
                await driver.poll()
            await asyncio.sleep(max(0.0, 9.0 - rig.now_s()))
            await driver.make_safe()
            assert (await driver.state()).target_c == 25.0

    with_rig(dialect, use)


@every_dialect
def test_leaving_closes_the_wire_and_changes_nothing_else(dialect: Dialect) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.ramp_to(20.5, 3.0)
            sent = len(rig.wire.requests)
        await asyncio.sleep(1.0)
        assert len(rig.wire.requests) == sent
        assert rig.set_point_c() == pytest.approx(20.5, abs=1e-4)
        assert all(tap.transport is not None and tap.transport.is_closing() for tap in rig.wire.connections)

    with_rig(dialect, use)
