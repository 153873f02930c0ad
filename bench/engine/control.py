"""Requests of the operator and of interlocks during a run: hold, skip, repeat, end after the step."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Literal

from bench.engine.journal import Journal
from bench.sequence.steps.fields import StepBase

Wish = Literal["skip", "repeat", "hold"]
OPERATOR = "operator"


class StepUnderWay:
    """A running step that can be interrupted: its cancel scope and the request that interrupts it."""

    def __init__(self, step: StepBase, limit: asyncio.Timeout) -> None:
        self.step, self._limit = step, limit
        self.wish: Wish | None = None

    def cut(self, wish: Wish) -> bool:
        """End the step now; return false if it is already ending."""
        if self._limit.expired():
            return False
        self.wish = wish
        self._limit.reschedule(asyncio.get_running_loop().time())
        return True


class Control:
    """Hold back steps while there is a reason to, and cancel running ones.

    Concurrency: one loop; its methods may be called at any time, also from within the steps.
    """

    def __init__(
        self, journal: Journal, notice: Callable[[str], None], on_held: Callable[[str], None] = lambda _by: None
    ) -> None:
        self._journal, self._notice, self._on_held = journal, notice, on_held
        self._reasons: set[str] = set()
        self._repeat_last = False
        self._woken = asyncio.Event()
        self.last_step = False
        self.aborting = False  # set once no further teardown may begin
        self.under_way: dict[str, StepUnderWay] = {}

    def hold(self, by: str) -> None:
        """Let no step begin until `by` releases the run."""
        self._reasons.add(by)

    def release(self, by: str) -> None:
        """Remove the hold of `by`."""
        self._reasons.discard(by)
        if not self._reasons:
            self._woken.set()

    def release_all(self) -> None:
        """Remove all holds."""
        for by in tuple(self._reasons):
            self.release(by)

    @property
    def held(self) -> bool:
        """True while anybody holds the run."""
        return bool(self._reasons)

    @property
    def held_by(self) -> str:
        """Return the names of those who hold the run."""
        return ", ".join(self.reasons)

    @property
    def reasons(self) -> list[str]:
        """Return why no further step begins, also while one is still completed."""
        return sorted(self._reasons)

    def cut(self, wish: Wish, kind: type[StepBase] = StepBase) -> list[str]:
        """Cancel the current steps of a kind; return their ids."""
        of_kind = [(step_id, found) for step_id, found in self.under_way.items() if isinstance(found.step, kind)]
        return [step_id for step_id, found in of_kind if found.cut(wish)]

    def repeat_last(self) -> None:
        """Repeat the step before the one that is held back."""
        self._repeat_last = True
        self._woken.set()

    async def may_begin(self, step: str) -> bool:
        """Wait until a step may begin; return true, or false if the step before it is to be repeated first."""
        while self._reasons:
            if self._repeat_last:
                self._repeat_last = False
                return False
            await self._wait_for_change(step)
        self._repeat_last = False
        return True

    async def _wait_for_change(self, step: str) -> None:
        for by in sorted(self._reasons - self._journal.state.held):
            self._journal.try_to_write("held", step, by=by)
            self._notice(f"Held before step {step} by the {by}.")
        self._on_held(self.held_by)
        self._woken.clear()
        await self._woken.wait()
        self._on_held(self.held_by)
        for by in sorted(self._journal.state.held - self._reasons):
            self._journal.try_to_write("released", by=by)
