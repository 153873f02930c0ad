"""Traverse the nodes of a plan: loops, alternatives, branches, attempts, and the reaction to failed steps."""

from __future__ import annotations

import asyncio
import functools
from collections import Counter
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from typing import Any, assert_never

from bench.engine.context import Bench
from bench.engine.control import Control
from bench.engine.past import Past, decision, done_of, steps_to_restore
from bench.engine.people import answered
from bench.engine.questions import Question
from bench.engine.safety import grouped, wait_uncancelled
from bench.engine.stepper import Stepper, Stopped, Watcher
from bench.errors import BenchError, StepError, StoreError
from bench.sequence.plan.plan import (
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
)
from bench.sequence.plan.waiting import completed, is_true
from bench.sequence.steps.fields import OnFailure
from bench.sequence.steps.measuring import Acquire
from bench.sequence.steps.stimulus import Move
from bench.sequence.steps.talk import A_DAY_S
from drivers.errors import DriverError

AFTER_A_FAILURE = ("stop", "continue", "repeat")
Doing = Coroutine[Any, Any, bool | None]


class Walk:
    """Executes the steps of a plan.

    A failure is raised as StepError unless the sequence continues after it; a step repeated by a retry or by the
    operator has the suffix `~2`, `~3`, … in its id.
    """

    def __init__(
        self,
        plan: Plan,
        bench: Bench,
        control: Control,
        watcher: Watcher,
        failed: Callable[[BaseException], None],
        past: Past,
    ) -> None:
        self._plan, self._bench, self._journal = plan, bench, bench.journal
        self._past = past
        self._restoring = asyncio.Lock()
        self._left_to_restore = steps_to_restore(done_of((*plan.setup, *plan.steps), past))
        self._control, self._watcher, self._failed = control, watcher, failed
        self._indices = {planned.id: index for index, planned in enumerate(plan)}
        self._stepper = Stepper(plan, bench, control, watcher, self._indices)
        self._visits = Counter(past.begun)
        self._last: PlannedStep | None = None
        self._teardowns: set[asyncio.Task[None]] = set()  # groups that are running

    def abort(self) -> None:
        """Let no further teardown begin, and end running teardowns of groups."""
        self._control.aborting = True
        for teardown in self._teardowns:
            teardown.cancel("aborted")

    @property
    def in_a_teardown(self) -> bool:
        """True while the teardown of a group runs."""
        return bool(self._teardowns)

    async def ordered(self, planned: PlannedStep) -> None:
        """Execute a step that a person has ordered, as part of the step that waits for orders."""
        at = next(iter(self._journal.state.under_way), "")
        self._indices[planned.id] = self._indices.get(at, 0)
        await self._stepper.step(planned)

    async def nodes(self, nodes: Nodes) -> None:
        """Execute nodes in order."""
        for node in nodes:
            await self._node(node)

    async def teardown(self, nodes: Nodes) -> None:
        """Execute every node, also after one has failed."""
        for node in nodes:
            try:
                await self._node(node)
            except Stopped:
                raise
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
                await self.nodes(node.then if self._decided(node) else node.otherwise)
            case Passes():
                await self._passes(node)
            case Branches():
                await self._branches(node)
            case Attempts():
                await self._attempts(node)
            case _:
                assert_never(node)

    def _decided(self, node: Alternatives | Passes, number: int = 1) -> bool:
        """Value of a condition: as decided before an interruption, otherwise evaluated now."""
        name = decision(node, number)
        if (taken := self._past.decisions.pop(name, None)) is not None:
            return taken
        with self._told_where(node):
            taken = is_true(node.condition, self._journal.state.variables)
        self._journal.write("decided", name, taken=taken)
        return taken

    @contextmanager
    def _told_where(self, node: Alternatives | Passes) -> Iterator[None]:
        try:
            yield
        except StepError as problem:
            raise StepError(f"{self._plan.where(node.place)}: {node.id}: {problem}") from problem

    async def _passes(self, node: Passes) -> None:
        for number in range(1, node.at_most + 1):
            if not self._decided(node, number):
                return
            await self.nodes(self._numbered(node, number))
        with self._told_where(node):
            if is_true(node.condition, self._journal.state.variables):
                raise StepError(
                    f"its condition {node.condition.raw} is still true after {node.at_most} passes. "
                    "Find out why, or increase at_most."
                )

    def _numbered(self, node: Passes, number: int) -> Nodes:
        """Steps of a pass, with its number in their ids."""
        body = node.numbered(number)
        for first, again in zip(leaves(node.body), leaves(body), strict=True):
            self._indices[again.id] = self._indices[first.id]
        return body

    async def _branches(self, node: Branches) -> None:
        stopped = False

        async def branch(nodes: Nodes) -> None:
            nonlocal stopped
            try:
                await self.nodes(nodes)
            except Stopped:  # the steps that run in the other branches are cancelled
                stopped = True

        async def run_all() -> None:
            async with asyncio.TaskGroup() as group:
                for name, nodes in node.branches.items():
                    group.create_task(branch(nodes), name=f"{node.id}/{name}")

        await grouped(run_all())
        if stopped:
            raise Stopped

    async def _attempts(self, node: Attempts) -> None:
        for number in range(1, node.at_most + 1):
            try:
                await self.nodes(node.body)
                return
            except (DriverError, BenchError) as problem:
                if number == node.at_most or problem.code not in node.on:
                    raise
                self._journal.write("retried", node.id, attempt=number, text=str(problem))
                self._watcher.notice(f"Attempt {number} of {node.at_most} failed; next attempt: {problem}")
            await asyncio.sleep(node.delay_s)

    async def _section(self, node: Section) -> None:
        """Execute a group; its teardown runs however its steps ended, unless the run is aborted."""
        if self._past.passes_over(node.id):
            return
        why: Exception | None = None
        try:
            while await self._failing(node.on_failure, node.id, self.nodes(node.body)):
                pass
            if node.restart_at is not None:
                self._journal.write("group_ended", node.id)
        except Exception as problem:
            why = problem
            raise
        finally:
            if not self._control.aborting:
                await self._undisturbed(node.teardown, why)

    async def _undisturbed(self, teardown: Nodes, why: Exception | None) -> None:
        """Complete a teardown, whatever ends the steps around it meanwhile; only an abort interrupts it.

        A cancellation continues after it, and `why`, the failure before it, is kept.
        """
        task = asyncio.create_task(self.teardown(teardown))
        self._teardowns.add(task)
        cancelled = await wait_uncancelled(task)
        self._teardowns.discard(task)
        if cancelled is not None or task.cancelled():
            if why is not None and not isinstance(why, Stopped):
                self._failed(why)
            raise cancelled or asyncio.CancelledError
        task.result()

    async def _leaf(self, planned: PlannedStep, body: Nodes | None = None) -> None:
        """Execute a step, repeatedly if the operator requests it; `on_failure` decides about a failure."""
        if self._past.passes_over(planned.id):
            return
        if isinstance(planned.step, Acquire):
            self._past.forget(planned.id)  # an acquisition with all steps inside it is one unit
        if planned.phase != "teardown":
            await self._restore()
        inside = None if body is None else functools.partial(self.nodes, body)
        await self._may_begin(planned)
        while await self._failing(
            planned.step.on_failure, planned.id, self._stepper.step(self._visited(planned), inside)
        ):
            await self._may_begin(planned)
        if body is None:
            self._last = planned

    async def _restore(self) -> None:
        """Restore the condition before the interruption, before the first step that is not passed over."""
        if not self._left_to_restore and not self._restoring.locked():
            return
        async with self._restoring:
            while self._left_to_restore:
                planned = self._left_to_restore.pop(0)
                await self._may_begin(planned)
                await self._stepper.step(self._visited(self._as_it_was(planned)))

    def _as_it_was(self, planned: PlannedStep) -> PlannedStep:
        """A step with the values and, for a movement, the target that it had before the interruption."""
        owner, _ = self._plan.document.owner(planned.place)
        step = completed(planned, self._past.values[planned.id], owner.path.parent)
        if isinstance(step, Move) and planned.id in self._past.angles_deg:
            to_deg = step.to_deg if step.by_deg is None and step.way == "as_written" else None
            absolute = {"to_deg": self._past.angles_deg[planned.id] if to_deg is None else to_deg, "by_deg": None}
            step = step.model_copy(update={**absolute, "way": "as_written"})
        return planned._replace(step=step, waiting=None)

    async def _may_begin(self, planned: PlannedStep) -> None:
        """Wait while the run is paused, and stop here if that was requested; in a teardown only an abort has effect."""
        if self._control.aborting:
            raise Stopped
        if planned.phase == "teardown":
            return
        while not await self._control.may_begin(planned.id):
            if self._last is not None:
                self._journal.try_to_write("operator", self._last.id, action="repeat")
                await self._stepper.step(self._visited(self._last))
        if self._control.last_step:
            raise Stopped

    async def _failing(self, on_failure: OnFailure | None, step_id: str, doing: Doing) -> bool:
        """Await a step that may fail; return whether to repeat it.

        Raises failures that the sequence does not ignore.
        """
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
                self._watcher.notice(f"{problem}\nThe run goes on without it, as the sequence specifies.")
            return decided == "repeat"

    async def _asked(self, step_id: str, problem: Exception) -> str:
        question = Question(f"{step_id}?", f"{problem} What now?", AFTER_A_FAILURE)
        answer = await answered(self._bench.prompts, self._journal, question, A_DAY_S)
        return str(answer.value)

    def _visited(self, planned: PlannedStep) -> PlannedStep:
        """The step with a unique id, also if it was begun before."""
        self._visits[planned.id] += 1
        visit = self._visits[planned.id]
        if visit == 1:
            return planned
        again = planned._replace(id=f"{planned.id}~{visit}")
        self._indices[again.id] = self._indices[planned.id]
        return again
