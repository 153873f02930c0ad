"""Everything that a simulated instrument is constructed from.

A driver's description names the class of its simulator, `module:Class`; the class has `of(setup)`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from drivers.installed import loaded
from simulators.faults.instrument_faults import FaultPlan
from simulators.serving.serve import Instrument
from simulators.world import World


class NotSimulated(ValueError):
    """A bench, or a way to use an instrument, that its simulator does not cover."""


@dataclass(frozen=True, slots=True)
class InstrumentSetup:
    """One device of a bench file, as given to its simulator.

    `options` is the driver's own model. `model` and `serial` are those stated in the bench file, "" if not stated.
    `axis` is the role if the device drives an axis of the table, else None.
    """

    role: str
    world: World
    faults: FaultPlan
    options: Any
    model: str = ""
    serial: str = ""
    is_serial_line: bool = False
    axis: str | None = None


def make_instrument(target: str, setup: InstrumentSetup) -> Instrument:
    """Create the simulator at `module:Class`; imports its module."""
    of: Callable[[InstrumentSetup], Instrument] = loaded(target).of
    return of(setup)
