"""The pulse counter: latches the units' converters on its own time base and sends frames by itself.

It is worked out lazily: a block of frames comes into being when somebody takes it, or just before a stimulus changes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drivers.can_counter.wire import CounterFormat, encode_frames
from drivers.dbc import Dbc
from drivers.frame_block import FrameBlock
from simulators.faults import FaultPlan
from simulators.unit_file import stream
from simulators.uut import Integrator
from simulators.world import SimulatedUnit, World

Array = NDArray[np.float64]
TEMPERATURE_PERIOD_S = 1.0
BOARD_C = 25.0


@dataclass(frozen=True, slots=True)
class CounterSettings:
    """A counter as its bench file describes it. `readings` are the temperature signals by the place they belong to."""

    dbc: Dbc
    form: CounterFormat
    period_s: float
    readings: Mapping[str, str] = field(default_factory=dict)


class SimulatedCounter:
    """A counter on the world's units; a frame link whose frames are those it has sent.

    A channel with a place counts what that unit's converter fires; one without counts nothing.
    """

    def __init__(self, world: World, settings: CounterSettings, faults: FaultPlan) -> None:
        self.faults = faults
        self._world, self._settings = world, settings
        self._rate = 1 + world.settings.device_clock  # device seconds in a true second
        draws = stream(world.settings.seed, "counter", "start")
        self._tick0 = int(draws.integers(0, 1 << 32))
        self._sequence0 = int(draws.integers(0, 1 << 16))
        self._latch = 0  # how many latches have been made
        self._edges_s = world.now()  # the last latch in true time
        self._units: dict[str, SimulatedUnit] = {unit.settings.channel: unit for unit in world.units.values()}
        self._integrators = {
            channel: Integrator(float(draws.uniform(0, 1)), int(draws.integers(0, 1 << 20)), int(draws.integers(0, 99)))
            for channel in settings.form.channels
        }
        self._origin_s = self._edges_s
        self._sent: list[FrameBlock] = []
        self._warmth_latches = max(1, round(TEMPERATURE_PERIOD_S / settings.period_s))
        world.integrate_with(self._catch_up)

    def take(self) -> FrameBlock:
        """Every frame sent since the last call."""
        self._world.look()
        self._catch_up()
        sent, self._sent = self._sent, []
        return FrameBlock.empty() if self.faults.active("silent") else FrameBlock.joined(sent)

    def close(self) -> None:
        """Nobody listens any more; the counter does not care."""

    def _catch_up(self) -> None:
        """Makes the latches that are due."""
        period_s = self._settings.period_s / self._rate
        due = math.floor((self._world.now() - self._origin_s) / period_s) - self._latch
        if due <= 0:
            return
        numbers = np.arange(self._latch + 1, self._latch + due + 1)
        at_s = self._origin_s + numbers * period_s
        edges_s = np.concatenate(([self._edges_s], at_s))
        self._latch, self._edges_s = self._latch + due, float(at_s[-1])
        self._sent.append(self._frames(numbers, edges_s))

    def _frames(self, numbers: NDArray[np.int64], edges_s: Array) -> FrameBlock:
        form, at_s = self._settings.form, edges_s[1:]
        tick_s = form.tick_period_s
        ticks = self._tick0 + np.rint((at_s - self._origin_s) * (self._rate / tick_s)).astype(np.int64)
        sequence = self._sequence0 + numbers
        if self.faults.active("frozen"):
            sequence = np.full_like(sequence, self._sequence0)
        values: dict[str, dict[str, NDArray[np.int64]]] = {}

        def put(message: str, signal: str, integers: NDArray[np.int64]) -> None:
            values.setdefault(message, {})[signal] = integers

        put(form.tick.message.name, form.tick.signal.name, ticks)
        put(form.sequence.message.name, form.sequence.signal.name, sequence)
        for name, channel in form.channels.items():
            positive, negative = self._counts(name, edges_s)
            put(channel.positive.message.name, channel.positive.signal.name, positive)
            put(channel.negative.message.name, channel.negative.signal.name, negative)
            put(channel.sequence.message.name, channel.sequence.signal.name, sequence)
        host_s = self._world.host_time(at_s)
        frames = FrameBlock.joined([encode_frames(self._settings.dbc, host_s, values), self._warmth(numbers, at_s)])
        order = np.argsort(frames.at_s, kind="stable")
        return FrameBlock(frames.ids[order], frames.at_s[order], frames.dlc[order], frames.data[order])

    def _counts(self, channel: str, edges_s: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        integrator, unit = self._integrators[channel], self._units.get(channel)
        if unit is not None:
            return integrator.count(unit.charge_pulses(edges_s))
        latches = len(edges_s) - 1
        return np.full(latches, integrator.positive), np.full(latches, integrator.negative)

    def _warmth(self, numbers: NDArray[np.int64], at_s: Array) -> FrameBlock:
        """One frame of each temperature message a second; a signal without a unit shows the converter's board."""
        at_s = at_s[numbers % self._warmth_latches == 0]
        values: dict[str, dict[str, NDArray[np.int64]]] = {}
        for name, reading in self._settings.form.temperatures.items():
            place = self._settings.readings.get(name)
            celsius = self._world.units[place].thermometer_c(at_s) if place else np.full(len(at_s), BOARD_C)
            raw = np.rint((celsius - reading.signal.offset) / reading.signal.scale).astype(np.int64)
            values.setdefault(reading.message.name, {})[reading.signal.name] = raw
        return encode_frames(self._settings.dbc, self._world.host_time(at_s), values)
