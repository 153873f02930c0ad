"""Manual control of a run: orders are checked as steps are, journalled with their sender, and executed as steps."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

from bench.engine.context import Bench
from bench.engine.control import Control
from bench.engine.orders import CLOSED, Given
from bench.engine.stepper import Stopped
from bench.errors import BenchError, InputError, StepError, StoreError
from bench.quality import Fresh
from bench.sequence.checks.orders import Order, beyond_limits, devices_of, order_of
from bench.sequence.plan.plan import PlannedStep
from bench.sequence.steps.measuring import Measure
from bench.sequence.steps.stimulus import Move, Oscillate, Rotate, SetOutput
from drivers.errors import DriverError
from drivers.timing.awake import fair_timeout

Perform = Callable[[PlannedStep], Awaitable[object]]


class Manual:
    """Manual control of one run, while a step of it waits for orders.

    An order that fails leaves its devices safe and the session goes on; a device that cannot be made safe ends it.
    """

    def __init__(self, bench: Bench, control: Control, perform: Perform) -> None:
        self._bench, self._control, self._perform = bench, control, perform
        self._under_way: dict[str, Given] = {}
        self._tasks: dict[str, asyncio.Task[Any] | None] = {}
        self._halted: set[str] = set()
        self._number = 0
        bench.orders.obey = self._obey

    def order(self, text: str, by: str) -> str:
        """Begin an order, which is one step of a sequence; return its id. Raises InputError if it is refused."""
        try:
            given = self._accepted(text, by)
        except InputError as problem:
            self._bench.journal.try_to_write("order_refused", by=by, order=text, text=str(problem))
            raise
        self._bench.journal.write("order", given.planned.id, by=by, order=text)
        self._bench.orders.give(given)
        return given.planned.id

    def halt(self, device: str) -> str:
        """Interrupt the orders under way to a device, and stop what they have started; return their ids.

        Raises InputError if there is none.
        """
        ids = [id_ for id_, given in self._under_way.items() if device in given.devices]
        if not ids:
            raise InputError(f"no order to '{device}' is under way")
        self._interrupt(ids)
        return ", ".join(ids)

    def finish(self) -> None:
        """End the session: orders under way are interrupted, then everything is made safe. Raises InputError."""
        self._bench.orders.give(None)
        self._interrupt(list(self._under_way))

    def heard(self) -> None:
        """Note a sign of life of the person who controls. Raises InputError if no step waits for orders."""
        self._bench.orders.heard()

    def to_json(self) -> dict[str, Any] | None:
        """Return the state of the session as plain JSON types; None if no step waits for orders."""
        orders = self._bench.orders
        if not orders.is_open:
            return None
        busy = {id_: list(given.devices) for id_, given in self._under_way.items()}
        return {"silence_s": orders.silence_s, "left_s": orders.left_s, "busy": busy}

    def _accepted(self, text: str, by: str) -> Given:
        if not self._bench.orders.is_open:
            raise InputError(CLOSED)
        step = order_of(text, self._bench.file)
        if self._control.reasons and not _switches_off(step) and not isinstance(step, Measure):
            held_by = ", ".join(self._control.reasons)
            raise InputError(f"the run is held by {held_by}; until then only switching off is possible")
        if problems := beyond_limits(step, self._bench.file, self._from_deg(step)):
            raise InputError(*(f"{problem}. Nothing was sent." for problem in problems))
        devices = devices_of(step, self._bench.file)
        for id_, given in self._under_way.items():
            if both := set(devices) & set(given.devices):
                raise InputError(f"{min(both)} still executes {id_}; halt it, or wait for its end")
        self._number += 1
        planned = PlannedStep(f"steps/order={self._number}", "steps", step, {}, ("steps", 0))
        given = Given(planned, devices, by)
        self._under_way[planned.id] = given
        return given

    def _from_deg(self, step: Order) -> float:
        """Return the angle at which a motion begins: as read, else the target of the last move. Raises InputError."""
        if not isinstance(step, (Move, Rotate, Oscillate)):
            return 0.0
        if step.role in self._bench.angles_deg:
            return self._bench.angles_deg[step.role]
        latest = self._bench.monitor.latest(f"{step.role}.angle")
        if isinstance(latest, Fresh):
            return latest.reading.value
        if isinstance(step, Move) and step.by_deg is None and step.way == "as_written":
            return 0.0
        if not isinstance(step, Move) and getattr(self._bench.file.devices[step.role].limits, "angle", None) is None:
            return 0.0
        raise InputError(f"the angle of '{step.role}' is not known yet; wait for its reading, or move it to an angle")

    def _interrupt(self, orders: list[str]) -> None:
        for id_ in orders:
            self._halted.add(id_)
            if (task := self._tasks.get(id_)) is not None:
                task.cancel()

    async def _obey(self, given: Given) -> None:
        """Execute an order; what fails is in the journal, and its devices are made safe."""
        self._tasks[given.planned.id] = asyncio.current_task()
        try:
            if given.planned.id not in self._halted:
                await self._perform(given.planned)
        except (StoreError, Stopped):
            raise
        except (DriverError, BenchError) as problem:
            self._bench.notice(str(problem))
            for device in given.devices:
                await self._make_safe(device, given.planned.id)
        finally:
            self._under_way.pop(given.planned.id, None)
            self._tasks.pop(given.planned.id, None)

    async def _make_safe(self, device: str, order: str) -> None:
        """Make a device safe after its order has failed. Raises StepError, which ends the session."""
        bench = self._bench
        if (window := bench.monitor.windows.get(device)) is not None:
            window.on_since_s = None
        try:
            with bench.monitor.making_safe(device):
                async with fair_timeout(bench.rig.safe_within_s):
                    await bench.rig.devices[device].make_safe()
        except (DriverError, TimeoutError) as problem:
            raise StepError(f"{device} could not be made safe after {order} had failed: {problem}") from problem
        bench.journal.write("order_made_safe", order, device=device)


def _switches_off(step: Order) -> bool:
    return isinstance(step, SetOutput) and step.output == "off"
