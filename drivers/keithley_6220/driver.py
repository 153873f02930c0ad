"""A Keithley 6220 or 6221 current source: a fixed range, every setting read back, off only at 0 A."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Self

from drivers.description import Nothing, Setup
from drivers.errors import BeyondLimit, InstrumentFault, Refused
from drivers.keithley_6220 import wire
from drivers.keithley_6220.description import KeithleyOptions
from drivers.keithley_6220.wire import Condition, Setting, State
from drivers.ranges import SourceLimits
from drivers.transport.dialogue import safe_in_time
from drivers.transport.scpi import ScpiLink
from drivers.values import Identity, Reading, SourceReading

_FAULTS = {
    Condition.INTERLOCK: ("its interlock is open", "Close the interlock at the rear connector."),
    Condition.OVER_TEMPERATURE: ("it is too hot", "Let it cool down and clear its air inlets."),
    Condition.COMPLIANCE: (
        "it is in compliance: the load does not take the current", "Check the load, its cable, and the compliance.",
    ),
}  # fmt: skip


class Keithley6220:
    """One source; a Source of amperes.

    Every command is sent once and what it did is read back. Every look compares the settings with those last made:
    a second master is a fault, not a discussion.

    Concurrency: a new `set` and `make_safe` end the `set` under way, which then raises Refused.
    """

    def __init__(self, setup: Setup[KeithleyOptions, SourceLimits, Nothing]) -> None:
        self.name = setup.name
        self._options, self._limits = setup.options, setup.limits
        self._link = ScpiLink(setup, end=wire.TERMINATORS[setup.options.terminator])
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
        """The current that flows; InstrumentFault when the source has a fault or is no longer set as it was."""
        state = await self._state()
        self._compare(state)
        return {"current": [Reading(asyncio.get_running_loop().time(), _flowing_a(state.setting))]}

    async def read(self) -> SourceReading:
        """The level while the output is on, else 0; a 6220 measures neither current nor voltage."""
        setting = (await self._state()).setting
        return SourceReading(None, _flowing_a(setting), setting.output)

    async def set(self, level: float, *, limit: float, output: bool) -> None:
        """Sets range, compliance (`limit`, V) and level (A), reads them back, then switches the output on.

        With `output` False only goes to 0 A and switches off. Raises BeyondLimit before anything is sent, Refused when
        the source does not take a setting, InstrumentFault for an open interlock, a load that does not take the
        current, or over-temperature.
        """
        if output:
            self._check_limits(level, limit)
        order = self._new_order()
        now = await self._state()
        if not output:
            self._made = (await self._reach(order, now, replace(now.setting, output=False))).setting
            return
        self._check_faults(now)
        now = await self._reach(order, now, Setting(self._options.range, level, limit, True))
        self._made = now.setting
        self._check_faults(now)

    async def make_safe(self) -> None:
        """Goes to 0 A, then switches the output off, within 5 s, proved by reading back.

        Raises NoAnswer or Refused when it cannot be proved; CannotConnect, WrongIdentity after a lost wire.
        """
        order = self._new_order()
        async with safe_in_time(self.name):
            await self._link.reopen()
            self._link.cut_in(f"{wire.ZERO};{wire.OFF}")
            now = await self._state()
            self._made = (await self._reach(order, now, replace(now.setting, output=False))).setting

    async def _reach(self, order: int, now: State, wanted: Setting) -> State:
        """Sends one command after the other until the source says that it is set as wanted; that state."""
        sent = ""
        while step := wire.next_step(now, wanted):
            if order != self._order:
                raise Refused(self.name, "the setting was ended by another command", sent=sent)
            if step == sent:
                raise Refused(
                    self.name, "a setting was not carried out", sent=sent, received=_in_words(now.setting),
                    remedy="Look at the source: is it in local, in a sweep, or its interlock open?",
                )  # fmt: skip
            await self._link.write(step)
            sent, now = step, await self._state()
        return now

    async def _state(self) -> State:
        return await self._link.ask(wire.STATE_QUERY, wire.read_state)

    def _check_limits(self, level_a: float, compliance_v: float) -> None:
        options, allowed = self._options, self._limits.current
        most_a = wire.OVER_RANGE * options.range
        for what, value, low, high, unit in (
            ("the level", level_a, max(allowed.min, -most_a), min(allowed.max, most_a), "A"),
            ("the compliance", compliance_v, wire.COMPLIANCE_MIN_V, options.compliance, "V"),
        ):
            if not low <= value <= high:
                raise BeyondLimit(
                    self.name, f"{what} {value:g} {unit} is outside {low:g} {unit} to {high:g} {unit}",
                    remedy="Nothing was sent. Correct the sequence, or range, compliance and limits in the bench file.",
                )  # fmt: skip

    def _check_faults(self, state: State) -> None:
        found = [words for bit, words in _FAULTS.items() if bit in state.condition]
        if found:
            raise InstrumentFault(
                self.name, ", ".join(problem for problem, _ in found),
                received=f"measurement condition {int(state.condition)}", remedy=" ".join(help_ for _, help_ in found),
            )  # fmt: skip

    def _compare(self, state: State) -> None:
        """Raises when a fault is there that matters now, or when the setting is not the one that was made."""
        made = self._made
        if (made is not None and made.output) or Condition.OVER_TEMPERATURE in state.condition:
            self._check_faults(state)
        if made is not None and wire.next_step(state, made):
            raise InstrumentFault(
                self.name, f"the source was set to {_in_words(made)}", received=_in_words(state.setting),
                remedy="Look for a trip, a power failure, or who else sets it.",
            )  # fmt: skip

    def _new_order(self) -> int:
        """Ends what is under way: it finds itself no longer wanted."""
        self._order += 1
        self._made = None
        return self._order


def _flowing_a(setting: Setting) -> float:
    return setting.level_a if setting.output else 0.0


def _in_words(setting: Setting) -> str:
    return (
        f"{setting.level_a:g} A in the {setting.range_a:g} A range, compliance {setting.compliance_v:g} V, "
        f"output {'on' if setting.output else 'off'}"
    )
