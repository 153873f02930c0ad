"""BenchLoop: an event loop whose clock is real, virtual, or virtual and paced.

In virtual time the clock jumps to the next timer whenever nothing is left to do, so 30 hours of soaking take as long
as the work in between. The application uses only asyncio and cannot tell the difference. Three rules make a run
repeatable to the byte: timers of one instant run in the order they were set, connections to instruments simulated in
the same process never leave it, and what other threads give back is taken in, in the order of asking, only when
nothing else is left to run at that instant.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextvars
import heapq
import itertools
import math
import selectors
import socket
import time
from collections import deque
from collections.abc import Callable, Coroutine
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar, TypeVarTuple, Unpack

from bench.errors import TimeError
from drivers.timing.awake import came_true
from drivers.transport.memory import Line, join

T = TypeVar("T")
Ts = TypeVarTuple("Ts")

AS_FAST_AS_POSSIBLE = math.inf
REAL_TIME = 1.0
TURNS_AT_ONE_INSTANT = 100_000
POLL_EVERY_TURNS = 64  # how often descriptors are looked at while only the loop's own wake-up pipe is open
THREAD_ANSWER_LIMIT_S = 120.0  # of time in which this process runs
HEARTBEAT_S = 0.5  # how often it is looked whether the process runs
STALL_S = 0.25  # what is less is a busy computer
STALLS_KEPT = 1000
TASKS_END_WITHIN_S = 5.0


class _Timer(asyncio.TimerHandle):
    """A timer that runs after the timers set before it for the same instant."""

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
    """An event loop at `speed` bench seconds a second: 1 is real time, infinity as fast as possible.

    Bench time begins at `origin_s`, whatever the computer's uptime is.

    Lifetime: as any event loop; use `run`. Concurrency: one thread; `admit` takes in what other threads give back.
    Raises TimeError out of `run_until_complete` when virtual time is stuck.
    """

    if TYPE_CHECKING:  # what asyncio's loop has and its type stubs do not tell
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
        self._answers: deque[tuple[concurrent.futures.Future[Any], asyncio.Future[Any]]] = deque()
        self._served: dict[tuple[str, int], tuple[Callable[[], asyncio.Protocol], Line]] = {}

    def time(self) -> float:
        """Seconds on this loop's clock."""
        return time.monotonic() - self._behind_s if self._virtual is None else self._virtual.now

    @property
    def wakeup_fd(self) -> int:
        """For `signal.set_wakeup_fd`: what is written there wakes this loop, whatever thread the signal came to."""
        return self._csock.fileno()

    def stalled_since(self, since_s: float) -> float:
        """For how long this loop has stood still since an instant; virtual time stands still with it."""
        return 0.0 if self._real is None else self._real.stalled_since(since_s + self._behind_s)

    def call_at(
        self,
        when: float,
        callback: Callable[[Unpack[Ts]], object],
        *args: *Ts,
        context: contextvars.Context | None = None,
    ) -> asyncio.TimerHandle:
        """As asyncio's, but timers of one instant run in the order they were set."""
        self._check_closed()
        timer = _Timer(next(self._orders), when, callback, args, self, context)
        heapq.heappush(self._scheduled, timer)
        timer._scheduled = True
        return timer

    def serve_in_memory(self, host: str, port: int, factory: Callable[[], asyncio.Protocol], line: Line) -> None:
        """From now on a connection to `host:port` from this loop is joined to `factory()` in memory."""
        self._served[host, port] = (factory, line)

    async def create_connection(self, protocol_factory: Any, host: Any = None, port: Any = None, **options: Any) -> Any:
        """As asyncio's, but an address served in memory never touches a socket."""
        served = self._served.get((host, port))
        if served is None:
            return await super().create_connection(protocol_factory, host, port, **options)
        factory, line = served
        await asyncio.sleep(line.latency_s)
        client = protocol_factory()
        return join(client, factory(), line, (host, port)), client

    def admit(self, answer: concurrent.futures.Future[T]) -> asyncio.Future[T]:
        """A future for what another thread will answer; virtual time stands still until it has."""
        if self._virtual is None:
            return asyncio.wrap_future(answer, loop=self)
        admitted: asyncio.Future[T] = self.create_future()
        self._answers.append((answer, admitted))
        return admitted

    def run_in_executor(self, executor: Any, func: Callable[[Unpack[Ts]], T], *args: *Ts) -> asyncio.Future[T]:
        """As asyncio's, with the result taken in by `admit`."""
        if self._virtual is None:
            return super().run_in_executor(executor, func, *args)
        if executor is None:
            if self._executor is None:
                self._executor = concurrent.futures.ThreadPoolExecutor(thread_name_prefix="bench")
            executor = self._executor
        return self.admit(executor.submit(func, *args))

    async def shutdown_default_executor(self, timeout: float | None = None) -> None:
        """As asyncio's; in virtual time without the helper thread that would look like a deadlock."""
        if self._virtual is None:
            await super().shutdown_default_executor()
        elif self._executor is not None:
            self._executor.shutdown(wait=True)

    def run_now(self, timer: asyncio.TimerHandle) -> bool:
        """Moves virtual time to a timer and runs it at once, if nothing at all is to happen before; whether it has.

        Who waits for it then goes on in the same turn of the loop.
        """
        virtual, timers = self._virtual, self._scheduled
        if virtual is None or virtual.is_paced or self._ready or self._answers or not timers or timers[0] is not timer:
            return False
        first = heapq.heappop(timers)
        if timers and timers[0].when() <= first.when():
            heapq.heappush(timers, first)
            return False
        first._scheduled = False
        virtual.move_to(first.when())
        first._run()
        return True

    def take_in_answer(self) -> bool:
        """Waits for the oldest outstanding answer of another thread; False when there is none."""
        while self._answers:
            answer, admitted = self._answers.popleft()
            if admitted.cancelled():
                continue
            if not came_true(partial(_has_answered, answer), THREAD_ANSWER_LIMIT_S):
                raise TimeError(f"a thread has not answered for {THREAD_ANSWER_LIMIT_S:g} s: {answer}")
            if (problem := answer.exception()) is not None:
                admitted.set_exception(problem)
            else:
                admitted.set_result(answer.result())
            return True
        return False

    def next_timer(self) -> float | None:
        """When the next timer is due, None without one."""
        return self._scheduled[0].when() if self._scheduled else None


