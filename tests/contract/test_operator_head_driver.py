"""The driver of a head that is turned by hand, with somebody beside it, in virtual time."""

import asyncio
import re
from typing import Any

import pytest
from pydantic import ValidationError

from drivers.capabilities import Positioner
from drivers.description import known_drivers
from drivers.dialects.operator_head.description import DESCRIPTION, OperatorHeadOptions
from drivers.errors import BeyondLimit, CannotConnect, Refused
from drivers.person import NO_OPERATOR, OperatorRequest
from drivers.values import Identity
from tests.support.head import now_s
from tests.support.person import ByHand, by_hand

ASKED = "When it is there and locked, type the angle that it shows, in ° or deg."


def test_it_is_installed_and_opens_without_asking_anybody() -> None:
    assert known_drivers()["operator_head"] is DESCRIPTION

    async def use(bench: ByHand, driver: Any) -> None:
        assert isinstance(driver, Positioner)
        assert await driver.identify() == Identity(
            "Moore", "1440", "M-77", verified=False, fingerprint="turned by hand"
        )
        assert await driver.poll() == {}
        assert bench.heard() == 0

    by_hand(use)


def test_a_person_is_told_where_to_which_way_and_how_to_come_there() -> None:
    async def use(bench: ByHand, driver: Any) -> None:
        for angle_deg, approach in ((91, "direct"), (1.25, "from_below"), (1.25, "from_above"), (1.25, "direct")):
            reading = await driver.move_to(angle_deg, approach=approach, settle_s=0)
            assert reading.value == angle_deg == bench.angle_deg
        assert bench.person.told == [
            f"Turn head by hand to 91°. {ASKED}",
            f"Turn head by hand to 1.25°, from 91° down by 89.75°, coming to it from below. {ASKED}",
            f"Turn head by hand to 1.25°, where it stands now: away from it and back, coming to it from above. {ASKED}",
        ]

    by_hand(use)


def test_a_move_takes_as_long_as_the_person_and_then_settles() -> None:
    async def use(bench: ByHand, driver: Any) -> None:
        reading = await driver.move_to(90, approach="direct", settle_s=5)
        assert now_s() == pytest.approx(125)
        assert reading.at_s == now_s()
        assert (await driver.poll())["angle"][-1].value == 90

    by_hand(use)


def test_while_it_is_turned_nobody_knows_where_it_stands() -> None:
    async def use(bench: ByHand, driver: Any) -> None:
        await driver.move_to(90, approach="direct", settle_s=0)
        move = asyncio.create_task(driver.move_to(180, approach="direct", settle_s=0))
        await asyncio.sleep(60)
        assert await driver.poll() == {}
        await move
        assert (await driver.poll())["angle"][-1].value == 180

    by_hand(use)


@pytest.mark.parametrize(
    ("options", "typed_deg", "why"),
    [
        ({}, 93.0, r"93° was typed, 91° was asked for: it is \+2° off, at most ±0\.01° may be\."),
        ({}, 90.98, r"90\.98° was typed, 91° was asked for: it is -0\.02° off"),
        ({"tolerance": "0.5°"}, 90.4, r"it is -0\.6° off, at most ±0\.5° may be"),
        ({"index_step": "1°", "tolerance": "0.5°"}, 91.4, "it is between two teeth, which are 1° apart"),
        ({}, -91.0, r"it is \+178° off"),
    ],
)
def test_an_angle_that_cannot_be_is_asked_for_again_in_both_words(
    options: dict[str, str], typed_deg: float, why: str
) -> None:
    async def use(bench: ByHand, driver: Any) -> None:
        bench.person.answers = [typed_deg]
        assert (await driver.move_to(91, approach="direct", settle_s=0)).value == 91
        first, again = bench.person.requests
        assert not first.again
        assert again.again
        assert again.text.endswith(first.text)
        assert again.turn == first.turn
        assert re.search(why, again.text), again.text

    by_hand(use, **options)


@pytest.mark.parametrize(
    ("options", "asked_deg", "typed_deg", "stands_deg"),
    [
        ({}, 91, 91.004, 91.004),
        ({}, 361, 1.0, 361.0),
        ({}, -5, 355.002, -4.998),
        ({"index_step": "0.25°"}, 91.25, 91.25, 91.25),
        ({"index_step": "20 arcmin"}, 91 + 1 / 3, 91.333333, 91.333333),
    ],
)
def test_an_angle_that_can_be_is_where_it_stands_over_whole_turns(
    options: dict[str, str], asked_deg: float, typed_deg: float, stands_deg: float
) -> None:
    async def use(bench: ByHand, driver: Any) -> None:
        bench.person.answers = [typed_deg]
        assert (await driver.move_to(asked_deg, approach="direct", settle_s=0)).value == pytest.approx(stands_deg)
        assert (await driver.angle()).value == pytest.approx(stands_deg)
        assert bench.heard() == 1

    by_hand(use, **options)


