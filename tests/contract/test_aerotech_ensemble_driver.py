"""The driver of the Aerotech Ensemble against the simulated one, in virtual time."""

import asyncio
from typing import Any

import pytest
from pydantic import ValidationError

from drivers.capabilities import Positioner
from drivers.description import known_drivers
from drivers.dialects.aerotech_ensemble.axis import AerotechEnsemble
from drivers.dialects.aerotech_ensemble.description import DESCRIPTION, EnsembleOptions
from drivers.errors import BadAnswer, InstrumentFault, LinkLost, NotSettled, Refused, WrongIdentity
from drivers.kinds.axes import AxisUncertainty
from drivers.kinds.head.description import HeadLimits
from tests.support.head import LIMITS, OPTIONS, Head, now_s, with_driver, with_head

# The bench file


def test_it_is_installed_under_its_name() -> None:
    assert known_drivers()["aerotech_ensemble"] is DESCRIPTION
    options = EnsembleOptions.model_validate(OPTIONS)
    assert DESCRIPTION.channels_of(options) == {"angle": "°"}
    assert (options.settle.give_up, options.approach_distance, options.acceleration, options.poll) == (30, 2, 40, 0.1)
    certificate = {"zero": "10 arcsec", "harmonics": ["2 arcsec", "1 arcsec"], "repeatability": "0.2 arcsec"}
    assert AxisUncertainty.model_validate(certificate).harmonics == (2.0, 1.0)


