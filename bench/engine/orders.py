"""Orders that a step waits for, and the signs of life without which it ends."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Mapping
from typing import Any, NamedTuple, Protocol

from bench.engine.safety import grouped
from bench.errors import InputError
from bench.sequence.plan.plan import PlannedStep

CLOSED = "this run takes no orders: it is no session of manual control, or the session is about to end"


class Given(NamedTuple):
    """An order: the step, the devices that it acts on, and who gave it."""

    planned: PlannedStep
    devices: tuple[str, ...]
    by: str


class Orders:
    """Orders to a step that waits for them. `obey` executes one; `on_silence` is called when signs of life are missing.

    Concurrency: one loop. Orders are executed at the same time; who gives them keeps them apart.
    """

    def __init__(self) -> None:
        self.obey: Callable[[Given], Coroutine[Any, Any, None]]
        self.on_silence: Callable[[str], None] = lambda _text: None
        self._waiting: asyncio.Queue[Given | None] | None = None
        self._heard_s, self.silence_s = 0.0, 0.0

    @property
    def is_open(self) -> bool:
        """True while a step waits for orders."""
        return self._waiting is not None

    @property
    def left_s(self) -> float:
        """Time in s until the run is stopped, unless there is a sign of life."""
        return max(0.0, self._heard_s + self.silence_s - asyncio.get_running_loop().time())

    def give(self, given: Given | None) -> None:
        """Give an order, or with None end the session. Raises InputError if no step waits for one."""
        self.heard()
        if self._waiting is not None:
            self._waiting.put_nowait(given)
        if given is None:
            self._waiting = None

    def heard(self) -> None:
        """Note a sign of life. Raises InputError if no step waits for orders."""
        if self._waiting is None:
            raise InputError(CLOSED)
        self._heard_s = asyncio.get_running_loop().time()

    async def attend(self, silence_s: float) -> None:
        """Obey orders until the session is ended, or nobody has given a sign of life for `silence_s`."""
        self._waiting, self.silence_s = asyncio.Queue(), silence_s
        self.heard()
        try:
            await grouped(self._serve(self._waiting))
        finally:
            self._waiting = None

    async def _serve(self, waiting: asyncio.Queue[Given | None]) -> None:
        async with asyncio.TaskGroup() as group:
            while (given := await self._next(waiting)) is not None:
                group.create_task(self.obey(given))

    async def _next(self, waiting: asyncio.Queue[Given | None]) -> Given | None:
        while self.left_s > 0:
            try:
                async with asyncio.timeout(self.left_s):
                    return await waiting.get()
            except TimeoutError:
                continue
        self._waiting = None
        self.on_silence(f"nobody has given a sign of life for {self.silence_s / 60:g} min")
        await asyncio.Event().wait()  # until the stop arrives
        return None


class Patience(Protocol):
    """Part of the settings of the step."""

    @property
    def give_up_after_s(self) -> float:
        """Time in s without a sign of life after which the run is stopped."""


class Attended(Protocol):
    """Part of a run that the step uses."""

    @property
    def orders(self) -> Orders:
        """Orders to the run."""


async def attend(settings: Patience, bench: Attended) -> Mapping[str, Any]:
    """Execute `custom: manual_control`."""
    await bench.orders.attend(settings.give_up_after_s)
    return {}