def test_five_answers_that_cannot_be_end_the_move() -> None:
    async def use(bench: ByHand, driver: Any) -> None:
        bench.person.answers = [80.0, 81.0, 82.0, 83.0, 84.0]
        with pytest.raises(Refused, match=r"5 answers in a row are impossible; it is -7° off.*received 84°.*its zero"):
            await driver.move_to(91, approach="direct", settle_s=0)
        assert bench.heard() == 5
        assert await driver.poll() == {}

    by_hand(use)


def test_between_two_teeth_nobody_is_sent() -> None:
    async def use(bench: ByHand, driver: Any) -> None:
        with pytest.raises(BeyondLimit, match=r"the angle 90\.5° is between two teeth, which are 1° apart"):
            await driver.move_to(90.5, approach="direct", settle_s=0)
        assert bench.heard() == 0

    by_hand(use, index_step="1°")


def test_where_nobody_knows_how_it_stands_somebody_looks() -> None:
    async def use(bench: ByHand, driver: Any) -> None:
        bench.world.place(17.0, from_above=False)
        bench.person.answers = [17.5]
        assert (await driver.angle()).value == 17
        assert bench.person.told[0] == "Leave head as it is, and type the angle that it shows, in ° or deg."
        assert bench.person.told[1].startswith("17.5° was typed: it is between two teeth, which are 1° apart. Leave")
        assert (await driver.angle()).value == 17
        assert bench.heard() == 2

    by_hand(use, index_step="1°")


@pytest.mark.parametrize("ending", ["stop", "make_safe", "cancel"])
def test_a_move_that_is_ended_withdraws_its_question_and_says_so(ending: str) -> None:
    async def use(bench: ByHand, driver: Any) -> None:
        await driver.move_to(90, approach="direct", settle_s=0)
        move = asyncio.create_task(driver.move_to(180, approach="direct", settle_s=0))
        await asyncio.sleep(60)
        began_s = now_s()
        if ending == "cancel":
            move.cancel()
        else:
            await getattr(driver, ending)()
        with pytest.raises(asyncio.CancelledError if ending == "cancel" else Refused):
            await move
        assert now_s() == began_s
        assert bench.person.withdrawn == 1
        (note,) = bench.notes
        assert note.startswith("the question was withdrawn: Turn head by hand to 180°, from 90° up by 90°.")
        assert note.endswith("The angle of the head is not confirmed.")
        assert await driver.poll() == {}

    by_hand(use)


def test_stopping_a_head_that_nobody_turns_leaves_it_known() -> None:
    async def use(bench: ByHand, driver: Any) -> None:
        await driver.move_to(90, approach="direct", settle_s=0)
        await driver.stop()
        await driver.make_safe()
        assert (await driver.poll())["angle"][-1].value == 90
        assert bench.notes == []

    by_hand(use)


def test_a_new_move_takes_the_place_of_the_one_that_is_asked_for() -> None:
    async def use(bench: ByHand, driver: Any) -> None:
        first = asyncio.create_task(driver.move_to(90, approach="direct", settle_s=0))
        await asyncio.sleep(60)
        assert (await driver.move_to(180, approach="direct", settle_s=0)).value == 180
        with pytest.raises(Refused, match="ended by another command"):
            await first

    by_hand(use)


def test_leaving_the_bench_withdraws_what_is_asked() -> None:
    async def use(bench: ByHand, driver: Any) -> None:
        move = asyncio.create_task(driver.move_to(90, approach="direct", settle_s=0))
        await asyncio.sleep(60)
        await driver.__aexit__()
        with pytest.raises(Refused):
            await move
        assert bench.person.withdrawn == 1

    by_hand(use)


def test_outside_a_run_there_is_nobody_to_be_asked() -> None:
    async def use(bench: ByHand, driver: Any) -> None:
        with pytest.raises(CannotConnect, match="head: no operator is available: Turn it"):
            await NO_OPERATOR.prompt(OperatorRequest("head", "Turn it", "°", 60.0, 60.0))

    by_hand(use)


@pytest.mark.parametrize(
    ("step", "problem"),
    [("7°", "a turn is 51.4286 of them; expected a whole number"), ("0°", "expected more than 0"), ("200°", "at most")],
)
def test_a_turn_is_a_whole_number_of_steps(step: str, problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        OperatorHeadOptions.model_validate({"index_step": step})
    assert OperatorHeadOptions.model_validate({"index_step": "20 arcmin"}).is_index_position(1 / 3)
