"""The driver of the Newport XPS against the simulated one, in virtual time; what all heads share is tested once."""

import asyncio
from typing import Any

import pytest
from pydantic import ValidationError

from drivers.capabilities import Approach, Positioner
from drivers.description import known_drivers
from drivers.errors import (
    BadAnswer,
    BeyondLimit,
    CannotConnect,
    InstrumentFault,
    NotSettled,
    Refused,
    WrongIdentity,
)
from drivers.newport_xps.description import DESCRIPTION, XpsOptions
from drivers.newport_xps.driver import NewportXps
from tests.support.xps import OPTIONS, XpsHead, now_s, with_xps, with_xps_driver

# The bench file


def test_it_is_installed_under_its_name() -> None:
    assert known_drivers()["newport_xps"] is DESCRIPTION
    options = XpsOptions.model_validate(OPTIONS)
    assert (options.group, options.positioner) == ("HEAD", "Pos")
    assert DESCRIPTION.channels_of(options) == {"angle": "°"}


@pytest.mark.parametrize(
    ("changes", "problem"), [({"group": "HEAD.Pos"}, "a name such as HEAD"), ({"axis": "X"}, "axis")]
)
def test_a_wrong_bench_file_is_told_what_is_wrong(changes: dict[str, Any], problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        XpsOptions.model_validate(OPTIONS | changes)


# Connecting


def test_it_identifies_itself_by_what_the_wire_can_tell() -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        assert isinstance(driver, Positioner)
        identity = await driver.identify()
        assert (identity.maker, identity.model, identity.serial) == ("Newport", "XPS-C8", "SIM-HEAD-02")
        assert identity.firmware == "XPS-C8 Firmware V2.6.1"
        assert not identity.verified
        assert identity.fingerprint == "HEAD.Pos up to 80 °/s and 320 °/s²"
        assert len(head.wire.connections) == 3

    with_xps_driver(use)


def test_another_controller_in_its_place_is_refused() -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        head.controller.firmware = "XPS-Q8 Firmware V3.2.0"
        with pytest.raises(WrongIdentity, match=r"another instrument.*received 0,XPS-Q8"):
            await driver.identify()

    with_xps_driver(use)


@pytest.mark.parametrize(
    "answer", [b"-4,FirmwareVersionGet(char *),EndOfAPI", b"0,ESP300 3.08,EndOfAPI", b"?,EndOfAPI"]
)
def test_what_is_no_xps_is_not_connected(answer: bytes) -> None:
    async def use(head: XpsHead) -> None:
        head.wire.alter = lambda _request, _answer: answer
        with pytest.raises(BadAnswer, match=r"sent 'FirmwareVersionGet\(char \*\)'"):
            await head.driver().__aenter__()

    with_xps(use)


def test_a_group_that_does_not_exist_is_told_with_the_controllers_words() -> None:
    async def use(head: XpsHead) -> None:
        with pytest.raises(Refused, match=r"Positioner Name doesn't exist.*sent PositionerUserTravel.*check the group"):
            await head.driver(group="TABLE").__aenter__()

    with_xps(use)


def test_nobody_there() -> None:
    async def use(head: XpsHead) -> None:
        head.wire.broken = True
        with pytest.raises(CannotConnect):
            await head.driver().__aenter__()

    with_xps(use)


# Moving


def test_a_move_sets_the_rate_goes_settles_and_reads_back() -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
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

    with_xps_driver(use)


def test_a_rate_that_is_not_kept_moves_nothing() -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        head.wire.lose = lambda request: b"ParametersSet" in request
        with pytest.raises(Refused, match=r"would move at 10 °/s and 40 °/s², expected 20 °/s and 40 °/s²"):
            await driver.move_to(10, approach="direct", settle_s=0)
        assert head.moves() == []

    with_xps_driver(use)


@pytest.mark.parametrize(
    ("start_deg", "approach", "moves"),
    [
        (0, "from_below", ["30.0"]),
        (60, "from_below", ["28.0", "30.0"]),
        (30, "from_above", ["32.0", "30.0"]),
    ],
)
def test_every_visit_is_approached_alike(start_deg: float, approach: Approach, moves: list[str]) -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        await driver.move_to(start_deg, approach="direct", settle_s=0)
        head.wire.requests.clear()
        await driver.move_to(30, approach=approach, settle_s=0)
        assert head.moves() == moves
        assert head.angle_deg == 30

    with_xps_driver(use)


@pytest.mark.parametrize(
    ("angle_deg", "problem"),
    [(366, "the angle 366° is outside -5° to 365°"), (200, "outside the controller's own -90° to 180°.*No move")],
)
def test_beyond_the_limits_of_bench_or_controller_no_move_is_sent(angle_deg: float, problem: str) -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        with pytest.raises(BeyondLimit, match=problem):
            await driver.move_to(angle_deg, approach="direct", settle_s=0)
        assert head.moves() == []

    with_xps_driver(use, travel_deg=(-90.0, 180.0))


def test_a_rate_that_the_controller_cannot_do_is_refused() -> None:
    async def use(head: XpsHead) -> None:
        with pytest.raises(BeyondLimit, match="the rate 85 °/s is above the controller's own of 80 °/s"):
            await head.driver(rate="85 °/s").__aenter__()
        await asyncio.sleep(0.1)
        assert all(tap.transport is not None and tap.transport.is_closing() for tap in head.wire.connections)

    with_xps(use)


def test_a_move_whose_answer_is_missing_is_sent_once_and_decided_by_the_encoder() -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        def carry_out_unheard(request: bytes) -> bool:
            if not request.startswith(b"GroupMoveAbsolute"):
                return False
            head.call(request.decode())
            return True

        head.wire.lose = carry_out_unheard
        assert (await driver.move_to(10, approach="direct", settle_s=0)).value == 10
        assert head.moves() == ["10.0"]

    with_xps_driver(use)


def test_a_move_that_never_reached_the_controller_is_not_repeated() -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        head.wire.lose = lambda request: request.startswith(b"GroupMoveAbsolute")
        with pytest.raises(NotSettled, match=r"the axis is at rest, -36000\.00 arcsec off 10°"):
            await driver.move_to(10, approach="direct", settle_s=0)
        assert head.moves() == ["10.0"]

    with_xps_driver(use)


@pytest.mark.parametrize("fault", ["stuck", "frozen"])
def test_an_axis_that_does_not_arrive_is_not_settled(fault: Any) -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        head.faults.begin(fault)
        with pytest.raises(NotSettled, match=r"received 0\.000000°"):
            await driver.move_to(40, approach="direct", settle_s=0)

    with_xps_driver(use)


@pytest.mark.parametrize(("calls", "words"), [([], "Not initialized"), (["GroupInitialize(HEAD)"], "Not referenced")])
def test_an_axis_that_was_not_homed_is_neither_homed_nor_moved(calls: list[str], words: str) -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        for call in calls:
            head.call(call)
        with pytest.raises(InstrumentFault, match=f"has not been homed.*received {words} state.*Home it"):
            await driver.move_to(10, approach="direct", settle_s=0)
        assert head.moves() == []
        assert head.wire.count(b"GroupInitialize") == head.wire.count(b"GroupHomeSearch") == 0

    with_xps_driver(use, homed=False)


def test_an_axis_that_was_switched_off_is_enabled() -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        head.call("GroupMotionDisable(HEAD)")
        assert (await driver.move_to(10, approach="direct", settle_s=0)).value == 10
        assert head.wire.count(b"GroupMotionEnable") == 1

    with_xps_driver(use)


def test_an_axis_that_cannot_be_enabled_is_refused() -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        head.call("GroupMotionDisable(HEAD)")
        head.wire.lose = lambda request: request.startswith(b"GroupMotionEnable")
        with pytest.raises(Refused, match=r"stays disabled; sent GroupMotionEnable\(HEAD\); received Disabled state"):
            await driver.move_to(10, approach="direct", settle_s=0)

    with_xps_driver(use)


def test_a_garbled_angle_is_an_error() -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        head.wire.alter = lambda _request, _answer: b"0,1.2.3,EndOfAPI"
        with pytest.raises(BadAnswer, match=r"'1\.2\.3' is not 1 number; sent 'GroupPosition.*received '0,1\.2\.3'"):
            await driver.angle()

    with_xps_driver(use)


def test_a_number_without_words_is_told_as_it_is() -> None:
    async def use(head: XpsHead, driver: NewportXps) -> None:
        head.wire.alter = lambda request, _answer: b"-7," + request + b",EndOfAPI"
        with pytest.raises(Refused, match="number -7; sent GroupPositionCurrentGet"):
            await driver.angle()

    with_xps_driver(use)
