"""Run a plan: setup, steps, teardown; the bench is made safe in any case."""

from __future__ import annotations

import asyncio
from collections.abc import Collection
from typing import Any, Literal, Protocol

from bench.config.models import BenchFile
from bench.engine.context import Bench, Numbered
from bench.engine.control import OPERATOR, Control
from bench.engine.ending import OPERATOR as BY_OPERATOR
from bench.engine.ending import EndRequest, Outcome
from bench.engine.interlocks import Change
from bench.engine.journal import Journal
from bench.engine.manual import Manual
from bench.engine.monitor import Monitor
from bench.engine.past import Past
from bench.engine.questions import PromptQueue, Question
from bench.engine.safety import finish
from bench.engine.stepper import Stopped, UnitFailed, Watcher
from bench.engine.units import UnitFailure
from bench.engine.walk import Walk
from bench.errors import InputError, StepError, WindowError, error_message
from bench.rig import Rig
from bench.sequence.plan.plan import Plan
from bench.sequence.steps.stimulus import Ramp
from drivers.errors import DriverError, InstrumentFault
from drivers.timing.awake import fair_timeout

END_BEYOND_S = 5.0  # time for a step to end, in addition to the time that stopping its motion may take
LOOK_S = 1.0  # polling interval meanwhile
END_RECORD_S = 10.0  # for the last readings after the devices were made safe


class Observer(Watcher, Protocol):
    """Display of a run; called in the loop, so it must return quickly."""

    def asked(self, question: Question) -> None:
        """A question to a person has been opened."""


