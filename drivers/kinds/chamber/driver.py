"""A thermal chamber of any make: the dialect communicates; the driver checks, commands, reads back and monitors."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping, Sequence
from typing import Self

from drivers.errors import BeyondLimit, DriverError, InstrumentFault, LinkLost, NoAnswer, NotSettled
from drivers.kinds.chamber.controller import Control, Controller, ControllerState
from drivers.kinds.chamber.description import ChamberLimits, ChamberOptions, ChamberSafe, SteppedRampOptions, safe_state
from drivers.kinds.chamber.following import FollowWatch
from drivers.kinds.chamber.ramp import ARRIVED_WITHIN_C, RampProfile
from drivers.timing.awake import Deadline, fair_timeout
from drivers.values import ChamberState, Identity, Reading

RAMP_LONGER_BY, RAMP_LATER_S = 1.1, 120.0  # allowance for a ramp beyond distance / rate
STANDSTILL_S = 600.0
SET_POINT_STANDS_S = 60.0  # a set point unchanged for so long is at rest


class Chamber:
    """A ThermalChamber on the controller of one dialect.

    Every poll compares the set point with the last command: another master is a fault and is not overridden.

    Concurrency: commands and polls alternate, so no poll falls between a write and its read-back.
    """

    def __init__(
        self, name: str, controller: Controller, limits: ChamberLimits, safe: ChamberSafe, options: ChamberOptions
    ) -> None:
        self.name = name
        self._controller, self._limits, self._safe_c = controller, limits, safe.temperature
        self._poll_s, self._safe_within_s = options.poll, safe_state(options, limits, safe).within_s
        self._step_s = options.step if isinstance(options, SteppedRampOptions) else None
        self._turn = asyncio.Lock()
        self._commanded_c: float | None = None  # last set point that was written and read back, if known
        self._commands = 0  # number of commands; a ramp detects by it that another one has taken over
        self._standstill = StandstillWatch()
        self._following = FollowWatch(options.follow, limits.temperature)

    async def __aenter__(self) -> Self:
        """Connect and identify; BeyondLimit if the safe temperature could not be commanded."""
        async with self._turn:
            await self._controller.connect()
            try:
                self._check_temperature(self._safe_c)
            except BeyondLimit:
                self._controller.close()
                raise
        return self

    async def __aexit__(self, *exc: object) -> None:
        """Close the connection; the chamber keeps its set point."""
        self._controller.close()

    async def identify(self) -> Identity:
        """Query the identity; raises WrongIdentity."""
        async with self._turn:
            return await self._controller.identify()

    async def ramp_to(self, temperature_c: float, rate_c_per_min: float) -> None:
        """Ramp the active set point to `temperature_c` and return when it has arrived.

        After a cancellation a controller with its own ramp continues it, and any other keeps its set point; `hold`
        stops it. Raises BeyondLimit before anything is sent; Refused if the controller rejects a setting; NotSettled
        after the computed time plus a tenth and two minutes, or if another command replaces this one; and the errors of
        `state`.
        """
        self._check_temperature(temperature_c)
        self._check_rate(rate_c_per_min)
        loop = asyncio.get_running_loop()
        async with self._turn:
            ramp = await self._begin(temperature_c, rate_c_per_min)
            mine = self._commands
        deadline = Deadline(ramp.duration_s * RAMP_LONGER_BY + RAMP_LATER_S)
        end_c = self._controller.as_stored(temperature_c)
        while True:
            async with self._turn:
                state = await self._read_state()
                if self._commands != mine:
                    raise self._not_arrived(temperature_c, "was replaced by another command", state)
                next_c = self._controller.as_stored(ramp.set_point_c(loop.time()))
                if next_c != self._commanded_c:
                    await self._command(next_c)
                    mine = self._commands
            if abs(state.set_point_c - end_c) <= ARRIVED_WITHIN_C:
                return
            if deadline.passed:
                raise self._not_arrived(temperature_c, f"of {ramp.duration_s:.0f} s has not ended", state)
            await asyncio.sleep(ramp.pause_s(loop.time(), state.set_point_c, self._poll_s))

    async def state(self) -> ChamberState:
        """State of the chamber.

        Raises InstrumentFault if, after a command, the set point is not the last one commanded or not active; if the
        process value is frozen while the set point moves; and if the air does not follow as required by `follow`, or is
        far beyond the limits. Raises BadAnswer for a value that is no number.
        """
        async with self._turn:
            state = await self._read_state()
        from_safe_c = (
            0.0 if state.control is Control.IDLE else abs(state.target_c - self._controller.as_stored(self._safe_c))
        )
        return ChamberState(state.process_value_c, state.set_point_c, state.target_c, from_safe_c)

    async def hold(self) -> None:
        """Stop the ramp: make the active set point the set point, read back."""
        async with self._turn:
            await self._command((await self._controller.read_state(self._commanded_c)).set_point_c)

    async def poll(self) -> Mapping[str, Sequence[Reading]]:
        """Process value and active set point (°C); raises as `state`."""
        state = await self.state()
        at_s = asyncio.get_running_loop().time()
        return {
            "process_value": [Reading(at_s, state.process_value_c)],
            "set_point": [Reading(at_s, state.set_point_c)],
        }

    async def make_safe(self) -> None:
        """Command the safe temperature with the present ramp rate, read back, without waiting for it.

        Reconnects after a loss. A controller that is switched off stays off; one that follows a program is switched to
        the set point. Raises a DriverError if that could not be proved.
        """
        try:
            async with fair_timeout(self._safe_within_s), self._turn:
                await self._command_safe()
                state = await self._controller.read_state(self._commanded_c)
                if state.control is Control.FOREIGN:
                    await self._controller.take_control()
        except DriverError:
            raise
        except TimeoutError as late:
            raise NoAnswer(
                self.name, f"was not made safe within {self._safe_within_s:g} s",
                sent=f"set point {self._safe_c:g} °C", remedy="Set it by hand at the chamber.",
            ) from late  # fmt: skip

    async def _begin(self, temperature_c: float, rate_c_per_min: float) -> RampProfile:
        """Send the ramp rate, then the first set point, and activate it."""
        state = await self._controller.read_state(None)
        self._check_control(state, may_be_off=self._controller.can_start)
        start_c = state.set_point_c if state.control is Control.SET_POINT else state.process_value_c
        if not self._following.is_possible(start_c):
            raise self._not_following(f"no ramp may begin far beyond {self._following.limits}", state)
        began_s = asyncio.get_running_loop().time()
        ramp = RampProfile(start_c, temperature_c, rate_c_per_min / 60, began_s, self._step_s)
        if self._step_s is None:
            await self._controller.set_ramp(rate_c_per_min)
        await self._command(ramp.set_point_c(began_s))
        if state.control is Control.IDLE:
            await self._controller.take_control()
        return ramp

    async def _read_state(self) -> ControllerState:
        state = await self._controller.read_state(self._commanded_c)
        if self._commanded_c is not None:
            self._check_target(state, self._commanded_c)
            self._check_control(state)
        self._check_movement(state)
        return state

    async def _command(self, temperature_c: float) -> None:
        self._commanded_c = None  # after a cancellation here both set points are possible, and neither is foreign
        self._commands += 1
        await self._controller.command(temperature_c)
        self._commanded_c = self._controller.as_stored(temperature_c)

    async def _command_safe(self) -> None:
        try:
            await self._command(self._safe_c)
        except (NoAnswer, LinkLost):
            # The command may have been executed or not: the state read on a new connection decides.
            safe_c = self._controller.as_stored(self._safe_c)
            if (await self._controller.read_state(None)).target_c != safe_c:
                await self._command(self._safe_c)
            self._commanded_c = safe_c

    def _check_temperature(self, temperature_c: float) -> None:
        bench = self._limits.temperature
        if not bench.min <= temperature_c <= bench.max:
            raise self._beyond(f"{temperature_c:g} °C", "bench file", f"{bench.min:g} to {bench.max:g} °C")
        limits_c = self._controller.limits_c
        if limits_c is None:
            raise LinkLost(self.name, "the controller has not been identified yet", remedy="Open the device first.")
        if not limits_c[0] <= self._controller.as_stored(temperature_c) <= limits_c[1]:
            raise self._beyond(f"{temperature_c:g} °C", "controller", f"{limits_c[0]:g} to {limits_c[1]:g} °C")

    def _check_rate(self, rate_c_per_min: float) -> None:
        fastest = self._limits.ramp_rate.max
        if not 0 < rate_c_per_min <= fastest:
            raise self._beyond(f"{rate_c_per_min:g} °C/min", "bench file", f"above 0, at most {fastest:g} °C/min")

    def _check_target(self, state: ControllerState, commanded_c: float) -> None:
        if state.target_c != commanded_c:
            raise InstrumentFault(
                self.name, "another master changed the set point", sent=f"set point {commanded_c:g} °C before",
                received=f"set point {state.target_c:g} °C now",
                remedy="Find out who commands the chamber: its front panel, its web page, another program.",
            )  # fmt: skip

    def _check_control(self, state: ControllerState, *, may_be_off: bool = False) -> None:
        if state.control is Control.FOREIGN or (state.control is Control.IDLE and not may_be_off):
            raise InstrumentFault(
                self.name, "the chamber does not follow its set point", received=state.why,
                remedy="Check the state of the controller, and find the other master.",
            )  # fmt: skip

    def _check_movement(self, state: ControllerState) -> None:
        at_s = asyncio.get_running_loop().time()
        if self._standstill.frozen(at_s, state.process_value_c, state.set_point_c):
            raise InstrumentFault(
                self.name, f"the process value has not changed for {STANDSTILL_S / 60:g} min of a moving set point",
                received=f"process value {state.process_value_c:g} °C, set point {state.set_point_c:g} °C",
                remedy="Check the chamber's sensor, its cable, and the controller's display.",
            )  # fmt: skip
        is_commanded = self._commanded_c is not None
        if wrong := self._following.problem(at_s, state.process_value_c, state.set_point_c, commanded=is_commanded):
            raise self._not_following(wrong, state)

    def _beyond(self, asked: str, whose: str, allowed: str) -> BeyondLimit:
        return BeyondLimit(
            self.name, f"{asked} is beyond the limits of the {whose}, {allowed}; nothing was sent",
            remedy="Correct the sequence, or the limits if they are wrong.",
        )  # fmt: skip

    def _not_following(self, wrong: str, state: ControllerState) -> InstrumentFault:
        return InstrumentFault(
            self.name, wrong,
            received=f"process value {state.process_value_c:.2f} °C, set point {state.set_point_c:.2f} °C",
            remedy="Look at the chamber itself: its heater, its cooling, its sensor, its door, its own limiter.",
        )  # fmt: skip

    def _not_arrived(self, temperature_c: float, why: str, state: ControllerState) -> NotSettled:
        return NotSettled(
            self.name, f"the ramp to {temperature_c:g} °C {why}",
            received=f"active set point {state.set_point_c:g} °C, process value {state.process_value_c:g} °C",
            remedy="Check at the controller whether a profile runs or the ramp is paused.",
        )  # fmt: skip


class StandstillWatch:
    """Monitors a process value and the set point that it should follow, at any polling intervals.

    A constant value is no fault while the set point is constant too, or while it is not polled.
    """

    def __init__(self) -> None:
        self._process_value = self._set_point = math.nan
        self._same_since_s = self._moved_at_s = -math.inf

    def frozen(self, at_s: float, process_value: float, set_point: float) -> bool:
        """Evaluate one poll at the loop time `at_s`; return whether the process value is frozen."""
        if process_value != self._process_value or at_s - self._moved_at_s > SET_POINT_STANDS_S:
            self._same_since_s = at_s
        if set_point != self._set_point:
            self._moved_at_s = at_s
        self._process_value, self._set_point = process_value, set_point
        return at_s - self._same_since_s >= STANDSTILL_S
