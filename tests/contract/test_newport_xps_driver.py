"""The driver of the Newport XPS against the simulated one, in virtual time; what all heads share is tested once."""

import asyncio
from typing import Any

import pytest
from pydantic import ValidationError

from drivers.capabilities import Positioner
from drivers.description import known_drivers
from drivers.dialects.newport_xps.axis import NewportXps
from drivers.dialects.newport_xps.description import DESCRIPTION, XpsOptions
from drivers.errors import BadAnswer, BeyondLimit, InstrumentFault, Refused, WrongIdentity
from tests.support.head import XPS, XPS_OPTIONS, Head, now_s, with_driver, with_head

# The bench file


def test_it_is_installed_under_its_name() -> None:
    assert known_drivers()["newport_xps"] is DESCRIPTION
    options = XpsOptions.model_validate(XPS_OPTIONS)
    assert (options.group, options.positioner) == ("HEAD", "Pos")
    assert DESCRIPTION.channels_of(options) == {"angle": "°"}


@pytest.mark.parametrize(
    ("changes", "problem"), [({"group": "HEAD.Pos"}, "a name such as HEAD"), ({"axis": "X"}, "axis")]
)
def test_a_wrong_bench_file_is_told_what_is_wrong(changes: dict[str, Any], problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        XpsOptions.model_validate(XPS_OPTIONS | changes)


# Connecting


def test_it_identifies_itself_by_what_the_wire_can_tell() -> None:
    async def use(head: Head, driver: NewportXps) -> None:
        assert isinstance(driver, Positioner)
        identity = await driver.identify()
        assert (identity.maker, identity.model, identity.serial) == ("Newport", "XPS-C8", "SIM-HEAD-01")
        assert identity.firmware == "XPS-C8 Firmware V2.6.1"
        assert not identity.verified
        assert identity.fingerprint == "HEAD.Pos up to 80 °/s and 320 °/s²"
        assert len(head.wire.connections) == 3

    with_driver(use, XPS)


def test_another_controller_in_its_place_is_refused() -> None:
    async def use(head: Head, driver: NewportXps) -> None:
        head.controller.firmware = "XPS-Q8 Firmware V3.2.0"
        with pytest.raises(WrongIdentity, match=r"another instrument.*received 0,XPS-Q8"):
            await driver.identify()

    with_driver(use, XPS)


@pytest.mark.parametrize(
    "answer", [b"-4,FirmwareVersionGet(char *),EndOfAPI", b"0,ESP300 3.08,EndOfAPI", b"?,EndOfAPI"]
)
def test_what_is_no_xps_is_not_connected(answer: bytes) -> None:
    async def use(head: Head) -> None:
        head.wire.alter = lambda _request, _answer: answer
        with pytest.raises(BadAnswer, match=r"sent 'FirmwareVersionGet\(char \*\)'"):
            await head.driver().__aenter__()

    with_head(use, XPS)


def test_a_group_that_does_not_exist_is_told_with_the_controllers_words() -> None:
    async def use(head: Head) -> None:
        with pytest.raises(Refused, match=r"Positioner Name doesn't exist.*sent PositionerUserTravel.*check the group"):
            await head.driver(group="TABLE").__aenter__()

    with_head(use, XPS)


# Moving


def test_a_move_sets_the_rate_goes_settles_and_reads_back() -> None:
    async def use(head: Head, driver: NewportXps) -> None:
        start_s = now_s()
        reading = await driver.move_to(40, approach="direct", settle_s=3)
        assert reading.value == 40
        travel_s = 40 / 20 + 20 / 40
        assert now_s() - start_s == pytest.approx(travel_s + 1 + 3, abs=0.25)
        assert b"PositionerSGammaParametersSet(HEAD.Pos,20.0,40.0,0.04,0.04)" in head.wire.requests
        await driver.move_to(50, approach="direct", settle_s=0)
        assert head.wire.count(b"ParametersSet") == 1
        head.call("PositionerSGammaParametersSet(HEAD.Pos,5,40,0.04,0.04)")
        await driver.move_to(60, approach="direct", settle_s=0)
        assert head.wire.count(b"ParametersSet") == 2
        assert [reading.value for reading in (await driver.poll())["angle"]] == [60]

    with_driver(use, XPS)


def test_a_rate_that_is_not_kept_moves_nothing() -> None:
    async def use(head: Head, driver: NewportXps) -> None:
        head.wire.lose = lambda request: b"ParametersSet" in request
        with pytest.raises(Refused, match=r"would move at 10 °/s and 40 °/s², expected 20 °/s and 40 °/s²"):
            await driver.move_to(10, approach="direct", settle_s=0)
        assert head.moves() == []

    with_driver(use, XPS)


@pytest.mark.parametrize(
    ("angle_deg", "problem"),
    [(366, "the angle 366° is outside -5° to 365°"), (200, "outside the controller's own -90° to 180°.*No move")],
)
def test_beyond_the_limits_of_bench_or_controller_no_move_is_sent(angle_deg: float, problem: str) -> None:
    async def use(head: Head, driver: NewportXps) -> None:
        with pytest.raises(BeyondLimit, match=problem):
            await driver.move_to(angle_deg, approach="direct", settle_s=0)
        assert head.moves() == []

    with_driver(use, XPS, travel_deg=(-90.0, 180.0))


def test_a_rate_that_the_controller_cannot_do_is_refused() -> None:
    async def use(head: Head) -> None:
        with pytest.raises(BeyondLimit, match="the rate 85 °/s is above the controller's own of 80 °/s"):
            await head.driver(rate="85 °/s", limit={"max": "90 °/s"}).__aenter__()
        await asyncio.sleep(0.1)
        assert all(tap.transport is not None and tap.transport.is_closing() for tap in head.wire.connections)

    with_head(use, XPS)


def test_a_move_whose_answer_is_missing_is_sent_once_and_decided_by_the_encoder() -> None:
    async def use(head: Head, driver: NewportXps) -> None:
        def carry_out_unheard(request: bytes) -> bool:
            if not request.startswith(b"GroupMoveAbsolute"):
                return False
            head.call(request.decode())
            return True

        head.wire.lose = carry_out_unheard
        assert (await driver.move_to(10, approach="direct", settle_s=0)).value == 10
        assert head.moves() == ["10.0"]

    with_driver(use, XPS)


@pytest.mark.parametrize(("calls", "words"), [([], "Not initialized"), (["GroupInitialize(HEAD)"], "Not referenced")])
def test_an_axis_that_was_not_homed_is_neither_homed_nor_moved(calls: list[str], words: str) -> None:
    async def use(head: Head, driver: NewportXps) -> None:
        for call in calls:
            head.call(call)
        with pytest.raises(InstrumentFault, match=f"has not been homed.*received {words} state.*Home it"):
            await driver.move_to(10, approach="direct", settle_s=0)
        assert head.moves() == []
        assert head.wire.count(b"GroupInitialize") == head.wire.count(b"GroupHomeSearch") == 0

    with_driver(use, XPS, homed=False)


def test_an_axis_that_was_switched_off_is_enabled() -> None:
    async def use(head: Head, driver: NewportXps) -> None:
        head.call("GroupMotionDisable(HEAD)")
        assert (await driver.move_to(10, approach="direct", settle_s=0)).value == 10
        assert head.wire.count(b"GroupMotionEnable") == 1

    with_driver(use, XPS)


def test_an_axis_that_cannot_be_enabled_is_refused() -> None:
    async def use(head: Head, driver: NewportXps) -> None:
        head.call("GroupMotionDisable(HEAD)")
        head.wire.lose = lambda request: request.startswith(b"GroupMotionEnable")
        with pytest.raises(Refused, match=r"stays disabled; sent GroupMotionEnable\(HEAD\); received Disabled state"):
            await driver.move_to(10, approach="direct", settle_s=0)

    with_driver(use, XPS)


def test_a_garbled_angle_is_an_error() -> None:
    async def use(head: Head, driver: NewportXps) -> None:
        head.wire.alter = lambda _request, _answer: b"0,1.2.3,EndOfAPI"
        with pytest.raises(BadAnswer, match=r"'1\.2\.3' is not 1 number; sent 'GroupPosition.*received '0,1\.2\.3'"):
            await driver.angle()

    with_driver(use, XPS)


def test_a_number_without_words_is_told_as_it_is() -> None:
    async def use(head: Head, driver: NewportXps) -> None:
        head.wire.alter = lambda request, _answer: b"-7," + request + b",EndOfAPI"
        with pytest.raises(Refused, match="number -7; sent GroupPositionCurrentGet"):
            await driver.angle()

    with_driver(use, XPS)
