"""A Fluke 5700A as a current source: locked range, every setting read back and settled, standby only at 0 A."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping, Sequence
from typing import Self

from drivers.description import Nothing, Setup
from drivers.dialects.fluke_5700a import wire
from drivers.dialects.fluke_5700a.description import FlukeOptions
from drivers.dialects.fluke_5700a.link import FlukeLink
from drivers.dialects.fluke_5700a.wire import OFF, Event, Setting, State, Status
from drivers.errors import BeyondLimit, InstrumentFault, NoAnswer, NotSettled, Refused
from drivers.kinds.latest import Latest, Order
from drivers.kinds.ranges import SourceLimits
from drivers.timing.awake import Deadline, now_s
from drivers.timing.readback import read_back
from drivers.transport.dialogue import safe_in_time
from drivers.values import Identity, Reading, SourceReading

SETTLE_LOOK_S = 1.0  # interval of polls until a setting has settled, and delay of the first one
MINUTE_S = 60.0
_DISTORTING = {
    Status.BOOST: "an amplifier is on",
    Status.OFFSET: "an offset is added to its output",
    Status.SCALE: "a scale error is applied to its output",
}


class Fluke5700A:
    """One calibrator; a Source of amperes.

    Every command is sent once and read back. Every poll compares the settings with the last ones sent: a second master,
    or local control, is a fault and is not overridden.

    Concurrency: a new `set` and `make_safe` supersede the running `set`, which then raises Refused.
    """

    def __init__(self, setup: Setup[FlukeOptions, SourceLimits, Nothing]) -> None:
        self.name, self._note = setup.name, setup.note
        self._options, self._limits = setup.options, setup.limits
        self._link = FlukeLink(setup, end=wire.TERMINATORS[setup.options.terminator])
        self._band_a = wire.band_a(setup.options.range)
        self._latest: Latest[Setting] = Latest(setup.name, "setting")  # setting that was read back
        self._range_chosen = False  # range set and locked by this driver
        self._first_min: int | None = None  # answer to ETIME? when the power was first known to be on

    async def __aenter__(self) -> Self:
        """Connect and identify; raises CannotConnect, WrongIdentity, or BadAnswer from a terminal mode."""
        await self._link.open()
        return self

    async def __aexit__(self, *exc: object) -> None:
        """Close the wire; the output stays as it is, and the calibrator in remote."""
        self._link.close()

    async def identify(self) -> Identity:
        """Query the identity by *IDN?; raises WrongIdentity."""
        return await self._link.identify()

    async def poll(self) -> Mapping[str, Sequence[Reading]]:
        """Output current, settled (1 or 0), and the minimum time since power-on.

        Raises InstrumentFault if there is a fault, or if settings have changed.
        """
        state = await self._confirmed_state()
        if self._latest.result is not None:
            await self._check_still(state, self._latest.result)
        on_time_s = await self._on_time_s(state)
        at_s = now_s()
        values = {"current": state.flowing_a, "settled": float(state.settled), "on_time": on_time_s}
        return {channel: [Reading(at_s, value)] for channel, value in values.items()}

    async def read(self) -> SourceReading:
        """Level while the output operates, else 0; a calibrator measures neither current nor voltage."""
        state = await self._confirmed_state()
        return SourceReading(None, state.flowing_a, Status.OPERATING in state.status)

    async def set(self, level: float, *, limit: float, output: bool) -> None:
        """Lock the range, set the level (A), operate, and return when the output has settled.

        `limit` is the compliance (V), which cannot be set on a calibrator: it must be that of the bench file. With
        `output` False only goes to 0 A and to standby. Raises BeyondLimit before anything is sent, Refused when a
        setting is not carried out, InstrumentFault for a trip, an offset or a takeover, NotSettled.
        """
        if output:
            self._check_limits(level, limit)
        had_made = self._latest.result
        order = self._latest.begin()
        if not output:
            await self._reach(order, OFF)
            order.check()
            self._latest.done(order, OFF)
            return
        now = await self._state()
        self._check_ours(now, had_made)
        if not (self._range_chosen and Status.REMOTE | Status.RANGE_LOCKED in now.status):
            self._range_chosen = False
            for setting in wire.choosing_range(self._options.range):
                await self._reach(order, setting)
            self._range_chosen = True
        wanted = Setting(level, True, True)
        await self._reach(order, wanted)
        await self._settle(order, wanted)
        order.check()
        self._latest.done(order, wanted)

    async def make_safe(self) -> None:
        """Take control, go to 0 A, then to standby, within 5 s, proved by reading back.

        Raises NoAnswer, BadAnswer or Refused when it cannot be proved; CannotConnect, WrongIdentity after a lost wire.
        """
        order = self._latest.begin()
        async with safe_in_time(self.name):
            if await self._link.reopen():
                self._range_chosen = False
            self._link.preempt(wire.REMOTE, wire.ZERO, wire.STANDBY)
            await self._reach(order, OFF)
            self._latest.done(order, OFF)

    async def _reach(self, order: Order, wanted: Setting) -> None:
        """Send one command after the other until the calibrator reports the wanted settings.

        Each is sent once and given some time; a fault in the queue stops the change to any state but OFF.
        """
        sent, faults, now = "", list[str](), await self._state()
        while step := wire.next_step(now, wanted, self._band_a):
            order.check()
            if step == sent:
                raise Refused(
                    self.name, "a setting was not executed", sent=sent, received="; ".join([str(now), *faults]),
                    remedy="Look at the display of the calibrator: a message, a menu left open, or local control.",
                )  # fmt: skip
            sent, faults = step, await self._link.write(step)
            if faults and wanted != OFF:
                raise Refused(
                    self.name, "the calibrator refused a command", sent=sent, received="; ".join(faults),
                    remedy="Look at its display, and check the levels and limits in the sequence and the bench file.",
                )  # fmt: skip
            now = await self._state_after(order, step, wanted)

    async def _state_after(self, order: Order, step: str, wanted: Setting) -> State:
        """The state once it shows that a step was executed, or at the time limit.

        At once if there is nothing to wait for.
        """
        return await read_back(
            self._state, lambda state: order.ended or wire.next_step(state, wanted, self._band_a) != step
        )

    async def _settle(self, order: Order, wanted: Setting) -> None:
        """Return when the output is within its specification, with no fault in the queue."""
        deadline = Deadline(self._options.settle_within)
        while True:
            await asyncio.sleep(SETTLE_LOOK_S)
            state = await self._state()
            order.check()
            await self._check_still(state, wanted)
            if state.settled:
                break
            if deadline.passed:
                raise NotSettled(
                    self.name, f"the output has not settled within {self._options.settle_within:g} s",
                    received=str(state), remedy="Check the load and its cable, and settle_within in the bench file.",
                )  # fmt: skip
        if faults := await self._link.faults():
            raise self._fault("the calibrator has a fault after a setting", faults)

    async def _state(self) -> State:
        status = await self._link.query(wire.STATUS_QUERY, wire.read_status)
        return State(status, await self._link.query(wire.OUTPUT_QUERY, wire.read_output))

    async def _confirmed_state(self) -> State:
        return await self._link.double_read.confirmed("what the calibrator does", self._state)

    async def _minutes(self) -> int:
        return await self._link.query(wire.MINUTES_QUERY, wire.read_integer)

    async def _events(self, state: State) -> Event:
        """Events since the last query, which are reported only once.

        If the answer is missing, all possible events: errors, and a power failure unless the calibrator still has the
        settings of this driver.
        """
        try:
            return await self._link.query_once(wire.EVENTS_QUERY, wire.read_events)
        except NoAnswer as problem:
            still_set = self._range_chosen and Status.REMOTE | Status.RANGE_LOCKED in state.status
            self._note(f"looked for its faults{'' if still_set else ', and counts its time anew'}: {problem}")
            return wire.ERRORS if still_set else wire.ERRORS | Event.POWER_ON

    async def _on_time_s(self, state: State) -> float:
        """Minimum time for which the power has been on: since the first query, or since it was last switched on.

        ETIME? counts the minutes of the calibrator's whole life, so the difference of two answers, less one minute for
        rounding, is a time. A power failure event restarts it.
        """
        events = await self._events(state)
        minutes = await self._link.double_read.confirmed("its time in minutes", self._minutes, agree=_within_a_minute)
        if self._first_min is None or Event.POWER_ON in events:
            self._first_min = minutes
        if events & wire.ERRORS and (faults := await self._link.faults()):
            raise self._fault("the calibrator has a fault", faults)
        return MINUTE_S * max(0, minutes - self._first_min - 1)

    def _check_limits(self, level_a: float, compliance_v: float) -> None:
        allowed, range_a, fixed_v = self._limits.current, self._options.range, self._options.compliance
        low, high = max(allowed.min, -range_a), min(allowed.max, range_a)
        problem = ""
        if not low <= level_a <= high:
            problem = f"the level {level_a:g} A is outside {low:g} A to {high:g} A"
        elif not math.isclose(compliance_v, fixed_v):
            problem = f"the compliance is {fixed_v:g} V and cannot be set to {compliance_v:g} V"
        if problem:
            raise BeyondLimit(
                self.name, problem,
                remedy="Nothing was sent. Correct the sequence, or range, compliance and limits in the bench file.",
            )  # fmt: skip

    def _check_ours(self, now: State, made: Setting | None) -> None:
        """Raise if another master took control, or changed the meaning of a level."""
        found = [words for bit, words in _DISTORTING.items() if bit in now.status]
        if made is not None and Status.REMOTE not in now.status:
            found.append("it was switched to local control, or switched off")
        if found:
            raise InstrumentFault(
                self.name, ", ".join(found), received=str(now),
                remedy="Look at its front panel: clear offset, scale and boost, then run again.",
            )  # fmt: skip

    async def _check_still(self, state: State, made: Setting) -> None:
        """Raise, with the faults in the queue, if settings have changed."""
        if made.output:
            self._check_ours(state, made)
        if wire.next_step(state, made, self._band_a):
            faults = await self._link.faults()
            raise InstrumentFault(
                self.name, f"the calibrator was set to {made}", received="; ".join([str(state), *faults]),
                remedy="Look for an open or too large load, which trips it, a power failure, or another master.",
            )  # fmt: skip

    def _fault(self, problem: str, faults: Sequence[str]) -> InstrumentFault:
        return InstrumentFault(
            self.name, problem, received="; ".join(faults), remedy="Look at its display, and at the load."
        )


def _within_a_minute(one_min: int, other_min: int) -> bool:
    return abs(one_min - other_min) <= 1
