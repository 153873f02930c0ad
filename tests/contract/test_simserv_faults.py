"""The driver of Weiss and Vötsch chambers against a simulated one that refuses, has errors, or is not understood."""

import asyncio
from dataclasses import replace

import pytest

from drivers.errors import BadAnswer, InstrumentFault, NoAnswer, Refused
from tests.support.chambers import Dialect, Rig, with_rig
from tests.support.chambers_ascii import SIMSERV

IN_FORCE = replace(SIMSERV, options={"set_point_reads": "in_force"})


def test_a_refusal_is_told_with_its_meaning_and_not_repeated() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            rig.wire.alter = lambda request, answer: b"-12\r\n" if SIMSERV.commands(request) else answer
            with pytest.raises(Refused, match=r"received -12, no permission for the user who is logged in"):
                await driver.ramp_to(30.0, 1.0)
            assert len(rig.commands()) == 1
            await driver.poll()

    with_rig(SIMSERV, use)


def test_a_gradient_that_is_kept_as_another_is_told_before_the_ramp_begins() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            rig.wire.alter = lambda request, answer: b"1\xb60.1\r\n" if request.startswith(b"11070") else answer
            with pytest.raises(Refused, match=r"a new gradient; sent .*0\.083; received gradient 0\.1 °C/min"):
                await driver.ramp_to(30.0, 5 / 60)
            assert rig.commands() == []

    with_rig(SIMSERV, use)


def test_an_error_is_a_fault_with_its_text_until_a_person_has_seen_to_it() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.ramp_to(21.0, 1.0)
            rig.instrument.error(2)
            with pytest.raises(InstrumentFault, match="the chamber has an error: Temperature limiter"):
                await driver.poll()
            with pytest.raises(InstrumentFault, match=r"has an error; received Temperature limiter\. Remove the cause"):
                await driver.make_safe()
            assert not rig.wire.count(b"17012")
            rig.instrument.active.clear()
            await driver.make_safe()  # it is off, and stays off

    with_rig(SIMSERV, use)


def test_an_error_without_an_active_message_is_one_too() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.ramp_to(21.0, 1.0)
            rig.instrument.error(2)
            rig.wire.alter = lambda request, answer: b"1\xb60\r\n" if request.startswith(b"17009") else answer
            with pytest.raises(InstrumentFault, match="no message text"):
                await driver.poll()

    with_rig(SIMSERV, use)


def test_a_chamber_that_does_not_start_is_told() -> None:
    async def use(rig: Rig) -> None:
        rig.instrument.execute("14001¶1¶1¶0")
        async with rig.driver() as driver:
            rig.wire.lose = lambda request: request.startswith(b"14001")
            with pytest.raises(Refused, match=r"the chamber did not start; .*; received the chamber is off"):
                await driver.ramp_to(21.0, 1.0)
            assert rig.wire.count(b"14001") == 1

    with_rig(SIMSERV, use)


@pytest.mark.parametrize("dialect", [SIMSERV, IN_FORCE], ids=["target", "in_force"])
def test_making_safe_ends_a_program_that_lets_no_set_point_through(dialect: Dialect) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            rig.wire.alter = lambda request, answer: (
                b"-9\r\n" if SIMSERV.commands(request) and rig.instrument.program else answer
            )
            SIMSERV.take_over(rig.instrument)
            await asyncio.sleep(600.0)
            await driver.make_safe()
            assert (await driver.state()).target_c == 25.0
            await asyncio.sleep(7200.0)
            assert rig.set_point_c() == 25.0
            assert len(rig.commands()) == 2

    with_rig(dialect, use)


def test_a_power_failure_in_a_ramp_is_seen() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            ramp = asyncio.create_task(driver.ramp_to(30.0, 1.0))
            await asyncio.sleep(100.0)
            rig.instrument.restart()
            with pytest.raises(InstrumentFault, match="does not follow its set point; received the chamber is off"):
                await ramp

    with_rig(SIMSERV, use)


def test_where_only_the_ramp_is_told_a_set_point_without_an_acknowledgement_is_not_known() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            rig.wire.lose = SIMSERV.commands
            with pytest.raises(NoAnswer, match="it is unknown whether a new set point was accepted"):
                await driver.ramp_to(22.0, 1.0)
            assert len(rig.commands()) == 1
            rig.wire.lose = lambda _request: False
            await driver.make_safe()
            await asyncio.sleep(3600.0)
            assert rig.set_point_c() == 25.0

    with_rig(IN_FORCE, use)


def test_where_only_the_ramp_is_told_a_set_point_that_sticks_is_seen_by_where_it_should_be() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.ramp_to(20.5, 3.0)
            rig.faults.begin("stuck")
            with pytest.raises(InstrumentFault, match=r"set point 30 °C before; received set point 20\.5 °C now"):
                await driver.ramp_to(30.0, 3.0)
            assert rig.now_s() < 100.0

    with_rig(IN_FORCE, use)


@pytest.mark.parametrize("answer", [b"1\xb6\r\n", b"1\xb620.0\xb61\r\n", b"1\xb6++++\r\n", b"ok\r\n", b"1\r\n"])
def test_an_answer_that_is_not_understood_is_told(answer: bytes) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            rig.wire.alter = lambda request, right: answer if request.startswith(b"11004") else right
            with pytest.raises(BadAnswer, match=r"an invalid answer.*sent '11004\\xb61\\xb61'"):
                await driver.poll()
            rig.wire.alter = lambda _request, right: right
            await driver.poll()

    with_rig(SIMSERV, use)


def test_a_chamber_that_nobody_is_logged_in_at_cannot_be_opened() -> None:
    async def use(rig: Rig) -> None:
        rig.wire.alter = lambda _request, _answer: b"-11\r\n"
        with pytest.raises(BadAnswer, match="refused, -11, nobody is logged in"):
            await rig.driver().__aenter__()

    with_rig(SIMSERV, use)


def test_what_the_driver_did_on_its_own_is_noted() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            lost = [True]
            rig.wire.lose = lambda _request: bool(lost) and lost.pop()
            await driver.poll()
            rig.wire.drop()
            await asyncio.sleep(1.0)
            await driver.poll()
        asked, connected = rig.notes
        assert asked.startswith("asked again: chamber: no answer within 3 s; sent '11004")
        assert connected.startswith("connected and identified again at tcp://127.0.0.1:2049")

    with_rig(SIMSERV, use)
