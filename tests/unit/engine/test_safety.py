"""Work that is completed whoever is cancelled, and what an outcome keeps of the ends that were asked for."""

from __future__ import annotations

import asyncio

import pytest

from bench.engine.ending import OPERATOR, EndRequest, Outcome
from bench.engine.safety import finish, grouped, wait_uncancelled
from bench.loop import AS_FAST_AS_POSSIBLE, run


def played(main) -> None:
    run(main(), AS_FAST_AS_POSSIBLE)


def now_s() -> float:
    return asyncio.get_running_loop().time()


async def answers(after_s: float, answer: object = "done") -> object:
    await asyncio.sleep(after_s)
    if isinstance(answer, Exception):
        raise answer
    return answer


def test_work_that_ends_in_time_gives_its_result():
    async def main() -> None:
        assert await finish(answers(1.0), 2.0) == "done"
        with pytest.raises(KeyError):
            await finish(answers(1.0, KeyError()), 2.0)
        begun_s = now_s()
        with pytest.raises(TimeoutError):
            await finish(answers(3.0), 2.0)
        assert now_s() - begun_s == pytest.approx(2.0)

    played(main)


@pytest.mark.parametrize("answer", ["done", KeyError()])
def test_a_cancellation_waits_for_the_work(answer):
    async def main() -> None:
        begun_s, done = now_s(), list[float]()

        async def work() -> None:
            try:
                await answers(5.0, answer)
            finally:
                done.append(now_s() - begun_s)

        task = asyncio.create_task(finish(work(), 60.0))
        for _ in range(2):
            await asyncio.sleep(1.0)
            task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert done == [pytest.approx(5.0)]

    played(main)


def test_a_cancellation_ends_work_that_may_end():
    async def main() -> None:
        begun_s = now_s()
        task = asyncio.create_task(finish(answers(50.0), 60.0, unless=lambda: now_s() - begun_s > 1.5))
        for _ in range(2):
            await asyncio.sleep(1.0)
            task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert now_s() - begun_s == pytest.approx(2.0)

    played(main)


def test_who_waits_is_told_the_last_cancellation():
    async def main() -> None:
        work = asyncio.create_task(answers(5.0))
        waiting = asyncio.create_task(wait_uncancelled(work))
        await asyncio.sleep(1.0)
        waiting.cancel("first")
        await asyncio.sleep(1.0)
        waiting.cancel("second")
        found = await waiting
        assert found is not None
        assert (found.args, work.done()) == (("second",), True)
        assert await wait_uncancelled(work) is None

    played(main)


def test_of_a_group_the_first_error_is_raised():
    async def nested() -> None:
        raise ExceptionGroup("outer", [ExceptionGroup("inner", [KeyError("first"), ValueError()]), TypeError()])

    async def main() -> None:
        with pytest.raises(KeyError, match="first") as found:
            await grouped(nested())
        assert isinstance(found.value.__cause__, ExceptionGroup)
        assert await grouped(asyncio.sleep(0)) is None

    played(main)


def test_a_group_ends_with_who_waits_for_it():
    async def main() -> None:
        begun_s = now_s()
        task = asyncio.create_task(grouped(asyncio.sleep(50.0)))
        await asyncio.sleep(1.0)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert now_s() - begun_s == pytest.approx(1.0)

    played(main)


def test_the_first_request_to_end_counts():
    outcome = Outcome()
    for request in (OPERATOR, EndRequest("hang-up", "the terminal was closed"), OPERATOR):
        outcome.ended(request)
    assert (outcome.how, outcome.ended_by, outcome.problems) == ("aborted", OPERATOR, ["ended by the operator"])


def test_a_failure_before_a_request_to_end_is_kept():
    outcome = Outcome("failed", ["out of tolerance"])
    outcome.ended(OPERATOR)
    assert (outcome.how, outcome.problems) == ("failed", ["out of tolerance", "ended by the operator"])


def test_a_problem_is_listed_once():
    outcome = Outcome()
    for text in ("no answer", "no answer", "no disk"):
        outcome.failed(text)
    assert (outcome.how, outcome.problems) == ("error", ["no answer", "no disk"])
