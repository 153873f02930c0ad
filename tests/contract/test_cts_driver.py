"""The driver of CTS chambers against the simulated one: what is its own; the rest is in test_chambers.py."""

import asyncio
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest
from pydantic import ValidationError

from drivers.description import known_drivers
from drivers.dialects.cts.description import DESCRIPTION, CtsOptions
from drivers.errors import BadAnswer, BeyondLimit, InstrumentFault, NoAnswer, Refused, WrongIdentity
from tests.support.chambers import START_C, Rig, with_rig
from tests.support.chambers_ascii import CTS

SET_25 = bytes.fromhex("02 81 e1 b0 a0 b0 b2 b5 ae b0 d9 03")  # a0 025.0


def begins(*text: str) -> bytes:
    """How the frame of a request to address 1 begins."""
    return bytes.fromhex("02 81") + bytes(ord(letter) | 0x80 for letter in "".join(text))


def test_it_is_installed_under_its_name() -> None:
    assert known_drivers()["cts"] is DESCRIPTION
    assert DESCRIPTION.channels_of(CtsOptions()) == {"process_value": "°C", "set_point": "°C"}


@pytest.mark.parametrize(
    ("data", "problem"),
    [({"address": 0}, "at least 1"), ({"address": 33}, "at most 32"), ({"ramp_channel": 2}, "0 or 1|0, 1|expected")],
)
def test_a_wrong_bench_file_is_told_what_is_wrong(data: Mapping[str, Any], problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        CtsOptions.model_validate(data)


def test_it_tells_its_versions() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver(pin={"model": "T-40/50", "firmware": "2.41;1.07;123456", "serial": "04711"}) as driver:
            identity = await driver.identify()
        assert (identity.maker, identity.model, identity.serial) == ("CTS", "T-40/50", "04711")
        assert not identity.verified
        assert identity.fingerprint == "versions 2.41;1.07;123456"
        with pytest.raises(WrongIdentity, match=r"firmware is '2\.41;1\.07;123456', the bench file says '2\.42'"):
            await rig.driver(pin={"firmware": "2.42"}).__aenter__()

    with_rig(CTS, use)


def test_a_chamber_that_never_tells_its_versions_may_be_used_without() -> None:
    async def use(rig: Rig) -> None:
        rig.instrument.versions = ""
        with pytest.raises(
            NoAnswer,
            match=r"does not report its versions; sent C\. If it never does, set "
            r"options\.vers",
        ):
            await rig.driver().__aenter__()

    async def use_without(rig: Rig) -> None:
        rig.instrument.versions = ""
        async with rig.driver() as driver:
            assert (await driver.identify()).fingerprint == "answers at address 1"
            assert not rig.wire.count(begins("C"))

    with_rig(CTS, use)
    with_rig(replace(CTS, options={"versions": False}), use_without)


def test_a_ramp_is_set_up_and_told_by_the_chamber() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            ramp = asyncio.create_task(driver.ramp_to(25.0, 0.5))
            for _ in range(9):
                await asyncio.sleep(60.0)
                state = await driver.state()
                assert state.set_point_c == pytest.approx(rig.set_point_c(), abs=0.06)
                assert state.target_c == 25.0
            await ramp
            assert [request for request in rig.wire.requests if request[2] & 0x20] == [
                begins("u1 000.5") + b"\xce\x03", begins("d1 000.5") + b"\xdf\x03", SET_25,
            ]  # fmt: skip

    with_rig(CTS, use)


@pytest.mark.parametrize("rate_c_per_min", [5 / 60, 0.25, 0.01])
def test_a_rate_that_cannot_be_spelled_is_refused_before_anything_is_sent(rate_c_per_min: float) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            with pytest.raises(BeyondLimit, match=r"has no rate of 0\.\d+ °C/min; nothing was sent.* 0\.1 °C/min"):
                await driver.ramp_to(25.0, rate_c_per_min)
            assert not rig.wire.count(begins("u"))
            assert rig.commands() == []

    with_rig(CTS, use)


def test_another_ramp_channel_than_the_chamber_has_is_told() -> None:
    async def use(rig: Rig) -> None:
        rig.instrument._ramp_channel = 0
        async with rig.driver() as driver:
            with pytest.raises(NoAnswer, match="sent 'R1'"):
                await driver.ramp_to(25.0, 1.0)

    with_rig(CTS, use)


def test_a_rate_that_is_kept_as_another_is_told_before_the_ramp_begins() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            rig.wire.lose = lambda request: request.startswith(begins("d"))
            with pytest.raises(Refused, match=r"a new rate; sent u1 001\.0 and d1 001\.0; received rates 1 and 999\.9"):
                await driver.ramp_to(25.0, 1.0)
            assert rig.commands() == []

    with_rig(CTS, use)


def test_a_program_is_seen_by_its_set_point_and_a_new_one_ends_it() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.ramp_to(21.0, 1.0)
            rig.instrument.start_program()
            with pytest.raises(InstrumentFault, match="set point 21 °C before; received set point 80 °C now"):
                await driver.poll()
            await driver.make_safe()
            await asyncio.sleep(3600.0)
            assert (await driver.state()).set_point_c == 25.0

    with_rig(CTS, use)


def test_making_safe_ramps_as_the_rates_are() -> None:
    async def use(rig: Rig) -> None:
        rig.instrument.execute("u1 000.5")
        async with rig.driver() as driver:
            await driver.make_safe()
            await asyncio.sleep(300.0)
            assert (await driver.state()).set_point_c == pytest.approx(START_C + 2.5, abs=0.06)

    with_rig(CTS, use)


# Faults


def test_an_error_is_a_fault_with_its_number_until_a_person_has_seen_to_it() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.ramp_to(21.0, 1.0)
            rig.instrument.fail("2")
            with pytest.raises(InstrumentFault, match="the chamber has an error, number '2'"):
                await driver.poll()
            with pytest.raises(InstrumentFault, match=r"has an error; received number '2'\. Remove the cause"):
                await driver.make_safe()
            rig.instrument.error = ""
            await driver.make_safe()  # it is off, and stays off

    with_rig(CTS, use)


@pytest.mark.parametrize(("before", "lost"), [("s1 0", "s1"), ("s3 0", "s3")])
def test_a_chamber_that_does_not_start_is_told(before: str, lost: str) -> None:
    async def use(rig: Rig) -> None:
        rig.instrument.execute(before)
        async with rig.driver() as driver:
            rig.wire.lose = lambda request: request.startswith(begins(lost))
            doing = driver.ramp_to(21.0, 1.0) if before == "s1 0" else driver.make_safe()
            with pytest.raises(Refused, match=r"the chamber did not start; .* received the chamber is (off|paused)"):
                await doing
            assert rig.wire.count(begins(lost)) == 1

    with_rig(CTS, use)


def test_a_set_point_beyond_the_limits_of_the_chamber_is_seen_by_reading_back() -> None:
    async def use(rig: Rig) -> None:
        rig.instrument._limits_c = (-40.0, 80.0)
        async with rig.driver() as driver:
            with pytest.raises(Refused, match=r"sent a0 090\.0; received set point 20 °C"):
                await driver.ramp_to(90.0, 1.0)
            assert len(rig.commands()) == 1

    with_rig(CTS, use)


@pytest.mark.parametrize("at", range(18))
def test_an_answer_with_a_byte_lost_or_garbled_is_told_or_healed_and_never_taken(at: int) -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            for bad in (lambda byte: b"", lambda byte: bytes([byte ^ 0x01]), lambda byte: bytes([byte ^ 0x80])):
                garbled = [bad]

                def garble(request: bytes, answer: bytes, garbled: list[Any] = garbled) -> bytes:
                    if request.startswith(begins("A")) and garbled:
                        return answer[:at] + garbled.pop()(answer[at]) + answer[at + 1 :]
                    return answer

                rig.wire.alter = garble
                try:
                    state = await driver.state()
                except BadAnswer:
                    state = await driver.state()
                assert not garbled
                assert state.set_point_c == START_C
                assert state.process_value_c == pytest.approx(rig.air_c(), abs=0.1)

    with_rig(CTS, use)
