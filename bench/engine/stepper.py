"""Execute one step: its journal entries, its time limit, and the stop of its motion if it ends early."""

from __future__ import annotations

import asyncio
import traceback
from collections.abc import Awaitable, Callable, Mapping
from typing import Protocol

from bench.engine.actions import begin_sweep, begin_turning, leave, perform, target_of
from bench.engine.context import Bench, Found
from bench.engine.control import Control, StepUnderWay, Wish
from bench.engine.recording import acquire_during
from bench.engine.safety import finish
from bench.errors import BenchError, StepError, StoreError
from bench.sequence.checks.steps import limit_problems
from bench.sequence.plan.plan import Plan, PlannedStep
from bench.sequence.plan.waiting import completed
from bench.sequence.steps.measuring import Acquire
from bench.sequence.steps.orienting import Orient
from bench.sequence.steps.stimulus import Move, Oscillate, Ramp, Rotate
from bench.sequence.steps.verbs import Step
from drivers.errors import DriverError

Body = Callable[[], Awaitable[None]]  # executes the inner steps


class Watcher(Protocol):
    """Observer of the steps of a run; called in the loop, so it must return quickly."""

    def step_begins(self, planned: PlannedStep, index: int) -> None:
        """A step of the plan begins, at this index."""

    def step_ended(self, planned: PlannedStep, index: int) -> None:
        """A step is done."""

    def held(self, by: str) -> None:
        """No step begins while `by` holds the run; an empty `by` means no hold."""

    def notice(self, text: str) -> None:
        """Something a person should see now."""


class Stopped(BenchError):
    """The run ends after the current step, at the operator's request."""

    code = "stopped"


class StepFailed(StepError):
    """A step has failed; the code is that of its error."""

    def __init__(self, text: str, code: str) -> None:
        super().__init__(text)
        self.code = code


class UnitFailed(StepFailed):
    """A value is outside its limits and the sequence stops there: the unit is bad, not the bench."""