def _has_answered(answer: concurrent.futures.Future[Any], within_s: float) -> bool:
    return bool(concurrent.futures.wait([answer], within_s).done)


class _RealSelector(selectors.DefaultSelector):
    """A selector that sees when the process was not running: it waits for short times and compares them with the clock.

    What callbacks take is seen as well: nobody listens meanwhile.
    """

    def __init__(self) -> None:
        super().__init__()
        self._stalls: deque[tuple[float, float]] = deque(maxlen=STALLS_KEPT)  # when each ended, and how long it was
        self._returned_s = math.inf

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Ready descriptors, or none within the time or HEARTBEAT_S."""
        begun_s = time.monotonic()
        self._note(begun_s, begun_s - self._returned_s)
        wait_s = HEARTBEAT_S if timeout is None else max(0.0, min(timeout, HEARTBEAT_S))
        ready = super().select(wait_s)
        self._returned_s = time.monotonic()
        self._note(self._returned_s, self._returned_s - begun_s - wait_s)
        return ready

    def stalled_since(self, since_s: float) -> float:
        """For how long the process has stood still since an instant."""
        return sum(min(long_s, end_s - since_s) for end_s, long_s in self._stalls if end_s > since_s)

    def _note(self, end_s: float, long_s: float) -> None:
        if long_s > STALL_S:
            self._stalls.append((end_s, long_s))


class _VirtualSelector(selectors.DefaultSelector):
    """A selector that moves the clock instead of waiting for it."""

    def __init__(self, loop: BenchLoop, speed: float, origin_s: float) -> None:
        super().__init__()
        self._loop = loop
        self._speed = speed
        self.now = origin_s
        self._turns_here = 0
        self._turns_since_poll = 0
        self._real_s = 0.0  # real time owed before the clock may go on, when paced
        self._last_real = time.monotonic()

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Ready descriptors; moves the clock to the next timer when there is nothing else to do."""
        self._turns_here += 1
        if self._turns_here > TURNS_AT_ONE_INSTANT:
            self._turns_here = 0  # cancelled tasks get their turns to clean up
            raise TimeError(
                f"virtual time stands at {self.now:.6f} s: {TURNS_AT_ONE_INSTANT} turns of the loop without an end"
            )
        ready = self._poll()
        if ready or timeout == 0 or self._loop.take_in_answer():
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
        if len(self.get_map()) == 1 and self._turns_since_poll < POLL_EVERY_TURNS:
            return []
        self._turns_since_poll = 0
        return super().select(0)

    @property
    def is_paced(self) -> bool:
        """Whether real time passes with it."""
        return self._speed < AS_FAST_AS_POSSIBLE

    def move_to(self, when: float) -> None:
        """Moves the clock; it never goes back."""
        if when > self.now:
            self.now = when
            self._turns_here = 0

    def _wait_outside(self) -> list[tuple[selectors.SelectorKey, int]]:
        """No timer: only a real descriptor could bring something; none of these is a deadlock."""
        ready: list[tuple[selectors.SelectorKey, int]] = []

        def something_came(slice_s: float) -> bool:
            ready.extend(selectors.DefaultSelector.select(self, slice_s))
            return bool(ready)

        if len(self.get_map()) > 1 and came_true(something_came, THREAD_ANSWER_LIMIT_S):
            return ready
        raise TimeError(f"virtual time stands at {self.now:.6f} s: deadlock, no timer is set and nothing is under way")

    def _paced(self, when: float) -> list[tuple[selectors.SelectorKey, int]]:
        """Lets real time pass in proportion; a descriptor may end the wait early."""
        real = time.monotonic()
        ahead = (when - self.now) / self._speed - (real - self._last_real)
        ready = super().select(ahead) if ahead > 0 else []
        after = time.monotonic()
        passed = min(when, self.now + (after - self._last_real) * self._speed) if ready else when
        self._last_real = after if ready else self._last_real + (when - self.now) / self._speed
        self.move_to(passed)
        return ready


def run(main: Coroutine[Any, Any, T], speed: float = REAL_TIME, origin_s: float = 0.0) -> T:
    """Runs `main` on a BenchLoop at `speed` and closes the loop; tasks left behind are cancelled and awaited.

    Bench time begins at `origin_s`.

    One that does not end within `TASKS_END_WITHIN_S` is abandoned, so that a mistake in it keeps nobody from the end.
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
        asyncio.tasks._unregister_task(task)  # which closing the loop would wait for for ever
        task._log_destroy_pending = False  # type: ignore[attr-defined]  # as asyncio.gather does
