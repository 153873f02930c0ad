"""BenchLoop: an event loop with a real clock, a virtual one, or a virtual one paced against real time.

In virtual time the clock jumps to the next timer when nothing else is left to do, so that 30 hours of soaking take as
long as the work in between. The application uses only asyncio and cannot tell the difference. Three rules make a run
repeatable to the byte: timers of one instant run in the order in which they were set; connections to instruments
simulated in the same process stay in memory; results of other threads are accepted in the order of their requests, and
only when nothing else is left to run at that instant.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextvars
import heapq
import itertools
import math
import queue
import selectors
import socket
import time
from collections import deque
from collections.abc import Callable, Coroutine
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar, TypeVarTuple, Unpack

from bench.errors import TimeError
from drivers.timing.awake import succeeded_within
from drivers.transport.memory import Line, join

T = TypeVar("T")
Ts = TypeVarTuple("Ts")

AS_FAST_AS_POSSIBLE = math.inf
REAL_TIME = 1.0
TURNS_AT_ONE_INSTANT = 100_000
POLL_EVERY_TURNS = 64  # turns between polls of descriptors while only the wake-up pipe is open
THREAD_ANSWER_LIMIT_S = 120.0  # counted only while this process runs
HEARTBEAT_S = 0.5  # interval of the check that the process runs
STALL_S = 0.25  # shorter stalls are normal load
STALLS_KEPT = 1000
TASKS_END_WITHIN_S = 5.0


class _Timer(asyncio.TimerHandle):
    """Timer that runs after timers set earlier for the same instant."""

    __slots__ = ("_order",)
    _when: float
    _scheduled: bool

    def __init__(self, order: int, *args: Any) -> None:
        super().__init__(*args)
        self._order = order

    def __lt__(self, other: object) -> bool:
        if not isinstance(other, _Timer):
            return NotImplemented
        return self._when < other._when or (self._when == other._when and self._order < other._order)


class BenchLoop(asyncio.SelectorEventLoop):
    """Event loop at `speed` bench seconds per second: 1 is real time, infinity is as fast as possible.

    Bench time begins at `origin_s`, independent of the uptime of the computer.

    Lifetime: as any event loop; use `run`. Concurrency: one thread; `admit` accepts results of other threads. Raises
    TimeError from `run_until_complete` if virtual time cannot advance.
    """

    if TYPE_CHECKING:  # attributes of asyncio's loop that its type stubs lack
        _scheduled: list[_Timer]
        _ready: deque[asyncio.Handle]

        _csock: socket.socket

        def _check_closed(self) -> None: ...

    def __init__(self, speed: float = REAL_TIME, origin_s: float = 0.0) -> None:
        self._virtual = None if speed == REAL_TIME else _VirtualSelector(self, speed, origin_s)
        self._real = _RealSelector() if speed == REAL_TIME else None
        self._behind_s = time.monotonic() - origin_s
        super().__init__(self._virtual or self._real)
        self._orders = itertools.count()
        self._executor: concurrent.futures.ThreadPoolExecutor | None = None
        self._expected: deque[asyncio.Future[Any]] = deque()
        self._arrived: queue.SimpleQueue[tuple[asyncio.Future[Any], Any, BaseException | None]] = queue.SimpleQueue()
        self._answers: dict[asyncio.Future[Any], tuple[Any, BaseException | None]] = {}
        self._served: dict[tuple[str, int], tuple[Callable[[], asyncio.Protocol], Line]] = {}

    def time(self) -> float:
        """Return the time of this loop in s."""
        return time.monotonic() - self._behind_s if self._virtual is None else self._virtual.now

    @property
    def wakeup_fd(self) -> int:
        """Descriptor for `signal.set_wakeup_fd`: a write wakes this loop, whichever thread receives the signal."""
        return self._csock.fileno()

    def stalled_since(self, since_s: float) -> float:
        """Return the time in s for which this loop has been stalled since an instant; virtual time stalls with it."""
        return 0.0 if self._real is None else self._real.stalled_since(since_s + self._behind_s)

    def call_at(
        self,
        when: float,
        callback: Callable[[Unpack[Ts]], object],
        *args: *Ts,
        context: contextvars.Context | None = None,
    ) -> asyncio.TimerHandle:
        """Schedule as asyncio does, but keep the order of timers of one instant."""
        self._check_closed()
        timer = _Timer(next(self._orders), when, callback, args, self, context)
        heapq.heappush(self._scheduled, timer)
        timer._scheduled = True
        return timer

    def serve_in_memory(self, host: str, port: int, factory: Callable[[], asyncio.Protocol], line: Line) -> None:
        """Serve `host:port` in memory: connections from this loop are joined to `factory()`."""
        self._served[host, port] = (factory, line)

    async def create_connection(self, protocol_factory: Any, host: Any = None, port: Any = None, **options: Any) -> Any:
        """Connect as asyncio does; for addresses served in memory without a socket."""
        served = self._served.get((host, port))
        if served is None:
            return await super().create_connection(protocol_factory, host, port, **options)
        factory, line = served
        await asyncio.sleep(line.latency_s)
        client = protocol_factory()
        return join(client, factory(), line, (host, port)), client

    def admit(self, answer: concurrent.futures.Future[T]) -> asyncio.Future[T]:
        """Return a future for the result of another thread; virtual time waits for it."""
        if self._virtual is None:
            return asyncio.wrap_future(answer, loop=self)
        expected: asyncio.Future[T] = self.expect()
        answer.add_done_callback(partial(_pass_on, expected))
        return expected

    def expect(self) -> asyncio.Future[Any]:
        """Return a future that another thread settles with `give`; virtual time waits for it."""
        expected: asyncio.Future[Any] = self.create_future()
        if self._virtual is not None:
            self._expected.append(expected)
        return expected

    def arrives(self, expected: asyncio.Future[Any], result: Any, problem: BaseException | None) -> bool:
        """Accept from another thread what virtual time waits for; return False in real time."""
        if self._virtual is not None:
            self._arrived.put((expected, result, problem))
        return self._virtual is not None

    def run_in_executor(self, executor: Any, func: Callable[[Unpack[Ts]], T], *args: *Ts) -> asyncio.Future[T]:
        """Run in an executor as asyncio does, with the result accepted by `admit`."""
        if self._virtual is None:
            return super().run_in_executor(executor, func, *args)
        if executor is None:
            if self._executor is None:
                self._executor = concurrent.futures.ThreadPoolExecutor(thread_name_prefix="bench")
            executor = self._executor
        return self.admit(executor.submit(func, *args))

    async def shutdown_default_executor(self, timeout: float | None = None) -> None:
        """Shut down as asyncio does; in virtual time without the helper thread, which would look like a deadlock."""
        if self._virtual is None:
            await super().shutdown_default_executor()
        elif self._executor is not None:
            self._executor.shutdown(wait=True)

    def run_now(self, timer: asyncio.TimerHandle) -> bool:
        """Advance virtual time to a timer and run it, if nothing else is due before; return True if it ran.

        A task that waits for it continues in the same turn of the loop.
        """
        virtual, timers = self._virtual, self._scheduled
        if virtual is None or virtual.is_paced or self._ready or self._expected or not timers or timers[0] is not timer:
            return False
        first = heapq.heappop(timers)
        if timers and timers[0].when() <= first.when():
            heapq.heappush(timers, first)
            return False
        first._scheduled = False
        virtual.move_to(first.when())
        first._run()
        return True

    def accept_answer(self) -> bool:
        """Wait for the oldest outstanding result of another thread; return False if there is none."""
        while self._expected:
            oldest = self._expected.popleft()
            if oldest.cancelled():
                self._answers.pop(oldest, None)
                continue
            if not succeeded_within(partial(self._has_come, oldest), THREAD_ANSWER_LIMIT_S):
                raise TimeError(f"a thread has not answered for {THREAD_ANSWER_LIMIT_S:g} s: {oldest}")
            _settle(oldest, *self._answers.pop(oldest))
            return True
        return False

    def _has_come(self, expected: asyncio.Future[Any], within_s: float) -> bool:
        """Take in the results of threads until this one has come, each within this time."""
        while expected not in self._answers:
            try:
                which, result, problem = self._arrived.get(timeout=within_s)
            except queue.Empty:
                return False
            if not which.done():  # given up, or given twice
                self._answers[which] = (result, problem)
        return True

    def next_timer(self) -> float | None:
        """Return the time of the next timer, or None."""
        return self._scheduled[0].when() if self._scheduled else None


def expect() -> asyncio.Future[Any]:
    """Return a future that another thread settles with `give`; the running loop may be any."""
    loop = asyncio.get_running_loop()
    return loop.expect() if isinstance(loop, BenchLoop) else loop.create_future()


def give(expected: asyncio.Future[Any], result: Any = None, problem: BaseException | None = None) -> None:
    """Settle the future of a task with a result or a problem, from another thread; the loop may be any."""
    loop = expected.get_loop()
    if isinstance(loop, BenchLoop) and loop.arrives(expected, result, problem):
        return
    with suppress(RuntimeError):  # the loop is closed
        loop.call_soon_threadsafe(_settle, expected, result, problem)


def _pass_on(expected: asyncio.Future[Any], ended: concurrent.futures.Future[Any]) -> None:
    """Give what an executor has found to the task that waits for it."""
    problem = concurrent.futures.CancelledError() if ended.cancelled() else ended.exception()
    give(expected, ended.result() if problem is None else None, problem)


def _settle(expected: asyncio.Future[Any], result: Any, problem: BaseException | None) -> None:
    if expected.done():
        return
    if problem is not None:
        expected.set_exception(problem)
    else:
        expected.set_result(result)


class _RealSelector(selectors.DefaultSelector):
    """Selector that detects stalls of the process: it waits in short slices and compares them with the clock.

    The duration of callbacks counts as well, since nothing is received meanwhile.
    """

    def __init__(self) -> None:
        super().__init__()
        self._stalls: deque[tuple[float, float]] = deque(maxlen=STALLS_KEPT)  # (end, duration) of each stall
        self._returned_s = math.inf

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Return ready descriptors, or none after the timeout or HEARTBEAT_S."""
        begun_s = time.monotonic()
        self._note(begun_s, begun_s - self._returned_s)
        wait_s = HEARTBEAT_S if timeout is None else max(0.0, min(timeout, HEARTBEAT_S))
        ready = super().select(wait_s)
        self._returned_s = time.monotonic()
        self._note(self._returned_s, self._returned_s - begun_s - wait_s)
        return ready

    def stalled_since(self, since_s: float) -> float:
        """Return the time in s for which the process has been stalled since an instant."""
        return sum(min(long_s, end_s - since_s) for end_s, long_s in self._stalls if end_s > since_s)

    def _note(self, end_s: float, long_s: float) -> None:
        if long_s > STALL_S:
            self._stalls.append((end_s, long_s))


