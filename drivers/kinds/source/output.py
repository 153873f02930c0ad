"""An output that is set over SCPI, command by command until it is as wanted, and monitored from then on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, NamedTuple, Protocol, Self, TypeVar

from drivers.description import Setup
from drivers.errors import InstrumentFault, Refused
from drivers.kinds.latest import Latest, Order
from drivers.timing.readback import read_back
from drivers.transport.dialogue import safe_in_time
from drivers.transport.scpi import ScpiLink
from drivers.values import Identity


class OutputSetting(Protocol):
    """Setting of an output; its `str` is for messages."""

    @property
    def output(self) -> bool:
        """True if the output is on."""

    def switched_off(self) -> Self:
        """The same with the output off."""


SettingT = TypeVar("SettingT", bound=OutputSetting)
SettingT_co = TypeVar("SettingT_co", bound=OutputSetting, covariant=True)


class OutputState(Protocol[SettingT_co]):
    """State of an instrument: the setting of its output, and further values of its dialect."""

    @property
    def setting(self) -> SettingT_co:
        """Setting of the output."""


StateT = TypeVar("StateT", bound=OutputState[Any])


class Fault(NamedTuple):
    """A fault of an output: text, the instrument's status, and the remedy.

    `always` marks faults that matter with the output off, too.
    """

    problem: str
    received: str
    remedy: str
    always: bool = False


@dataclass(frozen=True)
class Dialect(Generic[StateT, SettingT]):
    """Commands of one make: cut-off, state query, and the next command on the way to a setting."""

    cut_off: str
    state_query: bytes
    read_state: Callable[[bytes], StateT]
    next_step: Callable[[StateT, SettingT], str]
    faults: Callable[[StateT], Sequence[Fault]] = lambda _state: ()


class ScpiOutput(Generic[StateT, SettingT]):
    """Common part of all Sources.

    `_kind` is its name in messages, `_stuck` the advice if a setting is not executed.

    Every command is sent once and read back. Every poll compares the settings with the last ones sent: a second master
    is a fault and is not overridden.

    Concurrency: a new `set` and `make_safe` supersede the running `set`, which then raises Refused.
    """

    _kind: ClassVar[str]
    _stuck: ClassVar[str]

    def __init__(self, setup: Setup[Any, Any, Any], dialect: Dialect[StateT, SettingT], *, end: bytes = b"\n") -> None:
        self.name, self._dialect = setup.name, dialect
        self._link = ScpiLink(setup, end=end)
        self._latest: Latest[SettingT] = Latest(setup.name, "setting")  # setting that was read back

    async def __aenter__(self) -> Self:
        """Connect and identify; raises CannotConnect or WrongIdentity."""
        await self._link.open()
        return self

    async def __aexit__(self, *exc: object) -> None:
        """Close the wire; the output stays as it is."""
        self._link.close()

    async def identify(self) -> Identity:
        """Query the identity by *IDN?; raises WrongIdentity."""
        return await self._link.identify()

    async def make_safe(self) -> None:
        """Switch the output off within 5 s, after a source has gone to 0 A, proved by reading back.

        Raises NoAnswer or Refused if it cannot be proved; CannotConnect, WrongIdentity after a lost wire.
        """
        order = self._latest.begin()
        async with safe_in_time(self.name):
            await self._link.reopen()
            self._link.preempt(self._dialect.cut_off)
            await self._switch_off(order, await self._state())

    async def _switch_off(self, order: Order, now: StateT) -> None:
        await self._reach(order, now, now.setting.switched_off())

    async def _reach(self, order: Order, now: StateT, wanted: SettingT) -> StateT:
        """Send one command after the other until the instrument reports the wanted setting; return that state."""
        sent = ""
        while step := self._dialect.next_step(now, wanted):
            order.check(sent)
            if step == sent:
                raise Refused(
                    self.name, "a setting was not executed", sent=sent, received=str(now.setting),
                    remedy=self._stuck,
                )  # fmt: skip
            await self._link.write(step)
            sent, now = step, await self._state_after(order, step, wanted)
        self._latest.done(order, now.setting)
        return now

    async def _state_after(self, order: Order, step: str, wanted: SettingT) -> StateT:
        """The state once it shows that a step was executed, or at the time limit.

        At once if there is nothing to wait for.
        """
        return await read_back(self._state, lambda state: order.ended or self._dialect.next_step(state, wanted) != step)

    async def _state(self) -> StateT:
        return await self._link.query(self._dialect.state_query, self._dialect.read_state)

    def _check_faults(self, state: StateT, *, output: bool = True) -> None:
        """Raise InstrumentFault for a fault; without `output` only for those that always matter."""
        found = [fault for fault in self._dialect.faults(state) if output or fault.always]
        if found:
            raise InstrumentFault(
                self.name, ", ".join(fault.problem for fault in found), received=found[0].received,
                remedy=" ".join(fault.remedy for fault in found),
            )  # fmt: skip

    def _compare(self, state: StateT) -> None:
        """Raise if there is a relevant fault, or if the setting is not the last one made."""
        made = self._latest.result
        self._check_faults(state, output=made is not None and made.output)
        if made is not None and self._dialect.next_step(state, made):
            raise InstrumentFault(
                self.name, f"the {self._kind} was set to {made}", received=str(state.setting),
                remedy="Look for a trip, a power failure, or another master.",
            )  # fmt: skip
