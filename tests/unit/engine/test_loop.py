"""The bench loop: exact, repeatable, strict."""

import asyncio
import concurrent.futures
import hashlib
import threading

import pytest

from bench.errors import TimeError
from bench.loop import AS_FAST_AS_POSSIBLE, TURNS_AT_ONE_INSTANT, give, run
from drivers.transport.memory import Line


def fast(main):
    return run(main, AS_FAST_AS_POSSIBLE)


def test_a_day_of_sleep_passes_at_once_and_to_the_exact_second():
    async def main():
        await asyncio.sleep(86_400)
        return asyncio.get_running_loop().time()

    assert fast(main()) == 86_400.0


def test_time_begins_at_zero_and_stands_still_while_work_is_done():
    async def main():
        loop = asyncio.get_running_loop()
        before = loop.time()
        for _ in range(1000):
            await asyncio.sleep(0)
        return before, loop.time()

    assert fast(main()) == (0.0, 0.0)


def test_timers_of_one_instant_run_in_the_order_they_were_set():
    async def main():
        loop, seen = asyncio.get_running_loop(), []
        for number in range(50):
            loop.call_at(7.0, seen.append, number)
        loop.call_at(3.0, seen.append, "early")
        await asyncio.sleep(10)
        return seen

    assert fast(main()) == ["early", *range(50)]


def test_timeouts_count_virtual_time():
    async def main():
        loop = asyncio.get_running_loop()
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(3600):
                await loop.create_future()
        return loop.time()

    assert fast(main()) == 3600.0


def test_virtual_time_stands_still_while_a_thread_works():
    async def main():
        loop, ticks = asyncio.get_running_loop(), []

        async def tick():
            while True:
                ticks.append(loop.time())
                await asyncio.sleep(1)

        ticker = asyncio.create_task(tick())
        released = threading.Event()
        loop.call_later(5.5, released.set)
        answer = asyncio.create_task(asyncio.to_thread(released.wait, 0.05))
        await asyncio.sleep(0)
        waited = await answer
        ticker.cancel()
        return waited, ticks

    waited, ticks = fast(main())
    assert waited is False, "the timer that would release the thread came while it was working"
    assert ticks == [0.0]


def test_answers_of_threads_are_taken_in_in_the_order_of_asking():
    """The first asked is the last to be ready; it is taken in first all the same."""

    async def main():
        loop, seen = asyncio.get_running_loop(), []
        second_done = threading.Event()

        def first():
            second_done.wait(5)
            return "first"

        def second():
            second_done.set()
            return "second"

        pool = concurrent.futures.ThreadPoolExecutor(2)
        for future in (loop.run_in_executor(pool, first), loop.run_in_executor(pool, second)):
            future.add_done_callback(lambda done: seen.append(done.result()))
        await asyncio.sleep(1)
        pool.shutdown()
        return seen

    assert fast(main()) == ["first", "second"]


@pytest.mark.parametrize("speed", [AS_FAST_AS_POSSIBLE, 1.0])
def test_what_a_thread_gives_reaches_who_expects_it_in_any_order_and_once(speed):
    async def main():
        loop = asyncio.get_running_loop()
        first, given_up, failed, last = (loop.expect() for _ in range(4))
        given_up.cancel()

        def thread():
            give(last, "last")
            give(given_up, "too late")
            give(failed, problem=ValueError("failed"))
            give(first, "first")
            give(first, "twice")

        threading.Thread(target=thread).start()
        return await asyncio.gather(first, failed, last, return_exceptions=True), given_up.cancelled()

    (first, failed, last), is_given_up = run(main(), speed)
    assert (first, str(failed), last, is_given_up) == ("first", "failed", "last", True)


@pytest.mark.parametrize("expecting", [lambda: run(expected(), AS_FAST_AS_POSSIBLE), lambda: run(expected(), 1.0)])
def test_what_a_thread_gives_when_the_loop_has_ended_is_dropped(expecting):
    give(expecting(), "too late")


async def expected():
    return asyncio.get_running_loop().expect()


def test_what_a_thread_gives_reaches_a_task_of_any_loop():
    async def main():
        future = asyncio.get_running_loop().create_future()
        threading.Thread(target=give, args=(future, "given")).start()
        return await future

    assert asyncio.run(main()) == "given"


def test_an_error_in_a_thread_reaches_who_asked():
    def fail():
        raise ZeroDivisionError("in the thread")

    async def main():
        await asyncio.to_thread(fail)

    with pytest.raises(ZeroDivisionError, match="in the thread"):
        fast(main())


def test_an_answer_nobody_waits_for_any_more_is_passed_over():
    async def main():
        loop = asyncio.get_running_loop()
        forgotten = loop.run_in_executor(None, lambda: 1)
        forgotten.cancel()
        return await loop.run_in_executor(None, lambda: 2)

    assert fast(main()) == 2


@pytest.mark.leaves("a task that the loop has to end")
def test_a_deadlock_is_an_error_that_says_when():
    async def main():
        await asyncio.sleep(12.5)
        await asyncio.get_running_loop().create_future()

    with pytest.raises(TimeError, match=r"stuck at 12\.500000 s: deadlock"):
        fast(main())


@pytest.mark.leaves("a task that the loop has to end")
def test_an_instant_that_never_ends_is_an_error():
    async def main():
        await asyncio.sleep(1)
        while True:  # noqa: ASYNC110  this is the mistake that the loop must notice
            await asyncio.sleep(0)

    with pytest.raises(TimeError, match=f"stuck at 1.000000 s: {TURNS_AT_ONE_INSTANT} turns"):
        fast(main())