class _VirtualSelector(selectors.DefaultSelector):
    """Selector that advances the clock instead of waiting."""

    def __init__(self, loop: BenchLoop, speed: float, origin_s: float) -> None:
        super().__init__()
        self._loop = loop
        self._open = self.get_map()
        self._speed = speed
        self.now = origin_s
        self._turns_here = 0
        self._turns_since_poll = 0
        self._real_s = 0.0  # real time in s that must pass before the clock may advance, when paced
        self._last_real = time.monotonic()

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Return ready descriptors; advance the clock to the next timer if nothing else is left to do."""
        self._turns_here += 1
        if self._turns_here > TURNS_AT_ONE_INSTANT:
            self._turns_here = 0  # cancelled tasks need turns to clean up
            raise TimeError(
                f"virtual time is stuck at {self.now:.6f} s: {TURNS_AT_ONE_INSTANT} turns of the loop without an end"
            )
        ready = self._poll()
        if ready or timeout == 0 or self._loop.accept_answer():
            return ready
        when = self._loop.next_timer()
        if when is None:
            return self._wait_outside()
        if self.is_paced and when > self.now:
            return self._paced(when)
        self.move_to(when)
        return ready

    def _poll(self) -> list[tuple[selectors.SelectorKey, int]]:
        self._turns_since_poll += 1
        if len(self._open) == 1 and self._turns_since_poll < POLL_EVERY_TURNS:
            return []
        self._turns_since_poll = 0
        return super().select(0)

    @property
    def is_paced(self) -> bool:
        """True if virtual time is paced against real time."""
        return self._speed < AS_FAST_AS_POSSIBLE

    def move_to(self, when: float) -> None:
        """Advance the clock; it never goes back."""
        if when > self.now:
            self.now = when
            self._turns_here = 0

    def _wait_outside(self) -> list[tuple[selectors.SelectorKey, int]]:
        """Wait for a real descriptor, since no timer is set; without one it is a deadlock."""
        ready: list[tuple[selectors.SelectorKey, int]] = []

        def is_ready(slice_s: float) -> bool:
            ready.extend(selectors.DefaultSelector.select(self, slice_s))
            return bool(ready)

        if len(self._open) > 1 and succeeded_within(is_ready, THREAD_ANSWER_LIMIT_S):
            return ready
        raise TimeError(
            f"virtual time is stuck at {self.now:.6f} s: deadlock, no timer is set and nothing is under way"
        )

    def _paced(self, when: float) -> list[tuple[selectors.SelectorKey, int]]:
        """Let real time pass in proportion; a ready descriptor ends the wait early."""
        real = time.monotonic()
        ahead = (when - self.now) / self._speed - (real - self._last_real)
        ready = super().select(ahead) if ahead > 0 else []
        after = time.monotonic()
        passed = min(when, self.now + (after - self._last_real) * self._speed) if ready else when
        self._last_real = after if ready else self._last_real + (when - self.now) / self._speed
        self.move_to(passed)
        return ready


def run(main: Coroutine[Any, Any, T], speed: float = REAL_TIME, origin_s: float = 0.0) -> T:
    """Run `main` on a BenchLoop at `speed` and close the loop; remaining tasks are cancelled and awaited.

    Bench time begins at `origin_s`. A task that does not end within `TASKS_END_WITHIN_S` is abandoned, so that an error
    in it cannot block the end.
    """
    with asyncio.Runner(loop_factory=lambda: BenchLoop(speed, origin_s)) as runner:
        try:
            return runner.run(main)
        finally:
            runner.run(_end_tasks())


async def _end_tasks() -> None:
    left = asyncio.all_tasks() - {asyncio.current_task()}
    for task in left:
        task.cancel()
    if not left:
        return
    _, deaf = await asyncio.wait(left, timeout=TASKS_END_WITHIN_S)
    for task in deaf:
        asyncio.tasks._unregister_task(task)  # closing the loop would wait for it for ever
        task._log_destroy_pending = False  # type: ignore[attr-defined]  # as asyncio.gather does
