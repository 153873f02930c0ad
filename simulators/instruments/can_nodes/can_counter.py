"""The pulse counter: latches the units' converters on its own time base and sends frames unsolicited."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from drivers.can.dbc import Dbc, Field, dbc_in, encode_frames
from drivers.can.frame_block import FrameBlock
from drivers.certificates.corrections import ARCSEC_PER_DEG
from drivers.dialects.can_counter.decoder import format_of
from drivers.dialects.can_counter.options import CounterOptions
from drivers.dialects.can_counter.wire import CounterFormat
from simulators.faults.instrument_faults import PASSIVE_FAULT, FaultEffect, FaultKind
from simulators.instruments.can_nodes.can_node import (
    TEMPERATURE_PERIOD_S,
    CanNode,
    NodeSetup,
    Source,
    in_order,
    temperature_frames,
)
from simulators.physics.integrator import Counts, Integrator
from simulators.units.unit_file import stream

Array = NDArray[np.float64]
BOARD_C = 25.0


class SimulatedCounter(CanNode):
    """A counter on the world's units.

    A channel with a place counts the pulses of that unit's converter; one without counts nothing.
    """

    FAULT_EFFECTS: ClassVar[Mapping[FaultKind, FaultEffect]] = {
        **CanNode.FAULT_EFFECTS, "stuck_count": PASSIVE_FAULT, "cleared_count": PASSIVE_FAULT,
    }  # fmt: skip

    def __init__(self, setup: NodeSetup, dbc: Dbc, form: CounterFormat) -> None:
        super().__init__(setup.role, setup.world, setup.faults)
        self._setup, self._dbc, self._form = setup, dbc, form
        options: CounterOptions = setup.options
        self._period_s = options.period
        self._per_deg = {device: ARCSEC_PER_DEG / each.resolution for device, each in options.positions.items()}
        world = setup.world
        self._latch_s = self._period_s / (1 + world.settings.device_clock)  # true seconds between two latches
        draws = stream(world.settings.seed, "counter", "start")
        self._tick0 = int(draws.integers(0, 1 << 32))
        self._sequence0 = int(draws.integers(0, 1 << 16))
        self._boots = 0
        self._latch = self._shown = 0  # number of the last latch, and the one last sent in frames
        self._origin_s = self._counted_s = world.now()  # true time of latch 0, and time up to which pulses are counted
        self._units: dict[str, Source] = {
            unit.settings.channel: unit for unit in world.counted.values() if unit.settings.channel
        }
        for imu in world.imus.values():
            self._units |= {name: unit for name, unit in imu.channels.items() if name in form.channels}
        self._converters = {
            name: Integrator(draws.uniform(0, 1), int(draws.integers(0, 1 << 20)), int(draws.integers(0, 99)))
            for name in form.channels
        }
        self._carry = dict.fromkeys(self._units, 0.0)  # pulses of the current latch, before a change of stimulus
        self._latches_per_temperature = max(1, round(TEMPERATURE_PERIOD_S / self._period_s))
        self.may_swap = frozenset(channel.sequence.message.id for channel in form.channels.values())
        self._held: dict[str, int] = {}  # values of stuck counts
        self._cleared: dict[str, int] = {}  # values of counts before they were cleared
        world.integrate_with(self._before_change)

    @classmethod
    def of(cls, setup: NodeSetup) -> Self:
        """Create from a bench file."""
        dbc = dbc_in(setup.options.dbc)
        return cls(setup, dbc, format_of(setup.options, dbc))

    def _before_change(self) -> None:
        """Send latches that are due, and integrate the charge under the stimulus that is about to change."""
        now = self._world.now()  # before the latches, which are sent during it
        self._catch_up()
        if now > self._counted_s:
            for channel, unit in self._units.items():
                self._carry[channel] += float(unit.charge_pulses(np.array([self._counted_s, now]))[0])
            self._counted_s = now

    def _catch_up(self) -> None:
        """Send the latches that are due."""
        if self.faults.times("restart") > self._boots:
            self._restart()
        due = math.floor((self._world.now() - self._origin_s) / self._latch_s) - self._latch
        if due <= 0:
            return
        numbers = np.arange(self._latch + 1, self._latch + due + 1)
        at_s = self._origin_s + numbers * self._latch_s
        edges_s = np.concatenate(([self._counted_s], at_s))
        self._latch, self._counted_s = self._latch + due, float(at_s[-1])
        self._sent.append(self._frames(numbers, edges_s))

    def _restart(self) -> None:
        """Power-on: device clock, latches and counts start at 0, and the boot counter increases."""
        self._boots += 1
        self._origin_s, self._latch, self._tick0, self._sequence0 = self._counted_s, 0, 0, 0
        self._converters = {name: Integrator(0.0, 0, 0) for name in self._form.channels}

    def _frames(self, numbers: NDArray[np.int64], edges_s: Array) -> FrameBlock:
        form, at_s = self._form, edges_s[1:]
        frozen = self.faults.active("frozen")
        shown = np.full_like(numbers, self._shown) if frozen else numbers
        self._shown = int(shown[-1])
        values: dict[str, dict[str, NDArray[np.int64]]] = {}

        def put(field: Field, integers: NDArray[np.int64]) -> None:
            values.setdefault(field.message.name, {})[field.signal.name] = integers

        put(form.tick, self._tick0 + np.rint(shown * (self._period_s / form.tick_period_s)).astype(np.int64))
        sequence = self._sequence0 + shown
        put(form.sequence, sequence)
        if form.boot_count is not None:
            put(form.boot_count, np.full_like(numbers, self._boots))
        spoils = self.faults.spans_s("cleared_count") or self.faults.spans_s("stuck_count")
        for name, channel in form.channels.items():
            positive, negative = self._counts(name, edges_s, frozen)
            if spoils:
                positive, negative = (
                    self._with_faults(name, at_s, positive),
                    self._with_faults(f"-{name}", at_s, negative),
                )
            if (unit := self._units.get(name)) is not None and unit.faults.active("silent"):
                continue
            put(channel.positive, positive)
            put(channel.negative, negative)
            put(channel.sequence, sequence)
        for name, encoder in form.positions.items():
            put(encoder.position, self._positions(name, np.full_like(at_s, at_s[0]) if frozen else at_s))
            put(encoder.sequence, sequence)
        host_s = self._world.host_time(at_s)
        return in_order([encode_frames(self._dbc, host_s, values), self._temperature_frames(numbers, at_s)])

    def _with_faults(self, name: str, at_s: Array, counts: Counts) -> Counts:
        """Apply stuck and cleared counts to the counts of one sign at the times."""
        for begin_s, _ in self.faults.spans_s("cleared_count"):
            since = at_s >= begin_s
            if since.any():
                cleared = self._cleared.setdefault(name, int(counts[np.argmax(since)]))
                counts = np.where(since, counts - cleared, counts)
        if name.removeprefix("-") == next(iter(self._form.channels)):
            for begin_s, end_s in self.faults.spans_s("stuck_count"):
                during = (at_s >= begin_s) & (at_s < end_s)
                if during.any():
                    counts = np.where(during, self._held.setdefault(name, int(counts[np.argmax(during)])), counts)
        return counts

    def _counts(self, channel: str, edges_s: Array, frozen: bool) -> tuple[Counts, Counts]:
        """+ and - counts of a channel at the latches; frozen counts do not change."""
        unit, converter = self._units.get(channel), self._converters[channel]
        if unit is None:
            return converter.count(np.zeros(len(edges_s) - 1))
        pulses = unit.charge_pulses(edges_s)
        pulses[0] += self._carry[channel]
        self._carry[channel] = 0.0
        if frozen:
            return np.full(len(pulses), converter.positive), np.full(len(pulses), converter.negative)
        return converter.count_through_turns(pulses) if unit.swings else converter.count(pulses)

    def _positions(self, role: str, at_s: Array) -> NDArray[np.int64]:
        """Encoder reading of an axis at the times, in counts."""
        angle_deg = self._world.axis_of(role).encoder_angles_deg(at_s + self._world.settings.encoder_skew_s)
        return np.floor(angle_deg * self._per_deg[role]).astype(np.int64)

    def _temperature_frames(self, numbers: NDArray[np.int64], at_s: Array) -> FrameBlock:
        """One frame of each temperature message per second; a signal without a unit is the converter board's."""
        at_s = at_s[numbers % self._latches_per_temperature == 0]
        fields, host_s = self._form.temperatures, self._world.host_time(at_s)
        return temperature_frames(self._dbc, fields, lambda name: self._celsius(name, at_s), host_s)

    def _celsius(self, signal: str, at_s: Array) -> Array:
        place, board = self._setup.readings.get(signal), self._setup.boards.get(signal)
        of_imu = self._setup.imu_readings.get(signal)
        if place is not None:
            return self._world.counted[place].thermometer_c(at_s)
        if board is not None:
            units = self._world.units if board in self._world.units else self._world.imus
            return units[board].converter_thermometer_c(at_s)
        if of_imu is not None:
            return self._world.imus[of_imu[0]].thermometer_c(of_imu[1], at_s)
        return np.full(len(at_s), BOARD_C)
