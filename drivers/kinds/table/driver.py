"""A rate table on any controller: moves to angles, turns at rates, oscillates, and proves that it does."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Self

from drivers.capabilities import Approach
from drivers.errors import DriverError, InstrumentFault, NotSettled, Refused
from drivers.kinds.approach import ARCSEC_PER_DEG, DEVIATION_BANDS, Hold, begin_of, legs, pause_s
from drivers.kinds.latest import Latest, Order
from drivers.kinds.table.axis import Drive, Mode, State, TableAxis
from drivers.kinds.table.bounds import Bounds
from drivers.kinds.table.description import TableLimits, TableOptions, safe_state
from drivers.timing.awake import Deadline, now_s
from drivers.timing.readback import read_back
from drivers.transport.dialogue import safe_in_time
from drivers.values import Identity, Reading

MODE_CHANGE_S = 0.5  # at rest before a change of mode, as in third-party drivers
RUN_UP_S, RUN_UP_PERIODS = 2.0, 4  # run-up of a sine, slow enough to add little to its peak acceleration
RATE_RIPPLE = 1e-3  # relative: possible deviation of an instantaneous rate with a correct mean


class Table:
    """One axis, moved by the commands of its controller; a Positioner and a RateTable.

    It never homes the axis and never resets a fault: a person at the controller has to do both. Motions are sent once;
    if an answer is missing, the read-back decides. Angles count whole turns from the connection on, and targets of
    moves are in that count.

    Concurrency: a new motion, `stop` and `make_safe` supersede the running motion, which then raises Refused.
    """

    def __init__(self, name: str, axis: TableAxis, options: TableOptions, limits: TableLimits) -> None:
        self.name, self._axis, self._options = name, axis, options
        self._max_rate_dps, self._max_dps2 = limits.rate.max, limits.acceleration.max
        self._bounds = Bounds(name, limits)
        self._safe_within_s = safe_state(options, limits, None).within_s
        self._band_deg = options.settle.band / ARCSEC_PER_DEG
        self._latest: Latest[tuple[Mode, float]] = Latest(name, "motion")  # its result: a mode, with ° or °/s
        self._sine: tuple[float, float] | None = None  # the last one: ± °, Hz
        self._swept_at_s = -math.inf  # by then the frequency of a sweep no longer changes

    async def __aenter__(self) -> Self:
        """Connect and identify."""
        await self._axis.open()
        return self

    async def __aexit__(self, *exc: object) -> None:
        """Release control of the table, if the controller still answers, and close the connection; motions go on."""
        try:
            with suppress(DriverError):
                await self._axis.release_control()
        finally:
            self._axis.close()

    async def identify(self) -> Identity:
        """Identity of the controller; raises WrongIdentity if it has changed."""
        return await self._axis.identify()

    async def poll(self) -> Mapping[str, Sequence[Reading]]:
        """Angle and rate; InstrumentFault if the state differs from the command, or the table has a fault."""
        state = await self._axis.read_state()
        await self._axis.check_fault(state)
        if problem := self._deviation(state):
            raise InstrumentFault(
                self.name, problem, received=str(state),
                remedy="Look for a tripped interlock, or another master: the front panel, another program, a hand.",
            )  # fmt: skip
        return {"angle": [self._angle(state)], "rate": [self._rate(state)]}

    async def angle(self) -> Reading:
        """Angle (°), over whole turns."""
        return self._angle(await self._axis.read_state())

    async def rate(self) -> Reading:
        """Rate (°/s)."""
        return self._rate(await self._axis.read_state())

    async def move_to(self, angle_deg: float, *, approach: Approach, settle_s: float) -> Reading:
        """Move to `angle_deg` and settle; return the angle read back after a further `settle_s`.

        `from_below` and `from_above` begin at least `approach_distance` on that side, even if the axis is at the angle
        already, so that every visit has the same approach. Raises BeyondLimit before anything is sent; Refused or
        InstrumentFault from the controller; NotSettled if the axis does not settle in its band.
        """
        begin_deg = begin_of(angle_deg, approach, self._options.approach_distance)
        self._bounds.check_angle("the angle", angle_deg)
        self._bounds.check_angle(f"the angle where the approach to {angle_deg:g}° begins,", begin_deg)
        order = self._latest.begin()
        state = await self._enter(order, Mode.POSITION, self._options.acceleration)
        for leg_deg, hold_s in legs(state.angle_deg, begin_deg, angle_deg, self._options.settle.hold):
            await self._go(order, leg_deg, hold_s=hold_s)
        await asyncio.sleep(settle_s)
        state = await self._watch(order, Mode.POSITION)
        if abs(state.angle_deg - angle_deg) > self._band_deg:
            raise self._not_settled(f"the table left {angle_deg:g}° within {settle_s:g} s", state)
        self._latest.done(order, (Mode.POSITION, angle_deg))
        return self._angle(state)

    async def rotate_at(self, rate_dps: float, *, acceleration_dps2: float | None) -> None:
        """Turn at `rate_dps`; return when the rate read back agrees within `rate_band` plus a thousandth.

        `acceleration_dps2` is `options.acceleration` unless given. Raises BeyondLimit before anything is sent, also on
        an axis with ends; Refused or InstrumentFault from the controller; NotSettled when the rate is not reached.
        """
        acceleration_dps2 = self._options.acceleration if acceleration_dps2 is None else acceleration_dps2
        self._bounds.check_turning(rate_dps, acceleration_dps2)
        order = self._latest.begin()
        state = await self._enter(order, Mode.RATE, acceleration_dps2)
        order.check()
        await self._axis.turn(rate_dps)
        await self._until(
            order, Mode.RATE, lambda state: abs(state.rate_dps - rate_dps) <= self._rate_band_dps(rate_dps),
            abs(rate_dps - state.rate_dps) / acceleration_dps2, f"the rate of {rate_dps:g} °/s is not reached",
        )  # fmt: skip
        self._latest.done(order, (Mode.RATE, rate_dps))

    async def oscillate(self, amplitude_deg: float, frequency_hz: float) -> None:
        """Oscillate sinusoidally by ± `amplitude_deg` about the present angle, after a stop if necessary.

        Returns when amplitude and frequency are reached. Raises BeyondLimit before anything moves, if the sine exceeds
        a limit of rate, acceleration or angle; Refused or InstrumentFault from the controller; NotSettled.
        """
        self._bounds.check_sine(amplitude_deg, frequency_hz)
        run_up_s = max(RUN_UP_S, RUN_UP_PERIODS / frequency_hz)
        order = self._latest.begin()
        state = await self._enter(order, Mode.POSITION, self._options.acceleration)
        for end_deg in (state.angle_deg - amplitude_deg, state.angle_deg + amplitude_deg):
            self._bounds.check_angle("the end of the swing", end_deg)
        await self._axis.prepare(Mode.SYNTHESIS, self._max_rate_dps, self._max_dps2)
        await self._axis.demand_sine(amplitude_deg, frequency_hz, run_up_s)
        await self._follow(order, Mode.SYNTHESIS)
        await self._until(
            order, Mode.SYNTHESIS, lambda state: state.oscillating, run_up_s,
            f"the sine of ±{amplitude_deg:g}° at {frequency_hz:g} Hz is not reached",
        )  # fmt: skip
        self._sine = amplitude_deg, frequency_hz
        self._latest.done(order, (Mode.SYNTHESIS, amplitude_deg))

    async def sweep(self, to_hz: float, over_s: float) -> None:
        """Change the frequency of the running sine to `to_hz` at a constant rate within `over_s`; return at its begin.

        Raises BeyondLimit before anything is sent, if the sine would exceed a limit; Refused without a running sine, or
        from a controller that cannot; NotSettled if the frequency does not begin to change.
        """
        if self._sine is None or self._latest.result is None or self._latest.result[0] is not Mode.SYNTHESIS:
            raise Refused(self.name, "there is no oscillation whose frequency could be swept")
        amplitude_deg, from_hz = self._sine
        self._bounds.check_sine(amplitude_deg, to_hz)
        order = self._latest.begin()
        await self._axis.change_sine(amplitude_deg, to_hz, abs(to_hz - from_hz) / over_s)
        self._swept_at_s = now_s() + over_s + self._options.settle.give_up
        state = await read_back(self._axis.read_state, lambda state: order.ended or not state.oscillating)
        if state.oscillating:
            raise self._not_settled(f"the sweep from {from_hz:g} to {to_hz:g} Hz has not begun", state)
        self._sine = amplitude_deg, to_hz
        self._latest.done(order, (Mode.SYNTHESIS, amplitude_deg))

    async def stop(self) -> None:
        """Decelerate to rate zero and hold it; return when the table is at rest."""
        self._latest.begin()
        await self._axis.stop()
        await self._axis.check_fault(await self._come_to_rest())

    async def make_safe(self) -> None:
        """Stop the table where it is, within `safe_state`: no move, and a drive that was on stays on to hold it.

        Proved by reading back; a table whose drive has tripped is not driven any more. Raises NoAnswer if it cannot be
        proved; CannotConnect, WrongIdentity after a lost wire.
        """
        self._latest.begin()
        async with safe_in_time(self.name, self._safe_within_s):
            await self._axis.reopen()
            self._axis.stop_at_once()
            await self._come_to_rest()

    async def _enter(self, order: Order, mode: Mode, acceleration_dps2: float) -> State:
        """Energise, take control and enter `mode` at rest (in RATE possibly turning); return the state after it."""
        state = await self._axis.make_ready()
        rate_dps = self._options.rate if mode is Mode.POSITION else self._max_rate_dps
        await self._axis.prepare(mode, rate_dps, acceleration_dps2)
        await self._axis.prepare(Mode.OFF, self._max_rate_dps, self._options.acceleration)
        if state.mode is mode and (mode is Mode.RATE or abs(state.rate_dps) <= self._options.rate_band):
            return state
        order.check()
        if state.mode is not Mode.OFF:
            await self._axis.stop()
        await self._come_to_rest()
        await asyncio.sleep(MODE_CHANGE_S)
        state = await self._axis.read_state()
        order.check()
        # A mode follows its last demand as soon as it is entered.
        await self._axis.demand_here(mode, state.angle_deg)
        return await self._follow(order, mode)

    async def _follow(self, order: Order, mode: Mode) -> State:
        """Make the servo follow the demand of a mode; return the state with that mode, or the one at the time limit."""
        order.check()
        await self._axis.enter(mode)
        await read_back(self._axis.read_state, lambda state: order.ended or state.mode is mode or state.stale)
        return await self._watch(order, mode)

    async def _go(self, order: Order, target_deg: float, *, hold_s: float) -> None:
        """Move to an angle, and return when the axis has been there for `hold_s`.

        A controller that takes the shorter way goes a long one in legs.
        """
        begin_deg = (await self._watch(order, Mode.POSITION)).angle_deg
        way_deg = target_deg - begin_deg
        legs = math.ceil(abs(way_deg) / self._axis.longest_leg_deg)
        for leg in range(1, legs):
            await self._leg(order, begin_deg + way_deg * leg / legs, way_deg / legs, 0.0)
        await self._leg(order, target_deg, way_deg / max(legs, 1), hold_s)

    async def _leg(self, order: Order, target_deg: float, way_deg: float, hold_s: float) -> None:
        """Move the axis to an angle once, and return when it has been there for `hold_s`."""
        hold = Hold(hold_s)

        def fulfilled(state: State) -> bool:
            near = abs(state.angle_deg - target_deg) <= self._band_deg
            return hold.is_over(now_s(), fulfilled=near and abs(state.rate_dps) <= self._options.rate_band)

        order.check()
        await self._axis.go(target_deg)
        travel_s = abs(way_deg) / self._options.rate + self._options.rate / self._options.acceleration
        await self._until(order, Mode.POSITION, fulfilled, travel_s, f"the table is not at {target_deg:g}°", hold_s)

    async def _until(
        self, order: Order, mode: Mode, arrived: Callable[[State], bool], expected_s: float, problem: str,
        hold_s: float = 0.0,
    ) -> None:  # fmt: skip
        """Return when the axis has arrived and held; NotSettled `give_up` after the expected time."""
        near_s = now_s() + expected_s
        deadline = Deadline(expected_s + hold_s + self._options.settle.give_up)
        while not arrived(state := await self._watch(order, mode)):
            if deadline.passed:
                raise self._not_settled(problem, state)
            await asyncio.sleep(pause_s(self._options.poll, near_s - now_s()))

    async def _watch(self, order: Order, mode: Mode) -> State:
        """Poll a motion; raises Refused if it has been superseded, InstrumentFault if it cannot continue."""
        state = await self._axis.read_state()
        order.check()
        await self._axis.check_fault(state)
        if problem := _lost_control(state, mode):
            raise InstrumentFault(
                self.name, problem, received=str(state),
                remedy="Check the controller's panel for a change there, then run again.",
            )  # fmt: skip
        return state

    async def _come_to_rest(self) -> State:
        """State of the axis at rest; raises NotSettled. A tripped axis may report old values for ever."""
        deadline = Deadline(self._safe_within_s + self._options.settle.give_up)
        while True:
            state = await self._axis.read_state()
            at_rest = state.held and abs(state.rate_dps) <= self._options.rate_band
            if at_rest or state.stale:
                return state
            if deadline.passed:
                raise NotSettled(
                    self.name, "the table still turns after a stop", received=str(state),
                    remedy="Press the emergency stop.",
                )  # fmt: skip
            await asyncio.sleep(self._options.poll)

    def _deviation(self, state: State) -> str:
        """Difference of the table's state from the command; "" if there is none."""
        if self._latest.result is None:
            return ""
        mode, value = self._latest.result
        if problem := _lost_control(state, mode):
            return problem
        match mode:
            case Mode.POSITION if abs(state.angle_deg - value) > DEVIATION_BANDS * self._band_deg:
                return f"the table is not at {value:g}°, its target"
            case Mode.RATE if abs(state.rate_dps - value) > DEVIATION_BANDS * self._rate_band_dps(value):
                return f"the table does not turn at {value:g} °/s, as commanded"
            case Mode.SYNTHESIS if not state.oscillating and now_s() > self._swept_at_s:
                return f"the table does not swing by ±{value:g}°, as commanded"
        return ""

    def _angle(self, state: State) -> Reading:
        return Reading(now_s(), state.angle_deg)

    def _rate(self, state: State) -> Reading:
        return Reading(now_s(), state.rate_dps)

    def _rate_band_dps(self, rate_dps: float) -> float:
        return self._options.rate_band + RATE_RIPPLE * abs(rate_dps)

    def _not_settled(self, problem: str, state: State) -> NotSettled:
        return NotSettled(
            self.name, problem, received=str(state),
            remedy="Check for a blocked or unbalanced table, and settle and rate_band in the bench file.",
        )  # fmt: skip


def _lost_control(state: State, mode: Mode) -> str:
    """Reason why a motion in `mode` is no longer under our control; "" if it is."""
    if state.drive is not Drive.ON:
        return "the drive of the table was switched off"
    if state.mode is not mode:
        return f"the table is in mode {state.mode.value}, commanded was {mode.value}"
    return "" if state.in_control else "another master has taken control of the table"
