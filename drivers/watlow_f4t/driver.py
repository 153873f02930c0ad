"""A thermal chamber with a Watlow F4T: the controller ramps; the driver commands, reads back and watches."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from typing import Self

from drivers.description import Setup
from drivers.errors import BeyondLimit, DriverError, InstrumentFault, LinkLost, NoAnswer, NotSettled
from drivers.transport.modbus import ModbusLink
from drivers.values import ChamberState, Identity, Reading
from drivers.watlow_f4t.description import F4TLimits, F4TOptions, F4TSafe
from drivers.watlow_f4t.registers import LoopRegisters
from drivers.watlow_f4t.standstill import STANDSTILL_S, StandstillWatch
from drivers.watlow_f4t.wire import ControlMode, LoopBlock, LoopFormat, LoopRegister, RampAction, RampScale, mode_name

ARRIVED_WITHIN_C = 1e-4  # a few times the last bit of a float32: the set point in force is computed, not copied
RAMP_LONGER_BY, RAMP_LATER_S = 1.1, 120.0  # what a ramp may take more than distance / rate
FAR_AWAY_POLL_S = 5.0  # how often a ramp is looked at while its end is far away
MAKE_SAFE_WITHIN_S = 8.0


class WatlowF4T:
    """One control loop of an F4T in data map 1; a ThermalChamber.

    Every look compares the set point with the one last commanded: another master is a fault, not a discussion.

    Concurrency: commands and looks take turns, so no look falls between a write and its read-back.
    """

    def __init__(self, setup: Setup[F4TOptions, F4TLimits, F4TSafe]) -> None:
        options = setup.options
        self.name = setup.name
        self._pin, self._limits, self._safe_c = setup.identity, setup.limits, setup.safe.temperature
        self._poll_s, self._block_reads = options.poll, options.block_reads
        self._form = LoopFormat(options.loop, options.word_order)
        link = ModbusLink(
            setup.name, setup.wires, setup.address, unit_id=options.unit_id, answer_s=options.answer_timeout
        )
        self._registers = LoopRegisters(link, self._form)
        self._turn = asyncio.Lock()
        self._commanded_c: float | None = None  # the set point last written and read back, as long as it is known
        self._watch = StandstillWatch()

    async def __aenter__(self) -> Self:
        """Connects and identifies; BeyondLimit when the safe temperature could not be commanded."""
        async with self._turn:
            await self._registers.connect()
            try:
                self._check_temperature(self._safe_c)
            except BeyondLimit:
                self._registers.close()
                raise
        return self

    async def __aexit__(self, *exc: object) -> None:
        """Closes the connection; the chamber goes on as it is."""
        self._registers.close()

    async def identify(self) -> Identity:
        """The names as the bench file states them, since the wire tells none; the fingerprint is what it does tell.

        Raises WrongIdentity when the display unit is not °C, when the word order does not fit, or when the set-point
        limits are not those of the first time.
        """
        async with self._turn:
            await self._registers.identify()
        low_c, high_c = self._controller_limits_c()
        return Identity(
            maker=self._pin.maker or "Watlow", model=self._pin.model or "F4T", serial=self._pin.serial or "",
            firmware=self._pin.firmware or "", verified=False,
            fingerprint=f"display unit °C, set point {low_c:g} to {high_c:g} °C",
        )  # fmt: skip

    async def ramp_to(self, temperature_c: float, rate_c_per_min: float) -> None:
        """Ramps the set point in force to `temperature_c` and returns when it is there.

        Cancelling leaves the chamber ramping; `hold` stops it. Raises BeyondLimit before anything is sent; Refused when
        the controller does not take a setting; NotSettled when it takes longer than the distance needs, a tenth and two
        minutes more, or when another command replaces this one; and what `state` raises.
        """
        self._check_temperature(temperature_c)
        self._check_rate(rate_c_per_min)
        async with self._turn:
            start_c = await self._start_ramp(temperature_c, rate_c_per_min)
            commanded_c = self._commanded_c
        loop = asyncio.get_running_loop()
        ramp_s = 60 * abs(temperature_c - start_c) / rate_c_per_min
        deadline_s = loop.time() + ramp_s * RAMP_LONGER_BY + RAMP_LATER_S
        while True:
            state = await self.state()
            if self._commanded_c != commanded_c:
                raise self._not_arrived(temperature_c, "was replaced by another command", state)
            if abs(state.set_point_c - temperature_c) <= ARRIVED_WITHIN_C:
                return
            if loop.time() > deadline_s:
                raise self._not_arrived(temperature_c, f"of {ramp_s:.0f} s has not ended", state)
            left_s = 60 * abs(temperature_c - state.set_point_c) / rate_c_per_min
            await asyncio.sleep(max(self._poll_s, min(left_s / 2, FAR_AWAY_POLL_S)))

    async def state(self) -> ChamberState:
        """One look at the control loop.

        Raises InstrumentFault when the set point is not the one last commanded or the loop is not in auto, once there
        was a command, and when the process value stands still while the set point moves; BadAnswer for no number.
        """
        async with self._turn:
            block = await (self._registers.block() if self._block_reads else self._registers.block_singly())
            target_c = await self._target_c(block)
            self._check_command(target_c, block)
            self._check_movement(block)
        return ChamberState(block.process_value, block.set_point_in_force, target_c)

    async def _target_c(self, block: LoopBlock) -> float:
        """The set point. It is not asked for while the one in force rests at the command: it would leave at once."""
        if self._commanded_c is not None and abs(block.set_point_in_force - self._commanded_c) <= ARRIVED_WITHIN_C:
            return self._commanded_c
        return await self._registers.number(LoopRegister.SET_POINT)

    async def hold(self) -> None:
        """Makes the set point in force the set point, read back."""
        async with self._turn:
            await self._command(await self._registers.number(LoopRegister.SET_POINT_IN_FORCE))

    async def poll(self) -> Mapping[str, Sequence[Reading]]:
        """The process value and the set point in force (°C); raises as `state`."""
        state = await self.state()
        at_s = asyncio.get_running_loop().time()
        return {
            "process_value": [Reading(at_s, state.process_value_c)],
            "set_point": [Reading(at_s, state.set_point_c)],
        }

    async def make_safe(self) -> None:
        """Commands the safe temperature with the ramp as it is, read back, without waiting for it; at most 8 s.

        Connects anew when the connection is lost. Raises a DriverError when the set point could not be proved, or when
        the loop is in manual mode, in which it does nothing.
        """
        try:
            async with asyncio.timeout(MAKE_SAFE_WITHIN_S), self._turn:
                await self._command_safe()
                mode = await self._registers.enumeration(LoopRegister.CONTROL_MODE_IN_FORCE)
        except DriverError:
            raise
        except TimeoutError as late:
            raise NoAnswer(
                self.name, f"could not be made safe within {MAKE_SAFE_WITHIN_S:g} s",
                sent=f"set point {self._safe_c:g} °C", remedy="Set it by hand at the chamber.",
            ) from late  # fmt: skip
        if mode == ControlMode.MANUAL:
            raise self._not_in_auto(mode)

    async def _start_ramp(self, temperature_c: float, rate_c_per_min: float) -> float:
        """Writes the ramp, then the set point, which starts it; the set point in force before (°C)."""
        mode = await self._registers.enumeration(LoopRegister.CONTROL_MODE_IN_FORCE)
        if mode != ControlMode.AUTO:
            raise self._not_in_auto(mode)
        start_c = await self._registers.number(LoopRegister.SET_POINT_IN_FORCE)
        await self._registers.set(LoopRegister.RAMP_SCALE, (RampScale.MINUTES,))
        await self._registers.set(LoopRegister.RAMP_RATE, self._form.words(rate_c_per_min))
        await self._registers.set(LoopRegister.RAMP_ACTION, (RampAction.SET_POINT,))
        await self._command(temperature_c)
        return start_c

    async def _command(self, temperature_c: float) -> None:
        words = self._form.words(temperature_c)
        self._commanded_c = None  # if this is cut short, either set point may be there, and neither is foreign
        await self._registers.set(LoopRegister.SET_POINT, words)
        self._commanded_c = self._form.value(words)

    async def _command_safe(self) -> None:
        try:
            await self._command(self._safe_c)
        except (NoAnswer, LinkLost):
            # Perhaps it was carried out, perhaps not: what the controller says over a new connection decides.
            if await self._registers.words(LoopRegister.SET_POINT, 2) != self._form.words(self._safe_c):
                await self._command(self._safe_c)
            self._commanded_c = self._on_wire(self._safe_c)

    def _check_temperature(self, temperature_c: float) -> None:
        bench = self._limits.temperature
        if not bench.min <= temperature_c <= bench.max:
            raise self._beyond(f"{temperature_c:g} °C", "bench file", f"{bench.min:g} to {bench.max:g} °C")
        low_c, high_c = self._controller_limits_c()
        if not low_c <= self._on_wire(temperature_c) <= high_c:
            raise self._beyond(f"{temperature_c:g} °C", "controller", f"{low_c:g} to {high_c:g} °C")

    def _check_rate(self, rate_c_per_min: float) -> None:
        fastest = self._limits.ramp_rate.max
        if not 0 < rate_c_per_min <= fastest:
            raise self._beyond(f"{rate_c_per_min:g} °C/min", "bench file", f"above 0, at most {fastest:g} °C/min")

    def _check_command(self, target_c: float, block: LoopBlock) -> None:
        if self._commanded_c is None:
            return
        if target_c != self._commanded_c:
            raise InstrumentFault(
                self.name, "somebody else changed the set point", sent=f"set point {self._commanded_c:g} °C before",
                received=f"set point {target_c:g} °C now",
                remedy="Find out who commands the chamber: its front panel, its web page, another program.",
            )  # fmt: skip
        if block.mode != ControlMode.AUTO:
            raise self._not_in_auto(block.mode)

    def _check_movement(self, block: LoopBlock) -> None:
        at_s = asyncio.get_running_loop().time()
        if self._watch.frozen(at_s, block.process_value, block.set_point_in_force):
            raise InstrumentFault(
                self.name, f"the process value has not changed for {STANDSTILL_S / 60:g} min of a moving set point",
                received=f"process value {block.process_value:g} °C, set point {block.set_point_in_force:g} °C",
                remedy="Check the chamber's sensor, its cable, and what the controller's display says.",
            )  # fmt: skip

    def _controller_limits_c(self) -> tuple[float, float]:
        limits_c = self._registers.set_point_limits_c
        if limits_c is None:
            raise LinkLost(self.name, "the controller has not been identified yet", remedy="Open the device first.")
        return limits_c

    def _on_wire(self, temperature_c: float) -> float:
        """The float32 nearest to a temperature: what the controller holds when it was told this one."""
        return self._form.value(self._form.words(temperature_c))

    def _beyond(self, asked: str, whose: str, allowed: str) -> BeyondLimit:
        return BeyondLimit(
            self.name, f"{asked} is beyond the limits of the {whose}, {allowed}; nothing was sent",
            remedy="Correct the sequence, or the limits if they are wrong.",
        )  # fmt: skip

    def _not_in_auto(self, mode: int) -> InstrumentFault:
        return InstrumentFault(
            self.name, f"control loop {self._form.loop} is not in auto", received=f"mode {mode_name(mode)}",
            remedy="Switch the loop to auto at the controller; look for who switched it.",
        )  # fmt: skip

    def _not_arrived(self, temperature_c: float, why: str, state: ChamberState) -> NotSettled:
        return NotSettled(
            self.name, f"the ramp to {temperature_c:g} °C {why}",
            received=f"set point in force {state.set_point_c:g} °C, process value {state.process_value_c:g} °C",
            remedy="Look at the controller whether a profile runs or the ramp is paused.",
        )  # fmt: skip