@pytest.mark.leaves("a task that the loop has to end")
def test_after_a_deadlock_tasks_still_clean_up():
    cleaned = []

    async def main():
        try:
            await asyncio.get_running_loop().create_future()
        finally:
            await asyncio.sleep(5)
            cleaned.append(asyncio.get_running_loop().time())

    with pytest.raises(TimeError):
        fast(main())
    assert cleaned == [5.0]


class _Echo(asyncio.Protocol):
    def connection_made(self, transport):
        self.transport = transport

    def data_received(self, data):
        self.transport.write(data.upper())


def test_a_connection_served_in_memory_never_meets_a_socket_and_takes_its_latency():
    async def main():
        loop = asyncio.get_running_loop()
        loop.serve_in_memory("192.0.2.1", 9, _Echo, Line(latency_s=0.25))  # an address that no host has
        reader, writer = await asyncio.open_connection("192.0.2.1", 9)
        opened = loop.time()
        writer.write(b"hello\n")
        line = await reader.readline()
        writer.close()
        await writer.wait_closed()
        return line, loop.time() - opened

    assert fast(main()) == (b"HELLO\n", 0.25)


def test_an_address_that_is_not_served_is_a_real_one():
    async def main():
        with pytest.raises(ConnectionRefusedError):
            await asyncio.get_running_loop().create_connection(_Echo, "127.0.0.1", 1)

    fast(main())


def test_the_same_work_gives_the_same_history_twice():
    async def main():
        loop, history = asyncio.get_running_loop(), hashlib.sha256()
        loop.serve_in_memory("instrument", 1, _Echo, Line(latency_s=0.003))

        async def poll(name, period):
            reader, writer = await asyncio.open_connection("instrument", 1)
            for number in range(200):
                writer.write(f"{name} {number}\n".encode())
                answer = await reader.readline()
                history.update(repr((loop.time(), answer)).encode())
                if number % 17 == 0:
                    history.update(repr(await asyncio.to_thread(sum, range(number))).encode())
                await asyncio.sleep(period)
            writer.close()

        async with asyncio.TaskGroup() as group:
            for index, period in enumerate((1.0, 1.0, 0.7, 0.1)):
                group.create_task(poll(f"task {index}", period))
        return history.hexdigest()

    assert fast(main()) == fast(main())


def test_the_next_timer_runs_at_once_and_at_its_own_time():
    async def main():
        loop, seen = asyncio.get_running_loop(), []
        first = loop.call_later(2, lambda: seen.append(loop.time()))
        loop.call_later(3, seen.append, "later")
        return loop.run_now(first), seen, loop.time()

    assert fast(main()) == (True, [2.0], 2.0)


def test_a_timer_that_has_run_at_once_does_not_run_again():
    async def main():
        loop, seen = asyncio.get_running_loop(), []
        loop.run_now(loop.call_later(2, seen.append, "once"))
        await asyncio.sleep(10)
        return seen, loop.time()

    assert fast(main()) == (["once"], 12.0)


@pytest.mark.parametrize(
    "other",
    [
        lambda loop: loop.call_soon(lambda: None),
        lambda loop: loop.call_later(1, lambda: None),
        lambda loop: loop.call_later(2, lambda: None),
        lambda loop: loop.admit(_answered(3)),
    ],
    ids=["something is ready", "an earlier timer", "a timer of the same instant", "a thread is to answer"],
)
def test_a_timer_does_not_run_at_once_while_anything_else_is_to_happen_before(other):
    async def main():
        loop, seen = asyncio.get_running_loop(), []
        timer = loop.call_later(2, seen.append, "in its turn")
        other(loop)
        assert not loop.run_now(timer)
        assert (seen, loop.time()) == ([], 0.0)
        await asyncio.sleep(2)
        return seen

    assert fast(main()) == ["in its turn"]


@pytest.mark.parametrize("speed", [1.0, 1000.0])
def test_no_timer_runs_at_once_where_time_really_passes(speed):
    async def main():
        loop = asyncio.get_running_loop()
        timer = loop.call_later(0.001, lambda: None)
        return loop.run_now(timer)

    assert run(main(), speed) is False


def test_speed_one_is_the_ordinary_loop():
    async def main():
        loop = asyncio.get_running_loop()
        before = loop.time()
        await asyncio.to_thread(lambda: None)
        return loop.time() - before, await loop.admit(_answered(3))

    passed, answer = run(main(), 1.0)
    assert 0 < passed < 5
    assert answer == 3


def _answered(value):
    future = concurrent.futures.Future()
    future.set_result(value)
    return future


@pytest.mark.integration
def test_paced_time_passes_in_proportion():
    async def main():
        await asyncio.sleep(30)
        return asyncio.get_running_loop().time()

    from bench.clock import Stopwatch

    watch = Stopwatch()
    assert run(main(), 100.0) == 30.0
    assert 0.29 < watch.elapsed_s() < 1.0


@pytest.mark.integration
def test_a_signal_ends_a_paced_wait_early():
    import os
    import signal

    async def main():
        loop = asyncio.get_running_loop()
        called = asyncio.Event()
        loop.add_signal_handler(signal.SIGUSR1, called.set)
        threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGUSR1)).start()
        await called.wait()
        return loop.time()

    async def with_timer():
        sleeper = asyncio.create_task(asyncio.sleep(3600))
        at = await main()
        sleeper.cancel()
        return at

    assert 5 < run(with_timer(), 100.0) < 60
