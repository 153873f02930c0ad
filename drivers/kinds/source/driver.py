"""A SCPI current source: a fixed range, every setting read back, off only at 0 A."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, Self, TypeVar

from drivers.description import Nothing, Setup
from drivers.errors import BeyondLimit, InstrumentFault, Refused
from drivers.kinds.ranges import SourceLimits
from drivers.kinds.source.setting import Commands, Setting, SourceState
from drivers.timing.readback import ReadBack
from drivers.transport.dialogue import safe_in_time
from drivers.transport.scpi import ScpiLink
from drivers.values import Identity, Reading, SourceReading

READ_BACK = ReadBack()
StateT = TypeVar("StateT", bound=SourceState)


class Fault(NamedTuple):
    """Something wrong with a source: in words, with what it said and what to do.

    `always` is for what matters with the output off as well.
    """

    problem: str
    received: str
    remedy: str
    always: bool = False


@dataclass(frozen=True)
class Dialect(Generic[StateT]):
    """How one make of source is spoken to: one question for its state, and the next command towards a setting.

    `read_back` is how long a setting may be told as it was before.
    """

    commands: Commands
    state_query: bytes
    read_state: Callable[[bytes], StateT]
    next_step: Callable[[StateT, Setting], str]
    faults: Callable[[StateT], Sequence[Fault]] = lambda _state: ()
    read_back: ReadBack = READ_BACK


@dataclass(frozen=True, slots=True)
class Bounds:
    """What the options of a bench file allow: one range, and levels and compliances (from, to)."""

    range_a: float
    most_a: float
    compliance_v: tuple[float, float]


class ScpiSource(Generic[StateT]):
    """One source; a Source of amperes.

    Every command is sent once and what it did is read back. Every poll compares the settings with the last ones sent:
    a second master is a fault, not a discussion.

    Concurrency: a new `set` and `make_safe` end the `set` under way, which then raises Refused.
    """

    def __init__(
        self, setup: Setup[Any, SourceLimits, Nothing], dialect: Dialect[StateT], bounds: Bounds, *, end: bytes = b"\n"
    ) -> None:
        self.name = setup.name
        self._limits, self._dialect, self._bounds = setup.limits, dialect, bounds
        self._link = ScpiLink(setup, end=end)
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
        state = await self._agreed_state()
        self._compare(state)
        return {"current": [Reading(asyncio.get_running_loop().time(), state.setting.flowing_a)]}

    async def read(self) -> SourceReading:
        """The level while the output is on, else 0; neither current nor voltage is measured."""
        setting = (await self._agreed_state()).setting
        return SourceReading(None, setting.flowing_a, setting.output)

    async def set(self, level: float, *, limit: float, output: bool) -> None:
        """Sets range, compliance (`limit`, V) and level (A), reads them back, then switches the output on.

        With `output` False only goes to 0 A and switches off. Raises BeyondLimit before anything is sent, Refused when
        the source does not take a setting, InstrumentFault for what its dialect tells of: an open interlock, a load
        that does not take the current, over-temperature.
        """
        if output:
            self._check_limits(level, limit)
        order = self._new_order()
        now = await self._state()
        if not output:
            self._made = (await self._reach(order, now, now.setting._replace(output=False))).setting
            return
        self._check_faults(now)
        now = await self._reach(order, now, Setting(self._bounds.range_a, level, limit, True))
        self._made = now.setting
        self._check_faults(now)

    async def make_safe(self) -> None:
        """Goes to 0 A, then switches the output off, within 5 s, proved by reading back.

        Raises NoAnswer or Refused when it cannot be proved; CannotConnect, WrongIdentity after a lost wire.
        """
        order = self._new_order()
        commands = self._dialect.commands
        async with safe_in_time(self.name):
            await self._link.reopen()
            self._link.cut_in(f"{commands.zero};{commands.off}")
            now = await self._state()
            self._made = (await self._reach(order, now, now.setting._replace(output=False))).setting

    async def _reach(self, order: int, now: StateT, wanted: Setting) -> StateT:
        """Sends one command after the other until the source says that it is set as wanted; that state."""
        sent = ""
        while step := self._dialect.next_step(now, wanted):
            if order != self._order:
                raise Refused(self.name, "the setting was ended by another command", sent=sent)
            if step == sent:
                raise Refused(
                    self.name, "a setting was not carried out", sent=sent, received=str(now.setting),
                    remedy="Look at the source: is it in local, in a sweep, or its interlock open?",
                )  # fmt: skip
            await self._link.write(step)
            sent, now = step, await self._state_after(order, step, wanted)
        return now

    async def _state_after(self, order: int, step: str, wanted: Setting) -> StateT:
        """The state once it shows that a step was executed, or at the time limit.

        At once if there is nothing to wait for.
        """
        return await self._dialect.read_back.until(
            self._state, lambda state: order != self._order or self._dialect.next_step(state, wanted) != step
        )

    async def _state(self) -> StateT:
        return await self._link.ask(self._dialect.state_query, self._dialect.read_state)

    async def _agreed_state(self) -> StateT:
        return await self._link.takes.agreed(
            "what the source is set to", self._state, spell=lambda state: state.setting
        )

    def _check_limits(self, level_a: float, compliance_v: float) -> None:
        allowed, bounds = self._limits.current, self._bounds
        for what, value, low, high, unit in (
            ("the level", level_a, max(allowed.min, -bounds.most_a), min(allowed.max, bounds.most_a), "A"),
            ("the compliance", compliance_v, *bounds.compliance_v, "V"),
        ):
            if not low <= value <= high:
                raise BeyondLimit(
                    self.name, f"{what} {value:g} {unit} is outside {low:g} {unit} to {high:g} {unit}",
                    remedy="Nothing was sent. Correct the sequence, or range, compliance and limits in the bench file.",
                )  # fmt: skip

    def _check_faults(self, state: StateT, *, output: bool = True) -> None:
        """Raises InstrumentFault for what is wrong, without `output` only for what always is."""
        found = [fault for fault in self._dialect.faults(state) if output or fault.always]
        if found:
            raise InstrumentFault(
                self.name, ", ".join(fault.problem for fault in found), received=found[0].received,
                remedy=" ".join(fault.remedy for fault in found),
            )  # fmt: skip

    def _compare(self, state: StateT) -> None:
        """Raises when a fault is there that matters now, or when the setting is not the one that was made."""
        made = self._made
        self._check_faults(state, output=made is not None and made.output)
        if made is not None and self._dialect.next_step(state, made):
            raise InstrumentFault(
                self.name, f"the source was set to {made}", received=str(state.setting),
                remedy="Look for a trip, a power failure, or who else sets it.",
            )  # fmt: skip

    def _new_order(self) -> int:
        """Invalidates the running order."""
        self._order += 1
        self._made = None
        return self._order
