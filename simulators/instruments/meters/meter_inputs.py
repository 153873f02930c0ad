"""Inputs of simulated meters: a load that carries the current of a unit, or the cable of a source."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from drivers.dialects.keysight_3458a import wire
from simulators.physics.corrections import Table, read_of
from simulators.physics.source_errors import CurrentErrors
from simulators.physics.voltmeter import VoltmeterSettings
from simulators.world import World

PERFECT = CurrentErrors()
LOOK_S = 0.1  # interval of evaluation of a drifting current


class MeterInput(Protocol):
    """Input of a meter, and the meter's errors."""

    @property
    def function(self) -> wire.Function:
        """Quantity at the input."""

    @property
    def noise(self) -> float:
        """Standard deviation of a reading over 10 line cycles."""

    def mean(self, begin_s: float, end_s: float) -> float:
        """Mean of the quantity between true times."""

    def read(self, mean: float, at_s: float) -> float:
        """Reading of that mean, without noise."""


class VoltsOnLoad:
    """A load that carries the current of the unit in a place; `name` separates the noise of several meters."""

    function = wire.DC_VOLTS

    def __init__(self, world: World, settings: VoltmeterSettings, name: str) -> None:
        self.noise = settings.noise_v
        self._settings = settings
        self._unit = world.counted[settings.place] if settings.place else None
        self._unit_noise = self._unit.own_noise(name) if self._unit is not None else None
        self._looked_s = 0.0

    def mean(self, begin_s: float, end_s: float) -> float:
        """Mean voltage; the bias of the unit drifts between readings. A load without a unit carries no current."""
        if self._unit is None or self._unit_noise is None:
            return 0.0
        if begin_s > self._looked_s:
            self._unit_noise.pass_over(begin_s - self._looked_s)
        self._looked_s = end_s
        return self._unit.mean_volts(begin_s, end_s, self._unit_noise, self._settings.load_ohm)

    def read(self, mean: float, _at_s: float) -> float:
        """Reading with the errors of gain and offset."""
        return mean * (1 + self._settings.gain) + self._settings.offset_v


@dataclass(frozen=True, slots=True)
class CurrentInSeries:
    """The cable of a current source; the meter has the drawn errors less the corrections in `table`.

    `noise` is the standard deviation of a reading over 10 line cycles (A).
    """

    world: World
    source: str
    errors: CurrentErrors = PERFECT
    table: Table = ((), ())
    noise: float = 0.0
    function: wire.Function = wire.DC_CURRENT

    def mean(self, begin_s: float, end_s: float) -> float:
        """Mean current."""
        looks = 1 + math.ceil((end_s - begin_s) / LOOK_S)
        at_s = begin_s + (np.arange(looks) + 0.5) / looks * (end_s - begin_s)
        return float(self.world.source_a(self.source, at_s).mean())

    def read(self, mean: float, at_s: float) -> float:
        """Reading with the errors of gain, offset and drift."""
        with_errors = self.errors.current_a(mean, np.array([at_s]))
        return float(read_of(with_errors, self.table)[0])
