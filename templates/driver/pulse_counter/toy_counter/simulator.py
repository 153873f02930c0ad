"""The simulated counter: it latches the converters of the simulated units, and sends unsolicited."""

from __future__ import annotations

import math
from typing import Self

import numpy as np
from drivers.can.frame_block import FrameBlock
from drivers.can.sequence_numbers import Integers
from numpy.typing import NDArray
from simulators.instruments.can_nodes.can_node import CanNode, NodeSetup, in_order
from simulators.physics.integrator import Integrator

from toy_counter import wire
from toy_counter.description import TEMPERATURE, TICK_S, ToyCounterOptions

Array = NDArray[np.float64]
BOARD_C = 25.0


class SimulatedToyCounter(CanNode):
    """Counts the pulses of the unit on a channel; a channel without a unit counts nothing.

    Frames are computed when they are taken, and just before the stimulus of the units changes.
    """

    def __init__(self, setup: NodeSetup) -> None:
        super().__init__(setup.role, setup.world, setup.faults)
        options: ToyCounterOptions = setup.options
        self._options, self._thermometer_of = options, setup.readings.get(TEMPERATURE)
        self._latch_s = options.period / (1 + self._world.settings.device_clock)  # true seconds
        self._units = setup.units
        self._restarts = self._shown = 0
        self._begin(self._world.now())
        self._world.integrate_with(self._before_change)

    @classmethod
    def of(cls, setup: NodeSetup) -> Self:
        """Create from a bench file."""
        return cls(setup)

    def _begin(self, at_s: float) -> None:
        """Power-on: the clock, the latches and the counts start at 0."""
        self._origin_s = self._counted_s = at_s
        self._latch = 0
        self._owed = dict.fromkeys(self._options.inputs, 0.0)  # pulses before a change of stimulus
        self._converters = {channel: Integrator(0.5, 0, 0) for channel in self._options.inputs}

    def _before_change(self) -> None:
        now_s = self._world.now()
        self._catch_up()
        if now_s > self._counted_s:
            for channel in self._units:
                self._owed[channel] += float(self._pulses(channel, np.array([self._counted_s, now_s]))[0])
            self._counted_s = now_s

    def _catch_up(self) -> None:
        """Send the latches that are due."""
        if self.faults.times("restart") > self._restarts:
            self._restarts += 1
            self._begin(self._counted_s)
        due = math.floor((self._world.now() - self._origin_s) / self._latch_s) - self._latch
        if due <= 0:
            return
        numbers = np.arange(self._latch + 1, self._latch + due + 1, dtype=np.int64)
        at_s = self._origin_s + numbers * self._latch_s
        edges_s = np.concatenate(([self._counted_s], at_s))
        self._latch, self._counted_s = self._latch + due, float(at_s[-1])
        self._sent.append(self._frames(numbers, edges_s))

    def _frames(self, numbers: Integers, edges_s: Array) -> FrameBlock:
        host_s = self._world.host_time(edges_s[1:])
        shown = np.full_like(numbers, self._shown) if self.faults.active("frozen") else numbers
        self._shown = int(shown[-1])
        ticks = np.rint(shown * (self._options.period / TICK_S)).astype(np.int64)
        sent = []
        for channel, number in self._options.inputs.items():
            pulses = self._pulses(channel, edges_s)
            pulses[0] += self._owed[channel]
            self._owed[channel] = 0.0
            positive, negative = self._converters[channel].count(pulses)
            values = {wire.NUMBER: shown, wire.TICK: ticks, wire.POSITIVE: positive, wire.NEGATIVE: negative}
            sent.append(wire.latch_frames(wire.latch(number), host_s, values))
        every = max(1, round(1.0 / self._options.period))
        warm_s = edges_s[1:][numbers % every == 0]
        sent.append(wire.temperature_frames(self._world.host_time(warm_s), self._celsius(warm_s)))
        return in_order(sent)

    def _pulses(self, channel: str, edges_s: Array) -> Array:
        """Charge of a channel in each interval, in pulses."""
        unit = self._units.get(channel)
        return np.zeros(len(edges_s) - 1) if unit is None else unit.charge_pulses(edges_s)

    def _celsius(self, at_s: Array) -> Array:
        """Thermometer reading: at a unit if the bench file assigns it to a place, else on the board."""
        if self._thermometer_of is None:
            return np.full(len(at_s), BOARD_C)
        return self._world.counted[self._thermometer_of].thermometer_c(at_s)
