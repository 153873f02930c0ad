"""Telemetry of units: each samples its own output by its own clock and sends it while powered."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from drivers.can.dbc import Dbc, Field, dbc_in, encode_frames
from drivers.can.encoder_frames import PositionFormat, position_formats
from drivers.can.frame_block import FrameBlock
from drivers.certificates.corrections import ARCSEC_PER_DEG
from drivers.dialects.can_telemetry.options import TelemetryOptions
from drivers.dialects.can_telemetry.wire import SampleFormat, sample_formats
from simulators.instruments.can_nodes.can_node import (
    TEMPERATURE_PERIOD_S,
    CanNode,
    NodeSetup,
    Source,
    in_order,
    temperature_frames,
)
from simulators.instruments.setup import NotSimulated
from simulators.units.unit_file import stream
from simulators.world import World

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class EncoderSettings:
    """Encoder of an axis latched with samples: its frames, and its counts per degree."""

    form: PositionFormat
    per_deg: float


@dataclass(frozen=True, slots=True)
class ChannelSettings:
    """One channel: its frames, the place of its unit, and the encoders latched with it.

    Encoders are keyed by the devices that drive the axes, and latched `encoder_skew_s` after the end of a sample.
    """

    form: SampleFormat
    period_s: float
    tick_period_s: float
    place: str
    encoders: Mapping[str, EncoderSettings] = field(default_factory=dict)
    encoder_skew_s: float = 0.0


class SimulatedTelemetry(CanNode):
    """The units of the world that send their output.

    At every power-on a unit restarts its clock, its numbers and its samples.
    """

    def __init__(self, setup: NodeSetup, dbc: Dbc, channels: Mapping[str, ChannelSettings]) -> None:
        super().__init__(setup.role, setup.world, setup.faults)
        self._setup, self._dbc, world = setup, dbc, setup.world
        self._restarts = 0
        senders: dict[str, Source] = {
            name: world.counted[each.place] for name, each in channels.items() if each.place in world.counted
        }
        for imu in world.imus.values():
            senders |= imu.channels
        self._streams = [_Stream(name, senders[name], each, world) for name, each in channels.items()]
        self._messages: dict[str, list[_Stream]] = {}
        for each in self._streams:
            self._messages.setdefault(each.settings.form.value.message.name, []).append(each)
        self._thermometers: dict[str, dict[str, Field]] = {each.place: {} for each in channels.values()}
        for name, of_signal in dbc.readings.items():
            place = setup.readings.get(name, setup.imu_readings.get(name, ("", ""))[0])
            if place in self._thermometers:
                self._thermometers[place][name] = of_signal
        world.integrate_with(self._before_change)

    @classmethod
    def of(cls, setup: NodeSetup) -> Self:
        """Create from a bench file; only channels with a unit send."""
        options: TelemetryOptions = setup.options
        dbc = dbc_in(options.dbc)
        forms, encoders = sample_formats(dbc, options.channels), position_formats(dbc, options.positions)
        channels = {}
        for channel, sample in options.channels.items():
            if channel in setup.places:
                latched = {
                    device: EncoderSettings(encoders[device], ARCSEC_PER_DEG / each.resolution)
                    for device, each in options.positions.items()
                    if each.channel == channel
                }
                channels[channel] = ChannelSettings(
                    forms[channel], sample.period, sample.tick_period, setup.places[channel], latched,
                    setup.encoder_skew_s,
                )  # fmt: skip
        _check_messages(setup.role, channels)
        return cls(setup, dbc, channels)

    def _before_change(self) -> None:
        """Send samples that are due, and integrate the output under the stimulus that is about to change."""
        now_s = self._world.now()  # before the samples, which are sent during it
        self._catch_up()
        for each in self._streams:
            each.integrate(now_s)

    def _catch_up(self) -> None:
        if self.faults.times("restart") > self._restarts:
            self._restarts += 1
            for each in self._streams:
                each.begin(each.integrated_s)
        frozen, blocks = self.faults.active("frozen"), list[FrameBlock]()
        warmed = set[str]()
        for message, streams in self._messages.items():
            values: dict[str, Integers] = {}
            for each in streams:  # streams that sample together
                numbers, at_s, codes = each.samples(self._world.now(), frozen=frozen)
                values |= each.values(numbers, codes)
            if len(numbers) and not each.unit.faults.active("silent"):
                shown_s = np.full_like(at_s, at_s[0]) if frozen else at_s
                said = {message: values}
                for each in streams:
                    said |= self._positions(each, numbers, shown_s)
                blocks.append(encode_frames(self._dbc, self._world.host_time(at_s), said))
                if each.unit.place not in warmed:
                    blocks.append(
                        self._temperature_frames(each.unit.place, at_s[numbers % each.samples_per_temperature == 0])
                    )
                    warmed.add(each.unit.place)
        if blocks:
            self._sent.append(in_order(blocks))

    def _positions(self, each: _Stream, numbers: Integers, at_s: Array) -> dict[str, dict[str, Integers]]:
        """Readings of the encoders latched with samples at the times."""
        said = {}
        for role, encoder in each.settings.encoders.items():
            angle_deg = self._world.axis_of(role).encoder_angles_deg(at_s + each.settings.encoder_skew_s)
            position, sequence = encoder.form.position, encoder.form.sequence
            counts = np.floor(angle_deg * encoder.per_deg).astype(np.int64)
            said[position.message.name] = {position.signal.name: counts, sequence.signal.name: numbers}
        return said

    def _temperature_frames(self, place: str, at_s: Array) -> FrameBlock:
        """Thermometer readings of a unit, once a second."""
        fields, host_s = self._thermometers[place], self._world.host_time(at_s)
        return temperature_frames(self._dbc, fields, lambda name: self._celsius(name, at_s), host_s)

    def _celsius(self, signal: str, at_s: Array) -> Array:
        of_imu = self._setup.imu_readings.get(signal)
        if of_imu is not None:
            return self._world.imus[of_imu[0]].thermometer_c(of_imu[1], at_s)
        return self._world.counted[self._setup.readings[signal]].thermometer_c(at_s)


def _check_messages(role: str, channels: Mapping[str, ChannelSettings]) -> None:
    """Raise NotSimulated for a message of several units, or of several periods."""
    alike: dict[str, set[tuple[str, float]]] = {}
    for each in channels.values():
        alike.setdefault(each.form.value.message.name, set()).add((each.place, each.period_s))
    for message, sent in alike.items():
        if len(sent) > 1:
            raise NotSimulated(
                f"'{role}' has channels of several units, or with several periods, in {message}; no simulator "
                "supports this"
            )


class _Stream:
    """Samples of one channel: means of its unit's output over a sample period."""

    def __init__(self, name: str, unit: Source, settings: ChannelSettings, world: World) -> None:
        self.unit, self.settings, self._how = unit, settings, unit.sent
        self.samples_per_temperature = max(1, round(TEMPERATURE_PERIOD_S / settings.period_s))
        self._sample_s = settings.period_s / (1 + self._how.clock)  # true seconds from sample to sample
        self._noise = stream(world.settings.seed, "noise", unit.place, f"telemetry {name}")
        self._powered_at_s: float | None = None
        self._shown: tuple[int, int] = (0, 0)  # last number and code sent in a frame
        self.begin(world.now())

    def begin(self, at_s: float) -> None:
        """Start clock and sample numbers at 0."""
        self._origin_s = self.integrated_s = at_s
        self._number = 0
        self._carry = 0.0  # of the current sample: codes times seconds, before a change of stimulus

    def integrate(self, until_s: float) -> None:
        """Integrate the output since the last sample."""
        if until_s > self.integrated_s:
            mean = float(self.unit.mean_codes(np.array([self.integrated_s, until_s]))[0])
            self._carry += mean * (until_s - self.integrated_s)
            self.integrated_s = until_s

    def samples(self, now_s: float, *, frozen: bool) -> tuple[Integers, Array, Integers]:
        """Numbers, true times and codes of the samples that are due; none without power."""
        if self.unit.powered_at_s is None:
            self.integrate(now_s)  # the history of the unit continues
            return np.empty(0, np.int64), np.empty(0), np.empty(0, np.int64)
        if self._powered_at_s != self.unit.powered_at_s:
            self._powered_at_s = self.unit.powered_at_s
            self.begin(self.unit.powered_at_s)
        due = max(math.floor((now_s - self._origin_s) / self._sample_s) - self._number, 0)
        numbers = np.arange(self._number + 1, self._number + due + 1, dtype=np.int64)
        at_s: Array = np.asarray(self._origin_s + numbers * self._sample_s, np.float64)
        if not due:
            return numbers, at_s, numbers
        edges_s = np.concatenate(([self.integrated_s], at_s))
        charge = self.unit.mean_codes(edges_s) * np.diff(edges_s)
        charge[0] += self._carry
        self._number, self.integrated_s, self._carry = int(numbers[-1]), float(at_s[-1]), 0.0
        noise = self._how.noise_code * self._noise.standard_normal(due)
        codes = np.rint(charge / self._sample_s + noise).astype(np.int64)
        if self.unit.faults.active("dead"):
            codes = np.full_like(codes, round(self._how.zero_code))
        if frozen:
            return np.full_like(numbers, self._shown[0]), at_s, np.full_like(codes, self._shown[1])
        self._shown = int(numbers[-1]), int(codes[-1])
        return numbers, at_s, codes

    def values(self, numbers: Integers, codes: Integers) -> Mapping[str, Integers]:
        """Signal values of its frames; the status is that of a valid sample."""
        form = self.settings.form
        ticks = np.rint(numbers * (self.settings.period_s / self.settings.tick_period_s)).astype(np.int64)
        said = ((form.value, codes), (form.tick, ticks), (form.sequence, numbers))
        return {each.signal.name: integers for each, integers in said}