class Engine:
    """Runs one plan on one rig.

    Lifetime: one `run`. Concurrency: the methods that control it may be called from signal handlers and other callbacks
    of the same loop while it runs. Whatever happens once setup began, teardown runs (unless aborted), and the devices
    are made safe at the end. A step that does not end when cancelled is abandoned after `_end_within_s`; no other
    step begins after it. With a `past` it goes on where that ended. Chambers that `may_be_held` keep their set point
    after a failure that is not theirs and not one of a reading.
    """

    def __init__(
        self,
        plan: Plan,
        file: BenchFile,
        rig: Rig,
        monitor: Monitor,
        journal: Journal,
        observer: Observer,
        past: Past | None = None,
        may_be_held: Collection[str] = (),
    ) -> None:
        self._plan, self._rig, self._monitor, self._observer = plan, rig, monitor, observer
        self.journal = journal
        self.prompts = PromptQueue(observer.asked)
        self._control = Control(self.journal, observer.notice, observer.held)
        numbered = Numbered(file.devices)
        credit = past.credit if past is not None else None
        bench = Bench(file, rig, monitor, journal, self.prompts, observer.notice, numbered, credit=credit)
        monitor.units.angles_deg = bench.angles_deg
        self._places = file.places
        if past is not None:
            monitor.units.take_over(past.dropped, past.state.mount)
        self._walk = Walk(plan, bench, self._control, observer, self._failed, past or Past())
        self.manual = Manual(bench, self._control, self._walk.ordered)
        bench.orders.on_silence = lambda text: self.stop(EndRequest("silence", text))
        self._body_task: asyncio.Task[None] | None = None
        self._teardown_task: asyncio.Task[None] | None = None
        self._ending, self._aborted = asyncio.Event(), asyncio.Event()
        self._request: EndRequest | None = None
        monitor.on_interlock = self._interlock
        monitor.on_unit_failure = self._unit_failed
        monitor.on_left_out = self._left_out
        self._switching_off: set[asyncio.Task[None]] = set()
        self._interlocks = {**file.interlocks, **plan.sequence.interlocks}
        self._giving_up: dict[str, asyncio.TimerHandle] = {}
        self._may_be_held = frozenset(may_be_held)
        self._tripped: set[str] = set()  # interlocks on a temperature
        self._is_hold_ruled_out = False
        self.outcome = Outcome()

    @property
    def in_teardown(self) -> bool:
        """True once the teardown has begun."""
        return self._teardown_task is not None

    @property
    def may_hold(self) -> bool:
        """True if chambers may be held should this process be lost now: steps are running and no problem is known."""
        under_way = self._body_task is not None and not self._body_task.done() and not self._body_task.cancelling()
        return under_way and not self._tripped and not self._monitor.fault.done()

    def pause(self) -> None:
        """Hold before the next step; devices keep their state and are still monitored. Not in teardown."""
        self._control.hold(OPERATOR)

    def resume(self) -> None:
        """Continue after a pause; raise InputError if an interlock also holds the run."""
        self._control.release(OPERATOR)
        if self._control.held:
            raise InputError(f"the run is still held by {self._control.held_by}")

    def hold(self, by: str, wanted: bool = True) -> None:
        """Hold the run for a reason other than the operator's, or release that hold."""
        if wanted:
            self._control.hold(by)
        else:
            self._control.release(by)

    @property
    def holds(self) -> list[str]:
        """Return why no further step begins, also while one is still completed."""
        return self._control.reasons

    def skip(self) -> str:
        """Cancel the current step and go on with the next; return its id. InputError if there is none."""
        return self._cut("skip")

    def repeat(self) -> str:
        """Restart the current step, or the one before a pause; InputError if there is none."""
        if self._control.under_way:
            return self._cut("repeat")
        if not self._control.held:
            raise InputError("no step is running; pause the run to repeat the previous step")
        self._control.repeat_last()
        return "the last one"

    def _cut(self, wish: Literal["skip", "repeat"]) -> str:
        if self.in_teardown:
            raise InputError("the teardown is running; its steps cannot be skipped or repeated")
        cut = self._control.cut(wish)
        if not cut:
            raise InputError("no step is running, or it is already ending")
        for step in cut:
            self.journal.try_to_write("operator", step, action=wish)
        return ", ".join(cut)

    def stop_after_step(self, request: EndRequest = BY_OPERATOR) -> None:
        """End setup and steps after the current step; teardown runs."""
        self._requested(request, "stop after step")
        self._control.last_step = True
        self._control.release_all()

    def stop(self, request: EndRequest = BY_OPERATOR) -> None:
        """Cancel the current step; teardown runs."""
        if self._body_task is not None and not self._body_task.done() and not self._body_task.cancelling():
            self._requested(request, "stop")
            self._control.last_step = True  # for a step that ends normally although it was cancelled
            self._body_task.cancel(request.text)
            self._ending.set()

    def abort(self, request: EndRequest = BY_OPERATOR) -> None:
        """Cancel the current step and skip the teardown; the devices are made safe."""
        self._requested(request, "abort")
        self._abort(request.text)
        if self._body_task is not None:
            self._body_task.cancel(request.text)

    def _abort(self, why: str) -> None:
        """Let no further step begin, and end a running teardown."""
        self._walk.abort()
        if self._teardown_task is not None:
            self._teardown_task.cancel(why)
        self._ending.set()
        self._aborted.set()

    def _requested(self, request: EndRequest, action: str) -> None:
        if self._request is None:
            self._request = request
        self.journal.try_to_write("end_requested", action=action, by=request.by, text=request.text)

    async def run(self) -> Outcome:
        """Run the plan; failures and requests are in the outcome, not raised."""
        self._monitor.start()
        try:
            steps = self._walk.nodes((*self._plan.setup, *self._plan.steps))
            self._body_task = asyncio.create_task(steps, name="setup and steps")
            await self._watched(self._body_task)
            if not self._control.aborting:
                await self._tear_down()
        finally:
            for timer in self._giving_up.values():
                timer.cancel()
            for left in (*self._switching_off, self._body_task, self._teardown_task):
                if left is not None:
                    left.cancel()  # every device is made safe now
            try:
                await finish(self._make_safe(), self._rig.safe_within_s + END_RECORD_S)
            except TimeoutError:
                self._failed(StepError("the record could not be completed after the devices were made safe"))
        return self.outcome

    async def _tear_down(self) -> None:
        """Run the whole teardown; problems that the monitor finds meanwhile are reported after it."""
        reported = self._monitor.fault.done()
        teardown = self._walk.teardown(self._plan.teardown)
        self._teardown_task = asyncio.create_task(teardown, name="teardown")
        await _first_of(self._teardown_task, self._aborted)
        await self._wait_for_end(self._teardown_task)
        self._settle(self._teardown_task)
        if self._monitor.fault.done() and not reported:
            self._failed(self._monitor.fault.result())

    def _interlock(self, change: Change) -> None:
        """Apply an interlock that has tripped or recovered to the run."""
        by = f"interlock {change.name}"
        self._observer.notice(change.text)
        if self._monitor.unit_of(self._interlocks[change.name].names[0]) == "°C":
            (self._tripped.add if change.tripped else self._tripped.discard)(change.name)
        if not change.tripped:
            self._let_go(change.name)
        elif change.action in ("hold", "pause"):
            self._control.hold(by)
            self._give_up_on(change)
            if change.action == "hold":
                self._control.cut("hold", Ramp)
        else:
            if change.action == "abort":
                self._abort(by)
            self._monitor.report(WindowError(change.text))

    def _let_go(self, interlock: str) -> None:
        """Release the hold of an interlock that no longer applies."""
        self._control.release(f"interlock {interlock}")
        if (timer := self._giving_up.pop(interlock, None)) is not None:
            timer.cancel()

    def _left_out(self, role: str, problem: DriverError) -> None:
        """Record the failure of a device that the run does not use; the run goes on."""
        text = f"{problem}\nThe run goes on, because it does not use {role}; {role} is made safe with the others."
        self.journal.try_to_write("device_left_out", device=role, text=text)
        self._observer.notice(text)

    def _unit_failed(self, failure: UnitFailure, disregarded: list[str]) -> None:
        """Drop one of several units: report it and make its outputs safe. The run goes on with the others, if any."""
        place, left = failure.place, self._monitor.units.left
        goes_on = f"The run goes on with {', '.join(left)}." if left else "No unit is left."
        text = f"The unit in place {place} is dropped: {failure.text} {goes_on}"
        if disregarded:
            text += f" Interlocks on its thermometer are disabled: {', '.join(disregarded)}."
        self.journal.try_to_write("unit_dropped", place=place, fault=failure.kind, bad=failure.unit_is_bad, text=text)
        self._observer.notice(f"\a{text}")
        for interlock in disregarded:
            self._let_go(interlock)
        switching_off = asyncio.create_task(self._switch_off(place), name=f"switch off {place}")
        self._switching_off.add(switching_off)
        switching_off.add_done_callback(self._switching_off.discard)
        if not left:
            self._monitor.report(WindowError(text))

    async def _switch_off(self, place: str) -> None:
        """Make safe what feeds only this unit; the run ends if an output cannot be proved to be off."""
        unit = self._places[place]
        for role in filter(None, (unit.supply, unit.source)):
            if self._monitor.units.is_needed(role):
                self._observer.notice(f"{role} stays on: it also feeds units other than that in place {place}.")
                continue
            try:
                await self._make_one_safe(place, role)
            except (DriverError, TimeoutError) as problem:
                text = f"{role} cannot be switched off after the unit in place {place} was dropped: {problem}"
                self._monitor.report(WindowError(text))

    async def _make_one_safe(self, place: str, role: str) -> None:
        """Switch a supply or source off and read it back; raises if that fails."""
        source = self._rig.source(role)
        with self._monitor.making_safe(role):
            async with fair_timeout(self._rig.safe_within_s):
                await source.make_safe()
                found = await source.read()
        self.journal.try_to_write("unit_off", place=place, device=role, output=found.output, current_a=found.current_a)
        if found.output:
            raise InstrumentFault(role, "its output is still on after it was made safe")

    def _give_up_on(self, change: Change) -> None:
        """Stop the run if an interlock that holds it does not recover in time."""
        most_s = self._interlocks[change.name].give_up_after_s
        text = f"{change.text} It has not recovered within {most_s / 60:g} min; the run is stopped."
        loop = asyncio.get_running_loop()
        self._giving_up[change.name] = loop.call_later(most_s, self._monitor.report, WindowError(text))

    async def _watched(self, task: asyncio.Task[None]) -> None:
        """Wait for the task; a problem found by the monitor ends it."""
        ending = asyncio.create_task(self._ending.wait(), name="ending")
        try:
            first: list[asyncio.Future[Any]] = [task, self._monitor.fault, ending]
            await asyncio.wait(first, return_when=asyncio.FIRST_COMPLETED)
        finally:
            ending.cancel()
            if not task.done():
                self._control.last_step = True
                if not task.cancelling():
                    task.cancel()
                await self._wait_for_end(task)
        fault = self._monitor.fault.done()
        if fault:
            self._failed(self._monitor.fault.result())
        if not (fault and task.done() and (task.cancelled() or isinstance(task.exception(), Stopped))):
            self._settle(task)

    async def _wait_for_end(self, task: asyncio.Task[None]) -> None:
        """Wait until a task that is to end has ended, or `_end_within_s` has passed.

        The teardowns of groups in it take as long as they take, unless the run is aborted.
        """
        loop = asyncio.get_running_loop()
        patient_until_s = loop.time() + self._end_within_s
        while not task.done() and loop.time() < patient_until_s:
            await asyncio.wait([task], timeout=LOOK_S)
            if self._walk.in_a_teardown and not self._control.aborting:
                patient_until_s = loop.time() + self._end_within_s

    def _settle(self, task: asyncio.Task[None]) -> None:
        """Record in the outcome how a task ended, or that it did not."""
        if not task.done():
            self._left_behind(task)
            return
        problem = None if task.cancelled() else task.exception()
        if task.cancelled() or isinstance(problem, Stopped):
            self.outcome.ended(self._request or BY_OPERATOR)
        elif isinstance(problem, UnitFailed):
            self.outcome.how = "failed"
            self.outcome.problems.append(str(problem))
            self._observer.notice(f"{problem} The sequence stops here, as it specifies; the teardown runs.")
            self.journal.try_to_write("problem", text=str(problem))
        elif problem is not None:
            self._failed(problem)

    def _left_behind(self, task: asyncio.Task[None]) -> None:
        under_way = ", ".join(self.journal.state.under_way) or task.get_name()
        problem = StepError(
            f"{under_way} has not ended within {self._end_within_s:g} s after it was cancelled, and is "
            "abandoned. Check the code of that step, or of its driver."
        )
        if self._request is None:
            self._failed(problem)
            return
        self.outcome.ended(self._request)
        self.outcome.problems.append(str(problem))
        self._observer.notice(str(problem))
        self.journal.try_to_write("problem", text=str(problem))

    def _failed(self, problem: BaseException) -> None:
        self.outcome.how = "error"
        of_chamber = isinstance(problem, DriverError) and problem.device in self._may_be_held
        self._is_hold_ruled_out |= of_chamber or isinstance(problem, WindowError)
        text = error_message(problem)
        if text in self.outcome.problems:  # a store that fails, fails the teardown as well
            return
        self.outcome.problems.append(text)
        self._observer.notice(text)
        self.journal.try_to_write("problem", text=str(problem))

    def _to_hold(self) -> frozenset[str]:
        """Chambers that keep their set point: after a failure not theirs and not of a reading; not on request."""
        failed = self.outcome.how == "error" and self._request is None
        return self._may_be_held if failed and not (self._is_hold_ruled_out or self._tripped) else frozenset()

    @property
    def _end_within_s(self) -> float:
        return self._rig.safe_within_s + END_BEYOND_S

    async def _make_safe(self) -> None:
        """Make every device safe while readings are still recorded, then end the record."""
        self._monitor.being_made_safe.update(self._rig.devices)
        unsafe = self.outcome.unsafe = await self._rig.make_safe(self._to_hold())
        self.outcome.held = sorted(self._rig.held)
        held: dict[str, Any] = {"held": self.outcome.held} if self.outcome.held else {}
        self.journal.try_to_write("made_safe", unsafe=unsafe, **held)
        for device in self.outcome.held:
            self._observer.notice(f"{device} stays at its set point for now; the guardian of the run ends that.")
        for device, problem in unsafe.items():
            if device in self._monitor.used:
                self.outcome.how = "error"
            self._observer.notice(f"{device} COULD NOT BE MADE SAFE: {problem}")
        await self._monitor.stop()


async def _first_of(task: asyncio.Task[None], event: asyncio.Event) -> None:
    """Wait until the task is done or the event is set."""
    waiting = asyncio.create_task(event.wait())
    try:
        await asyncio.wait([task, waiting], return_when=asyncio.FIRST_COMPLETED)
    finally:
        waiting.cancel()
