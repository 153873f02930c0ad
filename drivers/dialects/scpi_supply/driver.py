"""A laboratory power supply: sets, reads back, and monitors its settings."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from functools import partial

from drivers.description import Nothing, Setup
from drivers.dialects.scpi_supply import wire
from drivers.dialects.scpi_supply.description import SupplyLimits, SupplyOptions
from drivers.dialects.scpi_supply.wire import Setting, State
from drivers.errors import BeyondLimit
from drivers.kinds.source.output import Dialect, Fault, ScpiOutput
from drivers.values import Reading, SourceReading


class ScpiSupply(ScpiOutput[State, Setting]):
    """One output; a Source of volts."""

    _kind = "supply"
    _stuck = "Look at the supply: is it locked, tripped, or limited below this setting?"

    def __init__(self, setup: Setup[SupplyOptions, SupplyLimits, Nothing]) -> None:
        self._limits, self._options, self._note = setup.limits, setup.options, setup.note
        self._watchdog_s = float(round(setup.options.watchdog or 0))
        trips, watched = tuple(trip for trip in wire.TRIPS if trip in setup.options.answers), bool(self._watchdog_s)
        super().__init__(setup, Dialect(
            wire.OFF, wire.state_query(trips, watchdog=watched),
            partial(wire.read_state, trips=trips, watchdog=watched),
            lambda state, wanted: wire.next_step(state.setting, wanted), _trips,
        ))  # fmt: skip

    async def poll(self) -> Mapping[str, Sequence[Reading]]:
        """Measured voltage and current; InstrumentFault after a trip, or if settings have changed.

        No reading if two takes differ: the output is changing, or an answer was corrupted.
        """
        *before, state = await self._read_states()
        self._compare(state)
        for earlier in before:
            if not wire.steady(earlier, state):
                self._note(f"{_measured(earlier)} were reported, then {_measured(state)}: no reading")
                return {"voltage": [], "current": []}
        now_s = asyncio.get_running_loop().time()
        return {"voltage": [Reading(now_s, state.voltage_v)], "current": [Reading(now_s, state.current_a)]}

    async def read(self) -> SourceReading:
        """Read voltage, current and output state."""
        *_, state = await self._read_states()
        return SourceReading(state.voltage_v, state.current_a, state.setting.output)

    async def set(self, level: float, *, limit: float, output: bool) -> None:
        """Set the current limit (A) and the level (V), read both back, then switch the output on.

        With `output` False it only switches off; level and limit stay. Raises BeyondLimit before anything is sent,
        Refused if a setting is rejected, InstrumentFault if a protection has tripped.
        """
        if output:
            self._check_limits(level, limit)
        order = self._latest.begin()
        now = await self._state()
        if output:
            self._check_faults(now)
            await self._check_maximum(level, limit)
            await self._reach(order, now, Setting(level, limit, True, self._watchdog_s))
        else:
            await self._switch_off(order, now)
        order.check()

    async def _read_states(self) -> list[State]:
        """States of the supply, until two have the same setting."""
        reads: list[State] = []

        async def read_state() -> State:
            reads.append(await self._state())
            return reads[-1]

        await self._link.double_read.confirmed(
            "what the supply is set to", read_state, agree=lambda one, other: one.setting == other.setting,
            describe=lambda state: state.setting,
        )  # fmt: skip
        return reads

    def _check_limits(self, level_v: float, limit_a: float) -> None:
        remedy = "Nothing was sent. Correct the sequence, or the limits in the bench file."
        self._check_within(level_v, limit_a, (self._limits.voltage.max, self._limits.current.max), remedy)

    async def _check_maximum(self, level_v: float, limit_a: float) -> None:
        """Raise BeyondLimit for a setting beyond the instrument's own maximum, if it reports that."""
        if "maximum" in self._options.answers:
            maximum = await self._link.query(wire.MAXIMUM_QUERY, wire.read_maximum)
            remedy = "Nothing was set: this is the supply's own maximum. Correct the sequence, or use another supply."
            self._check_within(level_v, limit_a, maximum, remedy)

    def _check_within(self, level_v: float, limit_a: float, maximum: tuple[float, float], remedy: str) -> None:
        wanted = (("the level", level_v, "V"), ("the current limit", limit_a, "A"))
        for (what, value, unit), highest in zip(wanted, maximum, strict=True):
            if not 0 <= value <= highest:
                problem = f"{what} {value:g} {unit} is outside 0 {unit} to {highest:g} {unit}"
                raise BeyondLimit(self.name, problem, remedy=remedy)


def _trips(state: State) -> Sequence[Fault]:
    """Names of the tripped protections."""
    if not state.tripped:
        return ()
    names = " and ".join(trip.replace("_", "-") for trip in state.tripped)
    remedy = "Find out why, look at the unit on it, and clear the protection at its front panel."
    return (Fault(f"its {names} protection has tripped", str(state.setting), remedy, always=True),)


def _measured(state: State) -> str:
    return f"{state.voltage_v:g} V and {state.current_a:g} A"
