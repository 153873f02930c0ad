"""A Yokogawa GS200 as a current source."""

from __future__ import annotations

from collections.abc import Sequence

from drivers.description import Nothing, Setup
from drivers.dialects.yokogawa_gs200 import wire
from drivers.dialects.yokogawa_gs200.description import GS200Options
from drivers.dialects.yokogawa_gs200.wire import State
from drivers.errors import BeyondLimit
from drivers.kinds.ranges import SourceLimits
from drivers.kinds.source.driver import Bounds, ScpiSource
from drivers.kinds.source.output import Dialect, Fault


def _faults(state: State) -> Sequence[Fault]:
    """Faults: voltage mode instead of current, and the content of the condition register."""
    received = f"condition {int(state.condition)}"
    found = []
    if state.function != "CURR" and state.setting.output:
        found.append(Fault("it is in voltage mode", "VOLT", "Make it safe, and find the other master.", always=True))
    if state.condition & wire.LIMITING:
        remedy = "Check the load, its cable, and the compliance."
        found.append(Fault("it is at its voltage limit: the load does not take the current", received, remedy))
    if wire.Condition.EMERGENCY in state.condition:
        remedy = "Its protection has tripped: read its display and its manual."
        found.append(Fault("it reports an emergency", received, remedy, always=True))
    return found


DIALECT = Dialect(wire.COMMANDS.cut_off, wire.STATE_QUERY, wire.read_state, wire.next_step, _faults)


class YokogawaGS200(ScpiSource[State]):
    """One source; it measures neither current nor voltage, and detects a load that does not take the current."""

    def __init__(self, setup: Setup[GS200Options, SourceLimits, Nothing]) -> None:
        range_a = setup.options.range
        bounds = Bounds(range_a, wire.max_a(range_a), (wire.COMPLIANCE_MIN_V, setup.options.compliance))
        super().__init__(setup, DIALECT, bounds)

    async def set(self, level: float, *, limit: float, output: bool) -> None:
        """As ScpiSource.set; BeyondLimit also for a compliance that is not in whole volts."""
        if output and limit % wire.COMPLIANCE_STEP_V:
            raise BeyondLimit(
                self.name, f"the compliance {limit:g} V is not in whole volts",
                remedy="Nothing was sent. Correct the sequence.",
            )  # fmt: skip
        await super().set(level, limit=limit, output=output)