@pytest.mark.parametrize(
    ("model", "data", "problem"),
    [
        (EnsembleOptions, OPTIONS | {"axis": "X Y"}, "expected the name of an axis such as X"),
        (EnsembleOptions, OPTIONS | {"rate": "20 °"}, "expected a quantity in °/s"),
        (EnsembleOptions, OPTIONS | {"settle": {"band": "0 arcsec", "hold": "1 s"}}, "more than 0"),
        (EnsembleOptions, OPTIONS | {"settel": {}}, "did you mean 'settle'"),
        (HeadLimits, LIMITS | {"angle": {"min": "5°", "max": "-5°"}}, "min is not below max"),
        (HeadLimits, {"angle": LIMITS["angle"]}, "missing"),
    ],
)
def test_a_wrong_bench_file_is_told_what_is_wrong(model: Any, data: Any, problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        model.model_validate(data)


# Connecting


def test_it_identifies_itself_by_what_the_wire_can_tell() -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        assert isinstance(driver, Positioner)
        identity = await driver.identify()
        assert (identity.maker, identity.model, identity.serial) == ("Aerotech", "Ensemble", "SIM-HEAD-01")
        assert not identity.verified
        assert identity.fingerprint == "CountsPerUnit 1000000"
        assert head.wire.requests == [
            b"GETPARM(X, CountsPerUnit)\n", b"WAIT MODE NOWAIT\n", b"GETPARM(X, CountsPerUnit)\n",
        ]  # fmt: skip
        assert not head.controller.enabled

    with_driver(use)


def test_a_controller_that_does_not_tell_its_parameters_can_be_used() -> None:
    async def use(head: Head) -> None:
        head.wire.alter = lambda request, answer: b"!\n" if b"GETPARM" in request else answer
        async with head.driver() as driver:
            assert (await driver.identify()).fingerprint == "CountsPerUnit not reported"
            assert (await driver.move_to(10, approach="direct", settle_s=0)).value == 10

    with_head(use)


def test_another_controller_in_its_place_is_refused() -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        head.wire.alter = lambda _request, answer: answer.replace(b"1000000", b"3600")
        with pytest.raises(WrongIdentity, match=r"CountsPerUnit of axis X is 3600, it was 1000000; received %3600"):
            await driver.identify()

    with_driver(use)


@pytest.mark.parametrize("answer", [b"#\n", b"%\n", b"hello\n", b"!?\n"])
def test_what_is_no_ensemble_is_not_connected(answer: bytes) -> None:
    async def use(head: Head) -> None:
        head.wire.alter = lambda _request, _answer: answer
        with pytest.raises(BadAnswer, match="sent 'GETPARM"):
            await head.driver().__aenter__()

    with_head(use)


def test_a_connection_that_ends_while_it_is_set_up_is_closed() -> None:
    async def use(head: Head) -> None:
        def hang_up(request: bytes) -> bool:
            if b"WAIT" in request:
                head.wire.drop()
            return False

        head.wire.lose = hang_up
        with pytest.raises(LinkLost):
            await head.driver().__aenter__()

    with_head(use)


# Moving


def test_a_move_enables_goes_settles_and_reads_back() -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        start_s = now_s()
        reading = await driver.move_to(40, approach="direct", settle_s=3)
        assert reading.value == 40
        assert head.controller.enabled
        travel_s = 40 / 20 + 20 / 40
        assert now_s() - start_s == pytest.approx(travel_s + 1 + 3, abs=0.25)
        assert reading.at_s == pytest.approx(now_s())
        assert head.wire.count(b"ENABLE") == 1
        assert b"MOVEABS X 40.0 F20\n" in head.wire.requests
        await driver.move_to(50, approach="direct", settle_s=0)
        assert head.wire.count(b"ENABLE") == 1
        assert (await driver.angle()).value == 50
        assert [reading.value for reading in (await driver.poll())["angle"]] == [50]

    with_driver(use)


def test_the_answer_to_a_move_may_come_when_it_is_done() -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        def later(request: bytes, answer: bytes) -> bytes:
            if not request.startswith(b"MOVEABS"):
                return answer
            transport = head.wire.connections[-1].transport
            assert transport is not None
            asyncio.get_running_loop().call_later(18.5, transport.write, answer)
            return b""

        head.wire.alter = later
        assert (await driver.move_to(360, approach="direct", settle_s=0)).value == 360
        assert head.wire.count(b"GETPARM") == 1  # the answer was in time

    with_driver(use)


@pytest.mark.parametrize("answer", [b"", b"$\n", b"%%\n?\n"], ids=["none", "timed out inside", "garbled"])
def test_a_move_whose_answer_is_missing_is_sent_once_and_decided_by_the_feedback(answer: bytes) -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        head.wire.alter = lambda request, good: answer if request.startswith(b"MOVEABS") else good
        assert (await driver.move_to(10, approach="direct", settle_s=0)).value == 10
        assert head.moves() == ["10.0"]

    with_driver(use)


def test_an_axis_that_stops_short_is_not_settled() -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        asyncio.get_running_loop().call_later(1.0, head.world.stop)
        with pytest.raises(NotSettled, match="is at rest"):
            await driver.move_to(40, approach="direct", settle_s=0)

    with_driver(use)


def test_an_axis_that_never_comes_to_rest_is_not_settled() -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        head.controller.enabled = True
        head.wire.alter = lambda request, answer: b"%11\n" if request.startswith(b"AXISSTATUS") else answer
        with pytest.raises(NotSettled, match="is not at rest"):
            await driver.move_to(40, approach="direct", settle_s=0)
        with pytest.raises(NotSettled, match="still moves after a stop"):
            await driver.stop()

    with_driver(use)


def test_the_hold_begins_again_when_the_axis_leaves_its_band() -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        reads = [b"%10.000100\n"] * 8 + [b"%10.000400\n"] + [b"%9.999900\n"] * 50

        def shaky(request: bytes, answer: bytes) -> bytes:
            return reads.pop(0) if request.startswith(b"PFBK") and not head.moving and head.moves() else answer

        head.wire.alter = shaky
        start_s = now_s()
        reading = await driver.move_to(10, approach="direct", settle_s=0)
        assert reading.value == 9.9999
        assert now_s() - start_s == pytest.approx(10 / 20 + 0.5 + 0.9 + 1.0, abs=0.25)

    with_driver(use)


def test_an_axis_that_was_not_homed_is_not_moved() -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        with pytest.raises(InstrumentFault, match=r"has not been homed.*Home it at the controller"):
            await driver.move_to(10, approach="direct", settle_s=0)
        assert head.moves() == []
        assert not head.controller.enabled

    with_driver(use, homed=False)


def test_an_axis_that_cannot_be_enabled_is_refused() -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        head.wire.lose = lambda request: request.startswith(b"ENABLE")
        with pytest.raises(Refused, match="stays disabled; sent ENABLE X"):
            await driver.move_to(10, approach="direct", settle_s=0)
        assert head.wire.count(b"ENABLE") == 1

    with_driver(use)


def test_a_controller_that_refuses_a_command_is_quoted() -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        head.wire.alter = lambda request, answer: b"!\n" if request.startswith(b"MOVEABS") else answer
        with pytest.raises(Refused, match=r"as invalid; sent MOVEABS X 10\.0 F20; received !"):
            await driver.move_to(10, approach="direct", settle_s=0)

    with_driver(use)


@pytest.mark.parametrize(("answer", "words"), [(b"!\n", "as invalid"), (b"$\n", "timed out"), (b"#\n", "not execute")])
def test_a_question_without_an_answer_is_refused(answer: bytes, words: str) -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        head.wire.alter = lambda _request, _answer: answer
        with pytest.raises(Refused, match=f"{words}.*sent PFBK X"):
            await driver.angle()

    with_driver(use)


def test_a_garbled_angle_is_an_error() -> None:
    async def use(head: Head, driver: AerotechEnsemble) -> None:
        head.wire.alter = lambda _request, _answer: b"%1.2.3\n"
        with pytest.raises(BadAnswer, match=r"'1\.2\.3' is not an angle; sent 'PFBK X'; received '%1\.2\.3'"):
            await driver.angle()

    with_driver(use)
