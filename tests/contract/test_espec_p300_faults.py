"""The driver of the ESPEC P300 against a simulated one that refuses, has alarms, or whose line is bad."""

import asyncio
from dataclasses import replace

import pytest

from drivers.errors import BadAnswer, InstrumentFault, Refused
from tests.support.chambers import Rig, with_rig
from tests.support.chambers_ascii import P300

SERIAL = replace(P300, address="serial:///dev/ttyS1?baud=9600")


def test_a_refusal_is_told_with_its_meaning_and_not_repeated() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            rig.instrument.protected = True
            with pytest.raises(
                Refused, match=r"sent TEMP, S25\.0; received NA:PROTECT ON, its settings are protected at the front"
            ):
                await driver.make_safe()
            assert len(rig.commands()) == 1
            await driver.poll()

    with_rig(P300, use)


def test_a_question_that_is_not_known_is_a_refusal() -> None:
    async def use(rig: Rig) -> None:
        rig.wire.alter = lambda request, answer: b"NA:CMD ERR\r\n" if b"ROM?" in request else answer
        with pytest.raises(Refused, match=r"sent ROM\?; received NA:CMD ERR, an unknown command"):
            await rig.driver().__aenter__()

    with_rig(P300, use)


def test_an_alarm_is_a_fault_with_its_code_until_a_person_has_seen_to_it() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.ramp_to(21.0, 1.0)
            rig.instrument.alarm(7)
            rig.instrument.alarm(12)
            with pytest.raises(InstrumentFault, match="the chamber is in mode STANDBY, alarm 7, 12"):
                await driver.poll()
            with pytest.raises(InstrumentFault, match=r"has an alarm; received .* alarm 7, 12\. Remove the cause"):
                await driver.make_safe()
            assert not rig.wire.count(b"MODE,CONSTANT")
            rig.instrument.alarms.clear()
            await driver.make_safe()

    with_rig(P300, use)


def test_a_chamber_that_does_not_start_is_told() -> None:
    async def use(rig: Rig) -> None:
        rig.instrument.execute("MODE,STANDBY")
        async with rig.driver() as driver:
            rig.wire.lose = lambda request: b"MODE,CONSTANT" in request
            with pytest.raises(Refused, match=r"did not go to constant operation; .* in mode STANDBY"):
                await driver.ramp_to(21.0, 1.0)
            assert rig.wire.count(b"MODE,CONSTANT") == 1

    with_rig(P300, use)


def test_making_safe_ends_a_program_that_lets_no_set_point_through() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            rig.wire.alter = lambda request, answer: (
                b"NA:CHB NOT READY\r\n" if P300.commands(request) and rig.instrument.mode == "RUN" else answer
            )
            P300.take_over(rig.instrument)
            await driver.make_safe()
            assert (await driver.state()).target_c == 25.0
            assert rig.set_point_c() == 25.0
            assert len(rig.commands()) == 2

    with_rig(P300, use)


def test_a_power_failure_in_a_ramp_is_seen() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            ramp = asyncio.create_task(driver.ramp_to(30.0, 1.0))
            await asyncio.sleep(100.0)
            rig.instrument.restart()
            with pytest.raises(InstrumentFault, match=r"does not follow its set point; received .* mode OFF"):
                await ramp

    with_rig(P300, use)


ANSWER = b"20.2,20.0,180.0,-70.0\r\n"


@pytest.mark.parametrize("at", range(len(ANSWER)))
def test_an_answer_with_a_byte_lost_or_garbled_is_healed_or_told_and_never_taken(at: int) -> None:
    async def use(rig: Rig) -> None:
        byte = ANSWER[at]
        async with rig.driver() as driver:
            for bad in (b"", bytes([byte ^ 0x40]), bytes([byte ^ 0x01])):
                await driver.make_safe()
                garbled = [ANSWER[:at] + bad + ANSWER[at + 1 :]]
                rig.wire.alter = lambda request, answer, garbled=garbled: (
                    garbled.pop() if b"TEMP?" in request and garbled else answer
                )
                try:
                    state = await driver.state()
                except BadAnswer:
                    state = await driver.state()
                assert state.process_value_c == pytest.approx(rig.air_c(), abs=1.5)
                assert state.set_point_c == 25.0
                assert not garbled

    with_rig(SERIAL, use)


def test_a_process_value_that_is_told_twice_differently_is_no_reading() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            rig.wire.alter = lambda request, answer: b"2.0,,CONSTANT,0\r\n" if b"MON?" in request else answer
            with pytest.raises(
                BadAnswer, match=r"with different values; sent TEMP\? and MON\?; received 20\.\d and 2 °C"
            ):
                await driver.poll()

    with_rig(SERIAL, use)


def test_a_temperature_that_came_wrong_once_is_asked_again_and_noted() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.hold()
            true_c = (await driver.state()).process_value_c
            asked = rig.wire.count(b"TEMP?")
            rig.wire.garble_once(b"20.", b"24.", where=b"TEMP?")
            assert (await driver.state()).process_value_c == true_c
            assert rig.wire.count(b"TEMP?") - asked == 3
            (note,) = rig.notes
            assert note.startswith("its temperature was reported as 24.2 °C, set point 20 °C")
            assert "; repeated: 20.2 °C, set point 20 °C" in note

    with_rig(SERIAL, use)
