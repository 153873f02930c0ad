"""What enters a result over a line without checksum: two takes, a third where they disagree."""

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from bench.loop import AS_FAST_AS_POSSIBLE, run
from drivers.errors import BadAnswer, NoAnswer
from drivers.transport.double_read import DoubleRead


def reported(*values: float) -> Callable[[], Awaitable[float]]:
    """One value after the other, and an error when it is asked once more."""
    left = list(values)

    async def take() -> float:
        await asyncio.sleep(0.1)
        if not left:
            raise NoAnswer("dvm", "no answer")
        return left.pop(0)

    return take


def confirmed(
    *values: float, repeat: Callable[[], Awaitable[float]] | None = None, within: float | None = None,
    checked: bool = False,
) -> tuple[float, list[str]]:  # fmt: skip
    """What is made of these values, and what is noted."""
    notes: list[str] = []
    double_read = DoubleRead("dvm", notes.append, checked=checked)

    async def main() -> float:
        if within is None:
            return await double_read.confirmed("the voltage", reported(*values), repeat=repeat)
        return await double_read.confirmed(
            "the voltage", reported(*values), repeat=repeat, agree=lambda one, other: abs(one - other) <= within,
            describe=lambda value: f"{value:.1f} V",
        )  # fmt: skip

    return run(main(), AS_FAST_AS_POSSIBLE), notes


def test_over_a_checked_link_one_take_is_enough() -> None:
    assert confirmed(1.0, checked=True) == (1.0, [])


def test_two_that_are_alike_agree_and_the_last_one_counts() -> None:
    assert confirmed(1.0, 1.0) == (1.0, [])
    assert confirmed(1.0, 1.2, within=0.3) == (1.2, [])


@pytest.mark.parametrize(("values", "value"), [((1.0, 9.0, 1.0), 1.0), ((9.0, 1.0, 1.0), 1.0)])
def test_of_two_that_are_not_a_third_decides_and_it_is_noted(values: tuple[float, ...], value: float) -> None:
    first, second, _ = values
    assert confirmed(*values) == (value, [f"the voltage was reported as {first}, then as {second}; repeated: {value}"])


def test_what_moves_may_do_so_by_as_much_as_its_driver_says() -> None:
    found, notes = confirmed(1.0, 9.0, 1.2, within=0.3)
    assert found == 1.2
    assert notes == ["the voltage was reported as 1.0 V, then as 9.0 V; repeated: 1.2 V"]


def test_three_of_which_no_two_are_alike_are_no_reading() -> None:
    with pytest.raises(
        BadAnswer, match=r"dvm: the voltage was reported three times, with no two equal; .*1\.0; 2\.0; 3\.0"
    ):
        confirmed(1.0, 2.0, 3.0)


def test_what_the_instrument_still_has_is_not_taken_anew() -> None:
    assert confirmed(1.0, repeat=reported(1.0)) == (1.0, [])
    assert confirmed(1.0, repeat=reported(9.0, 1.0))[0] == 1.0


def test_a_take_without_an_answer_is_an_error() -> None:
    with pytest.raises(NoAnswer):
        confirmed(1.0)


def test_what_is_ordered_between_the_takes_explains_that_they_differ() -> None:
    double_read = DoubleRead("calibrator", lambda _text: None, checked=False)
    told_then = reported(1.0, 2.0, 3.0, 3.0, 3.0)

    async def take() -> float:
        value = await told_then()
        if value == 1.0:
            double_read.command_sent()
        return value

    assert run(double_read.confirmed("what it does", take), AS_FAST_AS_POSSIBLE) == 3.0
