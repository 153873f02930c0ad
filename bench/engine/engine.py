"""Runs a plan: setup, steps, teardown, and in any case a bench made safe."""

from __future__ import annotations

import asyncio
import contextlib
import traceback
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

from bench.engine.actions import Bench, perform
from bench.engine.monitor import Monitor
from bench.engine.safety import finish
from bench.errors import BenchError, StepError, StoreError
from bench.rig import MAKE_SAFE_S, Rig
from bench.sequence.plan import Plan, PlannedStep
from bench.store.writer import RunWriter
from drivers.errors import DriverError

How = Literal["completed", "error", "aborted"]


@dataclass
class Outcome:
    """How a run ended. `problems` are for people, the first one is why; `unsafe` names devices not made safe."""

    how: How = "completed"
    problems: list[str] = field(default_factory=list)
    unsafe: dict[str, str] = field(default_factory=dict)


class Observer(Protocol):
    """Whoever shows a run while it goes on; called in the loop, so it must not take long."""

    def step_begins(self, planned: PlannedStep, index: int) -> None:
        """A step of the plan, by its place in it, begins."""

    def step_ended(self, planned: PlannedStep, index: int) -> None:
        """A step is done."""

    def notice(self, text: str) -> None:
        """Something a person should see now."""


class Engine:
    """Runs one plan on one rig.

    Lifetime: one `run`. Concurrency: `stop` and `abort` may be called from signal handlers of the same loop while it
    runs. Whatever happens once setup began, teardown runs (unless aborted), and the devices are made safe at the end.
    """

    def __init__(self, plan: Plan, rig: Rig, monitor: Monitor, writer: RunWriter, observer: Observer) -> None:
        self._plan, self._rig, self._monitor = plan, rig, monitor
        self._writer, self._observer = writer, observer
        self._bench = Bench(rig, monitor, writer, observer.notice)
        self._indices = {planned.id: index for index, planned in enumerate(plan)}
        self._body_task: asyncio.Task[None] | None = None
        self._teardown_task: asyncio.Task[None] | None = None
        self._aborting = False
        self._going_on = asyncio.Event()
        self._going_on.set()
        self._last_step = False
        self.outcome = Outcome()

    @property
    def in_teardown(self) -> bool:
        """Whether the teardown has begun."""
        return self._teardown_task is not None

    def pause(self) -> None:
        """Holds before the next step; the devices stay as they are and go on being watched. Not in teardown."""
        self._going_on.clear()

    def resume(self) -> None:
        """Goes on after a pause."""
        self._going_on.set()

    def stop_after_step(self) -> None:
        """Ends setup and steps when the step under way is done; teardown runs."""
        self._last_step = True
        self._going_on.set()

    def stop(self) -> None:
        """Ends the step under way; teardown runs."""
        if self._body_task is not None:
            self._body_task.cancel("stopped by the operator")

    def abort(self) -> None:
        """Ends the step under way and drops the teardown; the devices are made safe."""
        self._aborting = True
        self.stop()
        if self._teardown_task is not None:
            self._teardown_task.cancel("aborted by the operator")

    async def run(self) -> Outcome:
        """Runs the plan; what a device, the disk or the operator did is told by the outcome, not raised."""
        self._monitor.start()
        try:
            self._body_task = asyncio.create_task(self._body(), name="setup and steps")
            await self._watched(self._body_task)
            if not self._aborting:
                self._teardown_task = asyncio.create_task(self._teardown(), name="teardown")
                await asyncio.wait([self._teardown_task])
                self._settle(self._teardown_task)
        finally:
            self.outcome.unsafe = await finish(self._make_safe(), MAKE_SAFE_S + 5)
        return self.outcome

    async def _watched(self, task: asyncio.Task[None]) -> None:
        """Waits for the task; what the monitor finds ends it."""
        try:
            first: list[asyncio.Future[Any]] = [task, self._monitor.fault]
            await asyncio.wait(first, return_when=asyncio.FIRST_COMPLETED)
        finally:
            if not task.done():
                task.cancel()
                await asyncio.wait([task])
        if self._monitor.fault.done() and task.cancelled():
            self._failed(self._monitor.fault.result())
        else:
            self._settle(task)

    def _settle(self, task: asyncio.Task[None]) -> None:
        """Takes over how a finished task ended."""
        if task.cancelled():
            if self.outcome.how == "completed":
                self.outcome.how = "aborted"
            self.outcome.problems.append("ended by the operator")
            self._journal("operator", action="abort" if self._aborting else "stop")
        elif (problem := task.exception()) is not None:
            self._failed(problem)

    def _failed(self, problem: BaseException) -> None:
        self.outcome.how = "error"
        text = str(problem)
        if not isinstance(problem, (DriverError, BenchError)):
            text = "a mistake of this program: " + "".join(traceback.format_exception(problem))
        self.outcome.problems.append(text)
        self._observer.notice(text)
        self._journal("problem", text=str(problem))

    def _journal(self, kind: str, **data: Any) -> None:
        """A journal entry that must not stand in the way of what comes after it."""
        with contextlib.suppress(StoreError):  # told by the step that it stopped, or by the end of the run
            self._writer.event(kind, **data)

    async def _body(self) -> None:
        for planned in (*self._plan.setup, *self._plan.steps):
            await self._may_begin(planned)
            await self._step(planned)

    async def _may_begin(self, planned: PlannedStep) -> None:
        """Where a pause holds, and a stop after the step under way takes effect."""
        if not self._going_on.is_set():
            self._journal("operator", action="pause", before=planned.id)
            self._observer.notice(f"Paused before step {planned.id}.")
            await self._going_on.wait()
            self._journal("operator", action="resume")
        if self._last_step:
            self.stop()
            await asyncio.sleep(0)  # here the cancellation takes effect

    async def _teardown(self) -> None:
        """Every step is tried, also after one has failed."""
        for planned in self._plan.teardown:
            try:
                await self._step(planned)
            except Exception as problem:  # noqa: BLE001  the next step of the teardown matters more
                self._failed(problem)

    async def _step(self, planned: PlannedStep) -> None:
        index = self._indices[planned.id]
        await self._record("step_begins", planned)  # the intent is on the disk before anything moves
        self._observer.step_begins(planned, index)
        try:
            result = await self._in_time(planned)
        except (DriverError, BenchError) as problem:
            raise StepError(f"{self._plan.where(planned)}: step {planned.id}: {problem}") from problem
        await self._record("step_ended", planned, **result)
        self._observer.step_ended(planned, index)

    async def _in_time(self, planned: PlannedStep) -> Mapping[str, Any]:
        """Does the step; StepError when it takes longer than the timeout that the sequence gives it."""
        limit = asyncio.timeout(planned.step.timeout_s)
        try:
            async with limit:
                return await perform(planned, self._bench)
        except TimeoutError:
            if not limit.expired():  # a silent instrument is a TimeoutError too
                raise
        raise StepError(
            f"takes longer than its timeout of {planned.step.timeout_s:g} s. Look what it waits for, or allow more."
        )

    async def _record(self, kind: str, planned: PlannedStep, **data: Any) -> None:
        """A journal entry of a step; an intent is on the disk, with all before it, when this returns.

        The teardown goes on without a disk.
        """
        try:
            self._writer.event(kind, planned.id, **data)
            if kind == "step_begins":
                await self._writer.commit()
        except StoreError:
            if planned.phase != "teardown":
                raise

    async def _make_safe(self) -> dict[str, str]:
        """Makes every device safe while the readings are still recorded, then ends the record."""
        unsafe = await self._rig.make_safe()
        self._journal("made_safe", unsafe=unsafe)
        for device, problem in unsafe.items():
            self.outcome.how = "error"
            self._observer.notice(f"{device} COULD NOT BE MADE SAFE: {problem}")
        await self._monitor.stop()
        return unsafe
