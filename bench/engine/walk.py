"""Goes through the nodes of a plan: loops, alternatives, branches, attempts, and what happens when a step fails."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Protocol, assert_never

from bench.engine.actions import Bench, Found, begin_turning, leave, perform
from bench.engine.control import Control, StepUnderWay
from bench.engine.measuring import record_during
from bench.engine.questions import Question
from bench.errors import BenchError, StepError, StoreError
from bench.sequence.check_steps import limit_problems
from bench.sequence.measuring import Acquire
from bench.sequence.plan import (
    Alternatives,
    Attempts,
    Branches,
    Meanwhile,
    Node,
    Nodes,
    Passes,
    Plan,
    PlannedStep,
    Section,
    leaves,
    renamed,
)
from bench.sequence.step_fields import OnFailure
from bench.sequence.steps import Step
from bench.sequence.stimulus import Move, Oscillate, Rotate
from bench.sequence.talk import A_DAY_S
from bench.sequence.waiting import completed, is_true
from drivers.errors import DriverError

AFTER_A_FAILURE = ("stop", "continue", "repeat")
Doing = Coroutine[Any, Any, bool | None]


class Watcher(Protocol):
    """Whoever is told of steps; called in the loop, so it must not take long."""

    def step_begins(self, planned: PlannedStep, index: int) -> None:
        """A step of the plan, by its place in it, begins."""

    def step_ended(self, planned: PlannedStep, index: int) -> None:
        """A step is done."""

    def notice(self, text: str) -> None:
        """Something a person should see now."""


class Stopped(BenchError):
    """The run ends after the step under way, as the operator wished."""

    code = "stopped"


class StepFailed(StepError):
    """A step has failed; its code is that of the error that it failed with."""

    def __init__(self, text: str, code: str) -> None:
        super().__init__(text)
        self.code = code


class Walk:
    """Does the steps of a plan.

    What fails is raised as StepError unless the sequence says to go on; a step that is begun again, by a retry or by
    the operator, has `~2`, `~3`, … after its id.
    """

    def __init__(
        self, plan: Plan, bench: Bench, control: Control, watcher: Watcher, failed: Callable[[BaseException], None]
    ) -> None:
        self._plan, self._bench, self._journal = plan, bench, bench.journal
        self._control, self._watcher, self._failed = control, watcher, failed
        self._indices = {planned.id: index for index, planned in enumerate(plan)}
        self._visits: Counter[str] = Counter()
        self._last: PlannedStep | None = None
        self._teardowns: set[asyncio.Task[None]] = set()  # of groups, those that are under way
        self.aborting = False

    def abort(self) -> None:
        """No teardown begins any more, and those of groups that are under way end."""
        self.aborting = True
        for teardown in self._teardowns:
            teardown.cancel("aborted")

    async def nodes(self, nodes: Nodes) -> None:
        """Does nodes one after the other."""
        for node in nodes:
            await self._node(node)

    async def teardown(self, nodes: Nodes) -> None:
        """Every node is tried, also after one has failed."""
        for node in nodes:
            try:
                await self._node(node)
            except Exception as problem:  # noqa: BLE001  the next step of the teardown matters more
                self._failed(problem)

    async def _node(self, node: Node) -> None:
        match node:
            case PlannedStep():
                await self._leaf(node)
            case Meanwhile():
                await self._leaf(node.step, node.body)
            case Section():
                await self._section(node)
            case Alternatives():
                variables = self._journal.state.variables
                with self._told_where(node):
                    chosen = node.then if is_true(node.condition, variables) else node.otherwise
                await self.nodes(chosen)
            case Passes():
                await self._passes(node)
            case Branches():
                await self._branches(node)
            case Attempts():
                await self._attempts(node)
            case _:
                assert_never(node)

    @contextmanager
    def _told_where(self, node: Alternatives | Passes) -> Iterator[None]:
        try:
            yield
        except StepError as problem:
            raise StepError(f"{self._plan.where(node.place)}: {node.id}: {problem}") from problem

    async def _passes(self, node: Passes) -> None:
        for number in range(1, node.at_most + 1):
            with self._told_where(node):
                if not is_true(node.condition, self._journal.state.variables):
                    return
            await self.nodes(self._numbered(node, number))
        with self._told_where(node):
            if is_true(node.condition, self._journal.state.variables):
                raise StepError(
                    f"its condition {node.condition.raw} is still true after {node.at_most} passes. "
                    "Look why, or allow more with at_most."
                )

    def _numbered(self, node: Passes, number: int) -> Nodes:
        """The steps of a pass, with the number of the pass in their ids."""
        body = renamed(node.body, f"{node.id}/pass=1/", f"{node.id}/pass={number}/")
        for first, again in zip(leaves(node.body), leaves(body), strict=True):
            self._indices[again.id] = self._indices[first.id]
        return body

    async def _branches(self, node: Branches) -> None:
        stopped = False

        async def branch(nodes: Nodes) -> None:
            nonlocal stopped
            try:
                await self.nodes(nodes)
            except Stopped:  # the other branches end the steps that they are at
                stopped = True

        try:
            async with asyncio.TaskGroup() as group:
                for name, nodes in node.branches.items():
                    group.create_task(branch(nodes), name=f"{node.id}/{name}")
        except BaseExceptionGroup as problems:
            raise _first(problems) from problems
        if stopped:
            raise Stopped

    async def _attempts(self, node: Attempts) -> None:
        for number in range(1, node.count + 1):
            try:
                await self.nodes(node.body)
                return
            except (DriverError, BenchError) as problem:
                if number == node.count or code_of(problem) not in node.on:
                    raise
                self._journal.write("retried", node.id, attempt=number, text=str(problem))
                self._watcher.notice(f"Attempt {number} of {node.count} has failed, it is tried again: {problem}")
            await asyncio.sleep(node.delay_s)

    async def _section(self, node: Section) -> None:
        """Its teardown runs however its steps ended, unless the run is aborted."""
        why: Exception | None = None
        try:
            while await self._failing(node.on_failure, node.id, self.nodes(node.body)):
                pass
        except Exception as problem:
            why = problem
            raise
        finally:
            if not self.aborting:
                await self._undisturbed(node.teardown, why)

    async def _undisturbed(self, teardown: Nodes, why: Exception | None) -> None:
        """A teardown to its end, whatever ends the steps around it meanwhile; only an abort cuts it short.

        When it was cancelled, the cancellation goes on after it, and `why` it ran is not lost.
        """
        task = asyncio.create_task(self.teardown(teardown))
        self._teardowns.add(task)
        cancelled: asyncio.CancelledError | None = None
        while not task.done():
            try:
                await asyncio.wait([task])
            except asyncio.CancelledError as request:
                cancelled = request
        self._teardowns.discard(task)
        if cancelled is not None or task.cancelled():
            if why is not None and not isinstance(why, Stopped):
                self._failed(why)
            raise cancelled or asyncio.CancelledError
        task.result()

    async def _meanwhile(self, step: Step, planned: PlannedStep, body: Nodes) -> Found:
        """A step that lasts as long as those inside it."""
        if isinstance(step, Acquire):
            return await self._recording(step, planned, body)
        if isinstance(step, (Rotate, Oscillate)):
            await begin_turning(step, self._bench)
            await self.nodes(body)
            await leave(step, self._bench)
        return {}

    async def _recording(self, step: Acquire, planned: PlannedStep, body: Nodes) -> Found:
        over, bench, loop = asyncio.Event(), self._bench, asyncio.get_running_loop()
        began_s = loop.time()
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(record_during(step, planned.id, bench.rig, bench.writer, over))
                await self.nodes(body)
                over.set()
        except BaseExceptionGroup as problems:
            raise _first(problems) from problems
        return {"label": step.label, "begin_s": began_s, "end_s": loop.time()}

    async def _leaf(self, planned: PlannedStep, body: Nodes | None = None) -> None:
        """Does a step, again if the operator wishes; whatever it fails with goes by its `on_failure`."""
        await self._may_begin(planned)
        while await self._failing(planned.step.on_failure, planned.id, self._step(self._visited(planned), body)):
            await self._may_begin(planned)
        if body is None:
            self._last = planned

    async def _may_begin(self, planned: PlannedStep) -> None:
        """Where a pause holds, and a stop after the step under way takes effect; not in a teardown."""
        if planned.phase == "teardown":
            return
        while not await self._control.may_begin(planned.id):
            if self._last is not None:
                self._journal.try_to_write("operator", self._last.id, action="repeat")
                await self._step(self._visited(self._last))
        if self._control.last_step:
            raise Stopped

    async def _failing(self, on_failure: OnFailure | None, step_id: str, doing: Doing) -> bool:
        """Awaits what may fail; whether it is to be done again. Raises what the sequence does not say to pass over."""
        try:
            return bool(await doing)
        except (DriverError, BenchError) as problem:
            if on_failure not in ("continue", "ask") or isinstance(problem, (StoreError, Stopped)):
                raise
            decided = "continue" if on_failure == "continue" else await self._asked(step_id, problem)
            if decided == "stop":
                raise
            if decided == "continue":
                self._journal.write("left_out", step_id, text=str(problem), why="on_failure")
                self._watcher.notice(f"{problem}\nThe run goes on without it, as the sequence says.")
            return decided == "repeat"

    async def _asked(self, step_id: str, problem: Exception) -> str:
        question = Question(f"{step_id}?", f"{problem} What now?", AFTER_A_FAILURE)
        self._journal.write("asked", question.step, text=question.text, expected=question.expected)
        answer = await self._bench.desk.ask(question, A_DAY_S)
        self._journal.write("answered", question.step, answer=str(answer.value), by=answer.by)
        return str(answer.value)

    async def _step(self, planned: PlannedStep, body: Nodes | None = None) -> bool:
        """One try at a step, with the steps that are done meanwhile; whether it is to be done again."""
        index, step = self._indices[planned.id], planned.step
        await self._begin(planned, index)
        try:
            step = self._ready(planned)
            limit = asyncio.timeout(step.timeout_s)
            under_way = StepUnderWay(limit)
            if body is None:
                self._control.under_way[planned.id] = under_way
            try:
                async with limit:
                    doing = (
                        perform(step, planned.id, self._bench) if body is None else self._meanwhile(step, planned, body)
                    )
                    found = await doing
            except TimeoutError:
                if not limit.expired():  # a silent instrument is a TimeoutError too
                    raise
                if under_way.wish is not None:
                    return await self._cut(planned, step, under_way.wish)
                await self._bring_to_rest(step)
                raise StepError(
                    f"takes longer than its timeout of {step.timeout_s:g} s. Look what it waits for, or allow more."
                ) from None
            finally:
                self._control.under_way.pop(planned.id, None)
        except (asyncio.CancelledError, Stopped):
            self._journal.try_to_write("step_cut", planned.id, wish="end")
            await self._bring_to_rest(step)
            raise
        except (DriverError, BenchError) as problem:
            self._journal.try_to_write("step_failed", planned.id, code=code_of(problem), text=str(problem))
            if isinstance(step, (Rotate, Oscillate)):
                await self._bring_to_rest(step)
            raise self._in_words(planned, problem) from problem
        await self._end(planned, index, found)
        if found.get("verdict") == "FAIL" and step.on_failure in ("stop", "ask"):
            raise self._in_words(planned, StepError(f"{found['reading']} is outside its limits"))
        return False

    async def _bring_to_rest(self, step: Step) -> None:
        """What a step has set going ends with it, as far as the device obeys; an abort leaves it to the making safe."""
        if self.aborting:
            return
        try:
            await leave(step, self._bench)
        except DriverError as problem:
            self._watcher.notice(str(problem))

    async def _cut(self, planned: PlannedStep, step: Step, wish: str) -> bool:
        """Brings to rest what was cut short; whether it is to be done again."""
        await leave(step, self._bench)
        self._journal.write("step_cut", planned.id, wish=wish)
        if wish == "skip":
            self._journal.write("left_out", planned.id, why="skipped by the operator", text="")
        return wish != "skip"

    async def _begin(self, planned: PlannedStep, index: int) -> None:
        """The intent is on the disk, with all before it, before anything moves; the teardown goes on without a disk."""
        try:
            self._journal.write("step_begins", planned.id)
            await self._journal.commit()
        except StoreError:
            if planned.phase != "teardown":
                raise
        self._watcher.step_begins(planned, index)

    async def _end(self, planned: PlannedStep, index: int, found: Found) -> None:
        try:
            self._journal.write("step_ended", planned.id, **found)
        except StoreError:
            if planned.phase != "teardown":
                raise
        self._watcher.step_ended(planned, index)

    def _ready(self, planned: PlannedStep) -> Step:
        """The step with what was measured, held against the limits of the bench; StepError when it is beyond them."""
        if planned.waiting is None:
            return planned.step
        owner, _ = self._plan.document.owner(planned.place)
        step = completed(planned, self._journal.state.variables, owner.path.parent)
        from_deg = self._bench.angles_deg.get(step.role, 0.0) if isinstance(step, (Move, Rotate)) else 0.0
        if problems := [problem for _, problem in limit_problems(step, self._bench.file, from_deg)]:
            raise StepError(f"{'; '.join(problems)}. Nothing was sent.")
        return step

    def _in_words(self, planned: PlannedStep, problem: DriverError | BenchError) -> StepFailed:
        if isinstance(problem, StepFailed):  # of a step inside this one
            return problem
        text = f"{self._plan.where(planned.place)}: step {planned.id}: {problem}"
        return StepFailed(text, code_of(problem))

    def _visited(self, planned: PlannedStep) -> PlannedStep:
        """The step under an id of its own, also when it was begun before."""
        self._visits[planned.id] += 1
        visit = self._visits[planned.id]
        if visit == 1:
            return planned
        again = replace(planned, id=f"{planned.id}~{visit}")
        self._indices[again.id] = self._indices[planned.id]
        return again


def code_of(problem: DriverError | BenchError) -> str:
    """The kind of an error, by which a sequence may say what is tried again."""
    return problem.code


def _first(problems: BaseExceptionGroup[BaseException]) -> BaseException:
    """The first of several errors that came at once."""
    problem = problems.exceptions[0]
    return _first(problem) if isinstance(problem, BaseExceptionGroup) else problem
