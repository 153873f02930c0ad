"""An indexing head on any controller: moves to angles, from a stated side, and proves that it stands there."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from typing import Self

from drivers.capabilities import Approach
from drivers.errors import BeyondLimit, InstrumentFault, NotSettled
from drivers.kinds.approach import ARCSEC_PER_DEG, DEVIATION_BANDS, Hold, begin_of, legs, pause_s
from drivers.kinds.head.axis import ANSWER_S, Axis
from drivers.kinds.head.bounds import check_angle
from drivers.kinds.head.description import HeadLimits, HeadOptions, safe_state
from drivers.kinds.latest import Latest, Order
from drivers.timing.awake import Deadline
from drivers.transport.dialogue import safe_in_time
from drivers.values import Identity, Reading


class Head:
    """One axis, moved by the commands of its controller; a Positioner.

    It never homes the axis and never acknowledges a fault: a person at the controller has to do both. A move is sent
    once; if its answer is missing, the feedback decides.

    Concurrency: a new move, `stop` and `make_safe` supersede the running move, which then raises Refused.
    """

    def __init__(self, name: str, axis: Axis, options: HeadOptions, limits: HeadLimits) -> None:
        self.name = name
        self._axis = axis
        self._options, self._limits = options, limits
        self._safe_within_s = safe_state(options, limits, None).within_s
        self._band_deg = options.settle.band / ARCSEC_PER_DEG
        self._latest: Latest[float] = Latest(name, "move")  # its result is the angle of the axis

    async def __aenter__(self) -> Self:
        """Connect and identify; BeyondLimit if the rate of the options exceeds a limit."""
        if self._options.rate > self._limits.rate.max:
            raise BeyondLimit(
                self.name, f"the rate {self._options.rate:g} °/s is above the limit of {self._limits.rate.max:g} °/s",
                remedy="Correct options.rate or limits.rate in the bench file.",
            )  # fmt: skip
        await self._axis.open()
        own = self._axis.limits
        if own is not None and self._options.rate > own.rate_dps:
            self._axis.close()
            raise BeyondLimit(
                self.name, f"the rate {self._options.rate:g} °/s is above the controller's own of {own.rate_dps:g} °/s",
                remedy="Correct options.rate in the bench file.",
            )  # fmt: skip
        return self

    async def __aexit__(self, *exc: object) -> None:
        """Close the connection; the axis keeps its state."""
        self._axis.close()

    async def identify(self) -> Identity:
        """Query the identity; raises WrongIdentity if it has changed."""
        return await self._axis.identify()

    async def poll(self) -> Mapping[str, Sequence[Reading]]:
        """Angle; InstrumentFault if the axis has a fault, or does not stand where it was sent."""
        reading = await self.angle()
        await self._axis.check_faults()
        target_deg = self._latest.result
        if target_deg is not None and abs(reading.value - target_deg) > DEVIATION_BANDS * self._band_deg:
            raise InstrumentFault(
                self.name, f"the axis stands at {reading.value:.5f}°, it was sent to {target_deg:.5f}°",
                remedy="Find out what else moves it: a joystick, another program, a hand.",
            )  # fmt: skip
        return {"angle": [reading]}

    async def angle(self) -> Reading:
        """Encoder angle (°)."""
        # The axis may move between two takes unless it is known to be at rest.
        return await self._confirmed_angle(0.0 if self._latest.result is not None else self._limits.rate.max)

    async def move_to(self, angle_deg: float, *, approach: Approach, settle_s: float) -> Reading:
        """Move to `angle_deg` and settle; return the angle read back after a further `settle_s`.

        `from_below` and `from_above` begin at least `approach_distance` on that side, even if the axis is at the angle
        already, so that every visit has the same approach. Raises BeyondLimit before anything is sent; Refused or
        InstrumentFault from the controller; NotSettled if the axis does not settle in its band.
        """
        begin_deg = begin_of(angle_deg, approach, self._options.approach_distance)
        self._check_angle("the angle", angle_deg)
        self._check_angle(f"the angle where the approach to {angle_deg:g}° begins,", begin_deg)
        order = self._latest.begin()
        await self._make_ready(order)
        start_deg = (await self._axis.angle()).value
        for leg_deg, hold_s in legs(start_deg, begin_deg, angle_deg, self._options.settle.hold):
            await self._go(order, leg_deg, hold_s=hold_s)
        await asyncio.sleep(settle_s)
        reading = await self._confirmed_angle(0.0)
        order.check()
        if abs(reading.value - angle_deg) > self._band_deg:
            raise self._not_settled(angle_deg, reading, f"left its band within {settle_s:g} s")
        self._latest.done(order, angle_deg)
        return reading

    async def stop(self) -> None:
        """Decelerate and hold; return when the axis is at rest."""
        self._latest.begin()
        await self._axis.abort()
        await self._come_to_rest()

    async def make_safe(self) -> None:
        """Stop the axis where it is, within `safe_state`: no homing, no move, and the servo keeps its state.

        Proved by the status. Raises NoAnswer if it cannot be proved; CannotConnect, WrongIdentity after a lost wire.
        """
        self._latest.begin()
        async with safe_in_time(self.name, self._safe_within_s):
            await self._axis.reopen()
            self._axis.abort_at_once()
            await self._come_to_rest()

    async def _confirmed_angle(self, slope_dps: float) -> Reading:
        """Confirmed angle: two takes agree within the band plus the motion at `slope_dps` between them."""

        def agree(one: Reading, other: Reading) -> bool:
            return abs(other.value - one.value) <= self._band_deg + slope_dps * abs(other.at_s - one.at_s)

        return await self._axis.double_read.confirmed(
            "the angle", self._axis.angle, agree=agree, describe=lambda reading: f"{reading.value:.6f}°"
        )

    def _check_angle(self, what: str, angle_deg: float) -> None:
        check_angle(self.name, what, angle_deg, self._limits.angle)
        own = self._axis.limits
        if own is not None and not own.min_deg <= angle_deg <= own.max_deg:
            raise BeyondLimit(
                self.name, f"{what} {angle_deg:g}° is outside the controller's own {own.min_deg:g}° to "
                f"{own.max_deg:g}°", remedy="No move was sent. Correct the sequence, or the limits in the controller.",
            )  # fmt: skip

    async def _make_ready(self, order: Order) -> None:
        """Enable the axis if necessary, and send its motion settings.

        Raises InstrumentFault if it has a fault or is not homed.
        """
        await self._axis.check_faults()
        state = await self._axis.state()
        if not state.homed:
            raise InstrumentFault(
                self.name, "the axis has not been homed, so its angles are undefined", received=state.words,
                remedy="Home it at the controller, where you can see it move.",
            )  # fmt: skip
        order.check()
        if not state.enabled:
            await self._axis.enable()
        await self._axis.prepare(self._options.rate)

    async def _go(self, order: Order, target_deg: float, *, hold_s: float) -> None:
        """Move the axis to an angle once, and return when it has been there for `hold_s`."""
        options = self._options
        start_deg = (await self._axis.angle()).value
        travel_s = abs(target_deg - start_deg) / options.rate + options.rate / options.acceleration
        deadline = Deadline(travel_s + options.settle.give_up)
        order.check()
        await self._axis.start_move(target_deg, options.rate, answer_s=travel_s + ANSWER_S)
        await self._stand(order, target_deg, hold_s, deadline)

    async def _stand(self, order: Order, target_deg: float, hold_s: float, deadline: Deadline) -> None:
        """Return when the axis has been within its band of the target for `hold_s`."""
        hold = Hold(hold_s)
        while True:
            state, reading = await self._axis.state(), await self._axis.angle()
            await self._axis.check_faults()
            order.check()
            if not state.enabled:
                raise InstrumentFault(
                    self.name, f"the axis was disabled during the move to {target_deg:g}°", received=state.words,
                    remedy="Find out what disabled it, then run again.",
                )  # fmt: skip
            at_rest = state.in_position and not state.moving
            off_deg = abs(reading.value - target_deg)
            if hold.is_over(reading.at_s, fulfilled=at_rest and off_deg <= self._band_deg):
                return
            if deadline.passed:
                raise self._not_settled(target_deg, reading, "is at rest" if at_rest else "is not at rest")
            await asyncio.sleep(pause_s(self._options.poll, off_deg / self._options.rate))

    async def _come_to_rest(self) -> None:
        """Return when the axis is at rest; raises NotSettled."""
        deadline = Deadline(self._options.settle.give_up)
        while (await self._axis.state()).moving:
            if deadline.passed:
                raise NotSettled(self.name, "the axis still moves after a stop", remedy="Press the emergency stop.")
            await asyncio.sleep(self._options.poll)

    def _not_settled(self, target_deg: float, reading: Reading, state: str) -> NotSettled:
        off_arcsec = (reading.value - target_deg) * ARCSEC_PER_DEG
        return NotSettled(
            self.name, f"the axis {state}, {off_arcsec:+.2f} arcsec off {target_deg:g}°, band "
            f"±{self._options.settle.band:g} arcsec", received=f"{reading.value:.6f}°",
            remedy="Check for a blocked or unbalanced axis, and settle.band in the bench file.",
        )  # fmt: skip
