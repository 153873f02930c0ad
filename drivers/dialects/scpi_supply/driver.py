"""A laboratory power supply: sets, reads back, watches that it stays as it was set."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Self

from drivers.description import Nothing, Setup
from drivers.dialects.scpi_supply import wire
from drivers.dialects.scpi_supply.description import SupplyLimits, SupplyOptions
from drivers.dialects.scpi_supply.wire import Setting, State
from drivers.errors import BeyondLimit, InstrumentFault, Refused
from drivers.timing.readback import ReadBack
from drivers.transport.dialogue import safe_in_time
from drivers.transport.scpi import ScpiLink
from drivers.values import Identity, Reading, SourceReading

READ_BACK = ReadBack()


class ScpiSupply:
    """One output; a Source of volts.

    Every command is sent once and what it did is read back. Every poll compares the settings with the last ones sent:
    a second master is a fault, not a discussion.

    Concurrency: a new `set` and `make_safe` end the `set` under way, which then raises Refused.
    """

    def __init__(self, setup: Setup[SupplyOptions, SupplyLimits, Nothing]) -> None:
        self.name = setup.name
        self._limits, self._options, self._note = setup.limits, setup.options, setup.note
        self._trips = [trip for trip in wire.TRIPS if trip in setup.options.answers]
        self._watchdog_s = float(round(setup.options.watchdog or 0))
        self._link = ScpiLink(setup)
        self._order = 0  # counts settings, so that one under way knows when it is no longer wanted
        self._made: Setting | None = None  # the setting that was made and read back

    async def __aenter__(self) -> Self:
        """Connects and identifies; raises CannotConnect or WrongIdentity."""
        await self._link.open()
        return self

    async def __aexit__(self, *exc: object) -> None:
        """Closes the wire; the output stays as it is."""
        self._link.close()

    async def identify(self) -> Identity:
        """Who is there, by *IDN?; raises WrongIdentity."""
        return await self._link.identify()

    async def poll(self) -> Mapping[str, Sequence[Reading]]:
        """Voltage and current as measured; InstrumentFault when it has tripped, or is no longer set as it was.

        None where two takes of them differ: an output that rises or falls, or an answer that came wrong.
        """
        *before, state = await self._takes()
        self._check_trips(state)
        self._compare(state.setting)
        for take in before:
            if not wire.steady(take, state):
                self._note(f"{_measured(take)} were reported, then {_measured(state)}: no reading")
                return {"voltage": [], "current": []}
        now_s = asyncio.get_running_loop().time()
        return {"voltage": [Reading(now_s, state.voltage_v)], "current": [Reading(now_s, state.current_a)]}

    async def read(self) -> SourceReading:
        """Voltage, current and output as the supply says."""
        *_, state = await self._takes()
        return SourceReading(state.voltage_v, state.current_a, state.setting.output)

    async def set(self, level: float, *, limit: float, output: bool) -> None:
        """Sets the current limit (A) and the level (V), reads both back, then switches the output on.

        With `output` False only switches off; level and limit stay. Raises BeyondLimit before anything is sent, Refused
        when the supply does not take a setting, InstrumentFault when one of its protections has tripped.
        """
        if output:
            self._check_limits(level, limit)
        order = self._new_order()
        state = await self._state()
        now = state.setting
        if output:
            self._check_trips(state)
            await self._check_maximum(level, limit)
        on, off = Setting(level, limit, True, self._watchdog_s), replace(now, output=False, watchdog_s=0.0)
        await self._reach(order, now, on if output else off)

    async def make_safe(self) -> None:
        """Switches the output off within 5 s, proved by reading back.

        Raises NoAnswer or Refused when it cannot be proved; CannotConnect, WrongIdentity after a lost wire.
        """
        order = self._new_order()
        async with safe_in_time(self.name):
            await self._link.reopen()
            self._link.cut_in(wire.OFF)
            now = (await self._state()).setting
            await self._reach(order, now, replace(now, output=False, watchdog_s=0.0))

    async def _reach(self, order: int, now: Setting, wanted: Setting) -> None:
        """Sends one command after the other until the supply says that it is set as wanted."""
        sent = ""
        while step := wire.next_step(now, wanted):
            if order != self._order:
                raise Refused(self.name, "the setting was ended by another command", sent=sent)
            if step == sent:
                raise Refused(
                    self.name, "a setting was not carried out", sent=sent, received=_in_words(now),
                    remedy="Look at the supply: is it locked, tripped, or limited below this setting?",
                )  # fmt: skip
            await self._link.write(step)
            sent, now = step, await self._setting_after(order, step, wanted)
        self._made = now

    async def _setting_after(self, order: int, step: str, wanted: Setting) -> Setting:
        """The setting as soon as it tells that a step was carried out, or at last; at once when nobody waits for it."""
        state = await READ_BACK.until(
            self._state, lambda state: order != self._order or wire.next_step(state.setting, wanted) != step
        )
        return state.setting

    async def _state(self) -> State:
        watched = bool(self._watchdog_s)
        return await self._link.ask(
            wire.state_query(self._trips, watchdog=watched),
            lambda line: wire.read_state(line, self._trips, watchdog=watched),
        )  # fmt: skip

    async def _takes(self) -> list[State]:
        """Looks at the supply, the last of them with a setting that another one has, too."""
        takes: list[State] = []

        async def take() -> State:
            takes.append(await self._state())
            return takes[-1]

        await self._link.takes.agreed(
            "what the supply is set to", take, alike=lambda one, other: one.setting == other.setting,
            spell=lambda state: _in_words(state.setting),
        )  # fmt: skip
        return takes

    def _check_limits(self, level_v: float, limit_a: float) -> None:
        remedy = "Nothing was sent. Correct the sequence, or the limits in the bench file."
        self._check_within(level_v, limit_a, (self._limits.voltage.max, self._limits.current.max), remedy)

    async def _check_maximum(self, level_v: float, limit_a: float) -> None:
        """Raises BeyondLimit for what the instrument itself does not do, where it tells that."""
        if "maximum" in self._options.answers:
            most = await self._link.ask(wire.MAXIMUM_QUERY, wire.read_maximum)
            remedy = "Nothing was set: the supply itself goes no further. Correct the sequence, or take another supply."
            self._check_within(level_v, limit_a, most, remedy)

    def _check_within(self, level_v: float, limit_a: float, most: tuple[float, float], remedy: str) -> None:
        wanted = (("the level", level_v, "V"), ("the current limit", limit_a, "A"))
        for (what, value, unit), highest in zip(wanted, most, strict=True):
            if not 0 <= value <= highest:
                problem = f"{what} {value:g} {unit} is outside 0 {unit} to {highest:g} {unit}"
                raise BeyondLimit(self.name, problem, remedy=remedy)

    def _check_trips(self, state: State) -> None:
        if state.tripped:
            told = " and ".join(trip.replace("_", "-") for trip in state.tripped)
            raise InstrumentFault(
                self.name, f"its {told} protection has tripped", received=_in_words(state.setting),
                remedy="Find out why, look at the unit on it, and clear the protection at its front panel.",
            )  # fmt: skip

    def _compare(self, now: Setting) -> None:
        if self._made is not None and wire.next_step(now, self._made):
            raise InstrumentFault(
                self.name, f"the supply was set to {_in_words(self._made)}", received=_in_words(now),
                remedy="Look for a trip, a power failure, or who else sets it.",
            )  # fmt: skip

    def _new_order(self) -> int:
        """Invalidates the running order."""
        self._order += 1
        self._made = None
        return self._order


def _in_words(setting: Setting) -> str:
    return f"{setting.level_v:g} V, limit {setting.limit_a:g} A, output {'on' if setting.output else 'off'}"


def _measured(state: State) -> str:
    return f"{state.voltage_v:g} V and {state.current_a:g} A"
