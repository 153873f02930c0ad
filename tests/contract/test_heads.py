"""What all drivers of indexing heads share, each against its own simulated controller, or person, in virtual time."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from drivers.capabilities import Approach
from drivers.errors import BeyondLimit, CannotConnect, InstrumentFault, NoAnswer, NotSettled, Refused
from tests.support.head import ENSEMBLE, FRAMED, XPS, Dialect, Head, now_s, with_driver, with_head
from tests.support.person import ByHand, by_hand

on_a_controller = pytest.mark.parametrize(
    "dialect", [ENSEMBLE, XPS, FRAMED], ids=lambda dialect: dialect.description.name
)
on_any_head = pytest.mark.parametrize(
    "dialect",
    [ENSEMBLE, XPS, FRAMED, None],
    ids=lambda dialect: dialect.description.name if dialect else "operator_head",
)


def with_any(use: Callable[[Any, Any], Awaitable[None]], dialect: Dialect | None) -> None:
    """As `with_driver`, and for a head that is turned by hand where there is no dialect."""
    if dialect is None:
        by_hand(use)
    else:
        with_driver(use, dialect)


@on_a_controller
def test_nobody_there(dialect: Dialect) -> None:
    async def use(head: Head) -> None:
        head.wire.broken = True
        with pytest.raises(CannotConnect):
            await head.driver().__aenter__()

    with_head(use, dialect)


@on_a_controller
def test_a_rate_above_the_limit_is_refused_before_connecting(dialect: Dialect) -> None:
    async def use(head: Head) -> None:
        with pytest.raises(BeyondLimit, match="the rate 31 °/s is above the limit of 30 °/s"):
            await head.driver(rate="31 °/s").__aenter__()
        assert head.wire.connections == []

    with_head(use, dialect)


@on_a_controller
@pytest.mark.parametrize(
    ("start_deg", "approach", "moves"),
    [
        (0, "direct", ["30.0"]),
        (0, "from_below", ["30.0"]),
        (28, "from_below", ["30.0"]),
        (28.5, "from_below", ["28.0", "30.0"]),
        (30, "from_below", ["28.0", "30.0"]),
        (60, "from_below", ["28.0", "30.0"]),
        (60, "from_above", ["30.0"]),
        (31.5, "from_above", ["32.0", "30.0"]),
        (30, "from_above", ["32.0", "30.0"]),
        (0, "from_above", ["32.0", "30.0"]),
        (30, "direct", ["30.0"]),
    ],
)
def test_every_visit_is_approached_alike(
    dialect: Dialect, start_deg: float, approach: Approach, moves: list[str]
) -> None:
    async def use(head: Head, driver: Any) -> None:
        await driver.move_to(start_deg, approach="direct", settle_s=0)
        head.wire.requests.clear()
        await driver.move_to(30, approach=approach, settle_s=0)
        assert head.moves() == moves
        assert head.angle_deg == 30

    with_driver(use, dialect)


@on_any_head
@pytest.mark.parametrize(
    ("angle_deg", "problem"),
    [(366, r"the angle 366° is outside -5° to 365°"), (-5.001, r"the angle -5\.001° is outside")],
)
def test_beyond_the_limits_nothing_is_sent(dialect: Dialect | None, angle_deg: float, problem: str) -> None:
    async def use(head: Head | ByHand, driver: Any) -> None:
        sent = head.heard()
        with pytest.raises(BeyondLimit, match=problem):
            await driver.move_to(angle_deg, approach="direct", settle_s=0)
        assert head.heard() == sent
        await driver.move_to(-5, approach="direct", settle_s=0)

    with_any(use, dialect)


@on_a_controller
@pytest.mark.parametrize(
    ("angle_deg", "approach", "problem"),
    [
        (-4, "from_below", r"where the approach to -4° begins, -6° is outside"),
        (364, "from_above", r"where the approach to 364° begins, 366° is outside"),
    ],
)
def test_an_approach_that_begins_beyond_the_limits_is_not_sent(
    dialect: Dialect, angle_deg: float, approach: Approach, problem: str
) -> None:
    async def use(head: Head, driver: Any) -> None:
        sent = head.heard()
        with pytest.raises(BeyondLimit, match=problem):
            await driver.move_to(angle_deg, approach=approach, settle_s=0)
        assert head.heard() == sent

    with_driver(use, dialect)


@on_any_head
@pytest.mark.parametrize("ending", ["stop", "make_safe"])
def test_a_move_that_was_ended_is_over_and_the_next_one_arrives(dialect: Dialect | None, ending: str) -> None:
    async def use(head: Head | ByHand, driver: Any) -> None:
        move = asyncio.create_task(driver.move_to(300, approach="direct", settle_s=5))
        await asyncio.sleep(2)
        await getattr(driver, ending)()
        with pytest.raises(Refused):
            await move
        stood_deg = head.angle_deg
        await asyncio.sleep(300)
        assert head.angle_deg == stood_deg
        assert (await driver.move_to(10, approach="from_below", settle_s=1)).value == 10
        assert head.angle_deg == 10
        assert (await driver.poll())["angle"][-1].value == 10

    with_any(use, dialect)


@on_a_controller
def test_a_move_that_never_reached_the_controller_is_not_repeated(dialect: Dialect) -> None:
    async def use(head: Head, driver: Any) -> None:
        head.wire.lose = lambda request: request.startswith(dialect.word)
        with pytest.raises(NotSettled, match=r"the axis is at rest, -36000\.00 arcsec off 10°, band ±1 arcsec"):
            await driver.move_to(10, approach="direct", settle_s=0)
        assert head.moves() == ["10.0"]

    with_driver(use, dialect)


@on_a_controller
def test_an_axis_that_does_not_start_is_not_settled_in_time(dialect: Dialect) -> None:
    async def use(head: Head, driver: Any) -> None:
        head.faults.begin("stuck")
        start_s = now_s()
        with pytest.raises(NotSettled, match="is at rest"):
            await driver.move_to(40, approach="direct", settle_s=0)
        assert now_s() - start_s == pytest.approx(40 / 20 + 20 / 40 + 30, abs=0.5)

    with_driver(use, dialect)


@on_a_controller
def test_a_feedback_that_stands_still_is_not_settled(dialect: Dialect) -> None:
    async def use(head: Head, driver: Any) -> None:
        head.faults.begin("frozen")
        with pytest.raises(NotSettled, match=r"received 0\.000000°"):
            await driver.move_to(40, approach="direct", settle_s=0)

    with_driver(use, dialect)


@on_a_controller
def test_an_axis_that_leaves_its_band_while_it_settles_is_not_settled(dialect: Dialect) -> None:
    async def use(head: Head, driver: Any) -> None:
        asyncio.get_running_loop().call_later(8.0, head.world.move, 10.01, 1.0)
        with pytest.raises(NotSettled, match=r"left its band within 10 s, \+36\.00 arcsec off 10°"):
            await driver.move_to(10, approach="direct", settle_s=10)

    with_driver(use, dialect)


@on_a_controller
def test_somebody_else_moving_the_axis_is_a_fault_within_one_poll(dialect: Dialect) -> None:
    async def use(head: Head, driver: Any) -> None:
        await driver.poll()  # nothing is expected of it yet
        await driver.move_to(10, approach="direct", settle_s=0)
        head.move(10.001)
        await asyncio.sleep(1)
        await driver.poll()  # within ten bands
        head.move(12.0)
        await asyncio.sleep(1)
        with pytest.raises(InstrumentFault, match=r"stands at 12\.00000°, it was sent to 10\.00000°.*what else"):
            await driver.poll()
        await driver.stop()
        await driver.poll()

    with_driver(use, dialect)


@on_a_controller
@pytest.mark.parametrize("ending", ["stop", "make_safe"])
def test_stopping_ends_the_move_under_way(dialect: Dialect, ending: str) -> None:
    async def use(head: Head, driver: Any) -> None:
        move = asyncio.create_task(driver.move_to(100, approach="from_above", settle_s=0))
        await asyncio.sleep(2.05)
        before_deg = (await driver.poll())["angle"][0].value  # a move does not hold up who looks on
        assert before_deg == pytest.approx(head.angle_deg, abs=0.2)
        await getattr(driver, ending)()
        assert not head.moving
        stood_deg = head.angle_deg
        with pytest.raises(Refused, match=r"ended by another command|aborted, the instrument|Move Aborted"):
            await move
        await asyncio.sleep(10)
        assert head.angle_deg == stood_deg
        assert head.moves() == ["102.0"]
        await driver.move_to(0, approach="direct", settle_s=0)

    with_driver(use, dialect)


@on_a_controller
@pytest.mark.parametrize("ending", ["stop", "make_safe"])
def test_a_move_is_over_whenever_it_is_stopped(dialect: Dialect, ending: str) -> None:
    for after in range(1, 25):

        async def use(head: Head, driver: Any, after: int = after) -> None:
            begin = len(head.wire.requests)
            move = asyncio.create_task(driver.move_to(300, approach="from_above", settle_s=0))
            await head.wire.heard(begin + after)
            stopped_s = now_s()
            await getattr(driver, ending)()
            assert now_s() - stopped_s < 5
            with pytest.raises(Refused):
                await move
            assert not head.moving
            stood_deg, moves = head.angle_deg, head.moves()
            await asyncio.sleep(20)
            assert (head.angle_deg, head.moves()) == (stood_deg, moves)

        with_driver(use, dialect)


@on_a_controller
def test_making_safe_connects_and_identifies_again(dialect: Dialect) -> None:
    async def use(head: Head, driver: Any) -> None:
        await driver.stop()
        head.move(300.0)
        for connection in list(head.wire.connections):
            assert connection.transport is not None
            connection.transport.abort()
        await asyncio.sleep(1)
        assert head.moving
        await driver.make_safe()
        assert not head.moving
        assert (await driver.move_to(10, approach="direct", settle_s=0)).value == 10

    with_driver(use, dialect)


@on_any_head
def test_making_safe_is_idempotent_and_moves_nothing(dialect: Dialect | None) -> None:
    async def use(head: Head | ByHand, driver: Any) -> None:
        await driver.move_to(10, approach="direct", settle_s=0)
        await driver.make_safe()
        await driver.make_safe()
        assert head.angle_deg == 10
        assert len(head.moves()) == 1

    with_any(use, dialect)


@on_a_controller
def test_making_safe_homes_nothing(dialect: Dialect) -> None:
    async def use(head: Head, driver: Any) -> None:
        await driver.make_safe()
        assert head.moves() == []
        assert head.wire.count(dialect.home) == 0

    with_driver(use, dialect)


@on_a_controller
def test_making_safe_stops_at_once_while_a_question_is_under_way(dialect: Dialect) -> None:
    async def use(head: Head, driver: Any) -> None:
        head.move(300.0)
        await asyncio.sleep(1)
        head.wire.mute(dialect.angle)
        reading = asyncio.create_task(driver.angle())
        await asyncio.sleep(1)
        head.wire.alter = lambda _request, answer: answer  # a status may be all that there is to ask for
        start_s, before_deg = now_s(), head.angle_deg
        await driver.make_safe()
        assert now_s() - start_s < 5
        assert head.angle_deg - before_deg < 0.1
        with pytest.raises(Refused, match="aborted, the instrument"):
            await reading

    with_driver(use, dialect)


@on_a_controller
def test_making_safe_before_it_was_ever_connected(dialect: Dialect) -> None:
    async def use(head: Head) -> None:
        driver = head.driver()
        head.move(300.0)
        await driver.make_safe()
        assert not head.moving
        await driver.__aexit__()

    with_head(use, dialect)


@on_a_controller
def test_what_cannot_be_made_safe_says_so_in_time(dialect: Dialect) -> None:
    async def use(head: Head, driver: Any) -> None:
        head.faults.begin("silent")
        start_s = now_s()
        with pytest.raises(NoAnswer):
            await driver.make_safe()
        assert now_s() - start_s <= 6
        head.wire.drop()
        head.wire.broken = True
        await asyncio.sleep(0.1)
        with pytest.raises(CannotConnect):
            await driver.make_safe()

    with_driver(use, dialect)


async def work(driver: Any) -> None:
    async with driver:
        await driver.move_to(40, approach="from_above", settle_s=1)
        for _ in range(60):
            await driver.poll()
            await asyncio.sleep(1)


@on_a_controller
@pytest.mark.parametrize("tens", range(8))
def test_silence_is_reported_within_a_deadline_whenever_it_begins(dialect: Dialect, tens: int) -> None:
    for silent_from in range(10 * tens + 1, 10 * tens + 11):

        async def use(head: Head, silent_from: int = silent_from) -> None:
            silent_at_s: list[float] = []

            def lose(_request: bytes) -> bool:
                if len(head.wire.requests) >= silent_from:
                    silent_at_s.append(now_s())
                return bool(silent_at_s)

            head.wire.lose = lose
            with pytest.raises(NoAnswer):
                await work(head.driver())
            assert now_s() - silent_at_s[0] < 10

        with_head(use, dialect)
