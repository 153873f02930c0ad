"""A SCPI current source: a fixed range, every setting read back, off only at 0 A."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

from drivers.description import Nothing, Setup
from drivers.errors import BeyondLimit
from drivers.kinds.ranges import SourceLimits
from drivers.kinds.source.output import Dialect, OutputState, ScpiOutput
from drivers.kinds.source.setting import Setting
from drivers.values import Reading, SourceReading

StateT = TypeVar("StateT", bound=OutputState[Setting])


class Bounds(NamedTuple):
    """Limits from the options of a bench file: one range, and levels and compliances (from, to)."""

    range_a: float
    max_a: float
    compliance_v: tuple[float, float]


class ScpiSource(ScpiOutput[StateT, Setting]):
    """One source; a Source of amperes. It is switched off only at 0 A."""

    _kind = "source"
    _stuck = "Look at the source: is it in local, in a sweep, or its interlock open?"

    def __init__(
        self, setup: Setup[Any, SourceLimits, Nothing], dialect: Dialect[StateT, Setting], bounds: Bounds, *,
        end: bytes = b"\n",
    ) -> None:  # fmt: skip
        super().__init__(setup, dialect, end=end)
        self._limits, self._bounds = setup.limits, bounds

    async def poll(self) -> Mapping[str, Sequence[Reading]]:
        """Output current; InstrumentFault if the source has a fault or settings have changed."""
        state = await self._confirmed_state()
        self._compare(state)
        return {"current": [Reading(asyncio.get_running_loop().time(), state.setting.flowing_a)]}

    async def read(self) -> SourceReading:
        """Level while the output is on, else 0; neither current nor voltage is measured."""
        setting = (await self._confirmed_state()).setting
        return SourceReading(None, setting.flowing_a, setting.output)

    async def set(self, level: float, *, limit: float, output: bool) -> None:
        """Set range, compliance (`limit`, V) and level (A), read them back, then switch the output on.

        With `output` False it only goes to 0 A and switches off. Raises BeyondLimit before anything is sent, Refused if
        a setting is rejected, InstrumentFault for the faults of its dialect: an open interlock, a load that does not
        take the current, over-temperature.
        """
        if output:
            self._check_limits(level, limit)
        order = self._latest.begin()
        now = await self._state()
        if output:
            self._check_faults(now)
            now = await self._reach(order, now, Setting(self._bounds.range_a, level, limit, True))
            self._check_faults(now)
        else:
            await self._switch_off(order, now)
        order.check()

    async def _confirmed_state(self) -> StateT:
        return await self._link.double_read.confirmed(
            "what the source is set to", self._state, describe=lambda state: state.setting
        )

    def _check_limits(self, level_a: float, compliance_v: float) -> None:
        allowed, bounds = self._limits.current, self._bounds
        for what, value, low, high, unit in (
            ("the level", level_a, max(allowed.min, -bounds.max_a), min(allowed.max, bounds.max_a), "A"),
            ("the compliance", compliance_v, *bounds.compliance_v, "V"),
        ):
            if not low <= value <= high:
                raise BeyondLimit(
                    self.name, f"{what} {value:g} {unit} is outside {low:g} {unit} to {high:g} {unit}",
                    remedy="Nothing was sent. Correct the sequence, or range, compliance and limits in the bench file.",
                )  # fmt: skip
