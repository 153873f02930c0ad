"""The driver of the ESPEC P300 against the simulated one: what is its own; the rest is in test_chambers.py."""

import asyncio
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest
from pydantic import ValidationError

from drivers.description import known_drivers
from drivers.dialects.espec_p300.description import DESCRIPTION, P300Options
from drivers.errors import WrongIdentity
from tests.support.chambers import Rig, with_rig
from tests.support.chambers_ascii import P300


def test_it_is_installed_under_its_name() -> None:
    assert known_drivers()["espec_p300"] is DESCRIPTION
    assert DESCRIPTION.channels_of(P300Options()) == {"process_value": "°C", "set_point": "°C"}


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        ({"address": 0}, "at least 1"),
        ({"address": 17}, "at most 16"),
        ({"step": "5 s"}, "at least 10 s"),
        ({"adress": 1}, "did you mean 'address'"),
    ],
)
def test_a_wrong_bench_file_is_told_what_is_wrong(data: Mapping[str, Any], problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        P300Options.model_validate(data)


def test_it_tells_its_kind_and_its_programs() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver(pin={"model": "S2", "firmware": "P300 1.04", "serial": "92001"}) as driver:
            identity = await driver.identify()
        assert (identity.maker, identity.model, identity.serial, identity.firmware) == (
            "ESPEC", "S2", "92001", "P300 1.04",
        )  # fmt: skip
        assert not identity.verified
        assert identity.fingerprint == "controller S2, programs P300 1.04"
        assert rig.wire.requests[:3] == [b"TYPE?\r\n", b"ROM?\r\n", b"TEMP?\r\n"]

    with_rig(P300, use)


@pytest.mark.parametrize(
    ("pin", "problem"),
    [
        ({"model": "S1"}, r"of kind 'S2', expected 'S1'; sent TYPE\?; received T,S2,180\.0\. Check that the right"),
        ({"firmware": "P300 1.05"}, r"firmware is 'P300 1\.04', the bench file says 'P300 1\.05'"),
    ],
)
def test_a_chamber_that_the_bench_file_does_not_name_is_refused(pin: Mapping[str, str], problem: str) -> None:
    async def use(rig: Rig) -> None:
        with pytest.raises(WrongIdentity, match=problem):
            await rig.driver(pin=pin).__aenter__()
        assert not rig.wire.count(b"S25")

    with_rig(P300, use)


def test_every_line_leaves_the_controller_its_time() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            ramp = asyncio.create_task(driver.ramp_to(22.0, 1.0))
            while not ramp.done():
                await driver.poll()
                await asyncio.sleep(1.0)
            await driver.hold()
            await driver.make_safe()
        assert rig.instrument.hurried == 0

    with_rig(P300, use)


def test_a_ramp_sends_a_set_point_only_when_it_changes() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.ramp_to(21.0, 0.2)
            assert [command.strip() for command in rig.commands()] == [
                b"TEMP, S20.0", b"TEMP, S20.1", b"TEMP, S20.2", b"TEMP, S20.3", b"TEMP, S20.4", b"TEMP, S20.5",
                b"TEMP, S20.6", b"TEMP, S20.7", b"TEMP, S20.8", b"TEMP, S20.9", b"TEMP, S21.0",
            ]  # fmt: skip

    with_rig(P300, use)


def test_on_a_line_with_several_it_speaks_to_its_own() -> None:
    async def use(rig: Rig) -> None:
        async with rig.driver() as driver:
            await driver.make_safe()
            assert (await driver.state()).target_c == 25.0
        assert all(request.startswith(b"3,") for request in rig.wire.requests)

    several = replace(P300, address="serial:///dev/ttyS1?baud=9600", options={"address": 3})
    with_rig(several, use)


def test_a_chamber_that_is_off_is_switched_on_and_set_to_constant() -> None:
    async def use(rig: Rig) -> None:
        rig.instrument.execute("MODE,OFF")
        async with rig.driver() as driver:
            await driver.ramp_to(20.0, 1.0)
        assert [request for request in rig.wire.requests if b"?" not in request] == [
            b"TEMP, S20.0\r\n", b"POWER,ON\r\n", b"MODE,CONSTANT\r\n", b"TEMP, S20.0\r\n",
        ]  # fmt: skip

    with_rig(P300, use)
