"""A Keithley 6220 or 6221 current source."""

from __future__ import annotations

from collections.abc import Sequence

from drivers.description import Nothing, Setup
from drivers.dialects.keithley_6220 import wire
from drivers.dialects.keithley_6220.description import KeithleyOptions
from drivers.dialects.keithley_6220.wire import Condition, State
from drivers.kinds.ranges import SourceLimits
from drivers.kinds.source.driver import Bounds, ScpiSource
from drivers.kinds.source.output import Dialect, Fault

_FAULTS = {
    Condition.INTERLOCK: ("its interlock is open", "Close the interlock at the rear connector."),
    Condition.OVER_TEMPERATURE: ("over-temperature", "Let it cool down and clear its air inlets."),
    Condition.COMPLIANCE: (
        "it is in compliance: the load does not take the current", "Check the load, its cable, and the compliance.",
    ),
}  # fmt: skip


def _faults(state: State) -> Sequence[Fault]:
    """Faults in the measurement condition; over-temperature is one with the output off, too."""
    received = f"measurement condition {int(state.condition)}"
    return [
        Fault(problem, received, remedy, always=bit is Condition.OVER_TEMPERATURE)
        for bit, (problem, remedy) in _FAULTS.items()
        if bit in state.condition
    ]


DIALECT = Dialect(wire.COMMANDS.cut_off, wire.STATE_QUERY, wire.read_state, wire.next_step, _faults)


class Keithley6220(ScpiSource[State]):
    """One source; it measures neither current nor voltage, and detects a load that does not take the current."""

    def __init__(self, setup: Setup[KeithleyOptions, SourceLimits, Nothing]) -> None:
        options = setup.options
        bounds = Bounds(options.range, wire.OVER_RANGE * options.range, (wire.COMPLIANCE_MIN_V, options.compliance))
        super().__init__(setup, DIALECT, bounds, end=wire.TERMINATORS[options.terminator])