class Stepper:
    """Executes the steps of a plan, one by one; a failure is raised as StepFailed, with the place of the step.

    Every begun step also ends in the journal while it can be written: `step_ended`, `step_failed`, or `step_cut` with
    the origin of the request. `indices` are the indices of steps in the plan by their ids.
    """

    def __init__(
        self, plan: Plan, bench: Bench, control: Control, watcher: Watcher, indices: Mapping[str, int]
    ) -> None:
        self._plan, self._bench, self._journal = plan, bench, bench.journal
        self._control, self._watcher, self._indices = control, watcher, indices

    async def step(self, planned: PlannedStep, body: Body | None = None) -> bool:
        """Execute a step once, with the steps inside it; return whether it is to be repeated."""
        step = planned.step
        try:
            step = await self._begin(planned)
            if self._bench.credit is not None:
                self._bench.credit.begins(step)
            found = await self._within_its_time(step, planned, body)
        except (asyncio.CancelledError, Stopped):
            self._journal.try_to_write("step_cut", planned.id, wish="end", **self._unknown_after(step))
            await self._bring_to_rest(step)
            raise
        except StoreError:
            raise
        except (DriverError, BenchError) as problem:
            facts = {"code": problem.code, "text": str(problem), **self._unknown_after(step)}
            self._journal.try_to_write("step_failed", planned.id, **facts)
            if isinstance(step, (Rotate, Oscillate)):
                await self._bring_to_rest(step)
            raise self._in_words(planned, problem) from problem
        if isinstance(found, str):
            return found != "skip"
        self._end(planned, found)
        if found.get("verdict") == "FAIL" and step.on_failure in ("stop", "ask"):
            raise UnitFailed(_outside_limits(self._plan.where(planned.place), planned.id, found), "step")
        return False

    async def _within_its_time(self, step: Step, planned: PlannedStep, body: Body | None) -> Found | Wish:
        """Return the result of the step, or the request that interrupted it; StepError if it takes too long."""
        limit = asyncio.timeout(step.timeout_s)
        under_way = StepUnderWay(step, limit)
        if body is None:
            self._control.under_way[planned.id] = under_way
        try:
            async with limit:
                if body is not None:
                    return await self._meanwhile(step, planned, body)
                return await perform(step, planned.id, self._bench)
        except TimeoutError:
            if not limit.expired():  # a silent instrument is a TimeoutError too
                raise
            if under_way.wish is not None:
                await self._cut(planned, step, under_way.wish)
                return under_way.wish
            await self._bring_to_rest(step)
            raise StepError(
                f"takes longer than its timeout of {step.timeout_s:g} s. Check what it waits for, or increase the "
                "timeout."
            ) from None
        except SystemExit as problem:  # raised by a plug-in; it would end this program without making the bench safe
            where = traceback.extract_tb(problem.__traceback__)[-1]
            raise StepError(
                f"{where.filename}:{where.lineno}: wants to end the program ({problem!r}); a plug-in raises an error"
            ) from problem
        finally:
            self._control.under_way.pop(planned.id, None)

    async def _meanwhile(self, step: Step, planned: PlannedStep, body: Body) -> Found:
        """Execute a step that lasts as long as the steps inside it."""
        if isinstance(step, Acquire):
            return await acquire_during(step, planned.id, self._bench, body())
        if isinstance(step, (Rotate, Oscillate)):
            await begin_turning(step, self._bench)
            self._journal.write("turning", planned.id, **_sustained_rate(step))
            if isinstance(step, Oscillate):
                await begin_sweep(step, self._bench)
            await body()
            await leave(step, self._bench)
        return {}

    async def _cut(self, planned: PlannedStep, step: Step, wish: Wish) -> None:
        """Stop what an interrupted step has started."""
        await leave(step, self._bench)
        self._journal.write("step_cut", planned.id, wish=wish, **self._unknown_after(step))
        if wish == "skip":
            self._journal.write("left_out", planned.id, why="skipped by the operator", text="")

    def _unknown_after(self, step: Step) -> Found:
        """Axes, or the chamber, in an unknown state after a step that did not complete."""
        match step:
            case Move() | Ramp():
                return {"unknown": [step.role]}
            case Orient():
                return {"unknown": list(self._bench.file.axes)}
            case _:
                return {}

    async def _bring_to_rest(self, step: Step) -> None:
        """Stop the motion of a step, as far as the device obeys; after an abort, making safe does this."""
        if self._control.aborting:
            return
        limit_s = self._bench.rig.safe_within_s
        try:
            await finish(leave(step, self._bench), limit_s, unless=lambda: self._control.aborting)
        except DriverError as problem:
            self._watcher.notice(str(problem))
        except TimeoutError:
            self._watcher.notice(f"The motion started by the step has not stopped within {limit_s:g} s.")

    async def _begin(self, planned: PlannedStep) -> Step:
        """Prepare the step; its intent and all entries before it are on the disk before anything moves.

        The teardown goes on without a disk. Raises StepError for a step that the bench cannot take.
        """
        step: Step = planned.step
        problem: StepError | None = None
        try:
            step = self._ready(planned)
        except StepError as found:
            problem = found
        try:
            self._journal.write("step_begins", planned.id, **(target_of(step, self._bench) if problem is None else {}))
            await self._journal.commit()
        except StoreError:
            if planned.phase != "teardown":
                raise
        self._watcher.step_begins(planned, self._indices[planned.id])
        if problem is not None:
            raise problem
        return step

    def _end(self, planned: PlannedStep, found: Found) -> None:
        try:
            self._journal.write("step_ended", planned.id, **found)
        except StoreError:
            if planned.phase != "teardown":
                raise
        self._watcher.step_ended(planned, self._indices[planned.id])

    def _ready(self, planned: PlannedStep) -> Step:
        """The step with measured values inserted; StepError if they exceed the limits of the bench."""
        if planned.waiting is None:
            return planned.step
        owner, _ = self._plan.document.owner(planned.place)
        step = completed(planned, self._journal.state.variables, owner.path.parent)
        from_deg = self._bench.angles_deg.get(step.role, 0.0) if isinstance(step, (Move, Rotate)) else 0.0
        if problems := [problem for _, problem in limit_problems(step, self._bench.file, from_deg)]:
            raise StepError(f"{'; '.join(problems)}. Nothing was sent.")
        return step

    def _in_words(self, planned: PlannedStep, problem: DriverError | BenchError) -> StepFailed:
        """The error with the place of its step; an error of a nested step already has it."""
        if isinstance(problem, StepFailed):
            return problem
        text = f"{self._plan.where(planned.place)}: step {planned.id}: {problem}"
        return StepFailed(text, problem.code)


def _sustained_rate(step: Rotate | Oscillate) -> Found:
    """Motion of the table until the step ends."""
    if isinstance(step, Rotate):
        return {"device": step.role, "rate_dps": step.rate_dps}
    found = {"device": step.role, "amplitude_deg": step.amplitude_deg}
    if (chirp := step.chirp) is not None:
        return found | {"sweep_hz": [chirp.from_hz, chirp.to_hz], "sweep_s": chirp.over_s}
    return found | {"frequency_hz": step.highest_hz}


def _outside_limits(place: str, step: str, found: Found) -> str:
    """Message for a measured value outside its limits; for an accelerometer of an inertial unit with the others."""
    if "others" not in found:
        return f"{place}: step {step}: {found['reading']} is outside its limits."
    sensor, others = found["reading"].rpartition(".")[2], found["others"].items()
    read = ", ".join(f"{name} {value:.4f} {found['unit']}" for name, value in ((sensor, found["value"]), *others))
    return (
        f"{place}: step {step}: {found['reading']} is outside its limits. The accelerometers read {read}: check which "
        "axis of the unit is up and, with the source, which channel its cable is in; then run it again."
    )
