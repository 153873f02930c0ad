"""Driver of the telemetry of units under test: receives frames, checks them during acquisitions, delivers blocks."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Self

import numpy as np

from drivers.can.dbc import Dbc, Field
from drivers.can.encoder_frames import PositionFormat, position_formats
from drivers.can.frame_block import FrameBlock
from drivers.can.sequence_numbers import Integers
from drivers.description import Nothing, Setup
from drivers.dialects.can_telemetry import wire
from drivers.dialects.can_telemetry.options import TelemetryOptions
from drivers.errors import InstrumentFault, NoAnswer
from drivers.kinds.frame_source.intake import (
    FROZEN_FRAMES,
    MAX_LISTED,
    FrameDriver,
    bound_format,
    describe_frames,
    silence_s,
)
from drivers.timing.awake import awake_s
from drivers.values import LastSeen


class CanTelemetry(FrameDriver[TelemetryOptions]):
    """Telemetry sent by the units themselves; the driver never sends.

    A unit without power sends nothing, so silence is a fault only during an acquisition. Lifetime: a task of its own
    receives frames from entry to exit. A problem is raised by the next `poll` and by a running acquisition.
    """

    def __init__(self, setup: Setup[TelemetryOptions, Nothing, Nothing]) -> None:
        super().__init__(setup)
        self._last_seen = dict.fromkeys(self._options.channels, LastSeen(-math.inf, -math.inf))
        self._numbers: dict[str, Integers] = {}  # sequence numbers of the last samples, by channel
        self._codes: dict[str, int] = {}  # last sample of each channel
        self._others: set[int] = set()  # frames that belong to no channel
        self._formats: Mapping[str, wire.SampleFormat] = {}
        self._encoders: Mapping[str, PositionFormat] = {}
        self._temperatures: Mapping[str, Field] = {}

    async def __aenter__(self) -> Self:
        """Open the channel; raises CannotConnect, BadAnswer."""
        self._formats, self._fingerprint = bound_format(self.name, self._options.dbc, self._bind)
        return await super().__aenter__()

    def _bind(self, dbc: Dbc) -> Mapping[str, wire.SampleFormat]:
        self._temperatures, self._encoders = dbc.readings, position_formats(dbc, self._options.positions)
        return wire.sample_formats(dbc, self._options.channels)

    def _process(self, block: FrameBlock) -> None:
        """Decode readings and the newest samples of a block; raises if the block has a problem."""
        self._store_readings(self._temperatures, block)
        known = {form.value.message.id for form in self._formats.values()}
        known |= {encoder.position.message.id for encoder in self._encoders.values()}
        self._others |= set(sorted(set(block.ids.tolist()) - known)[:MAX_LISTED])
        for channel, form in self._formats.items():
            self._store_newest(channel, *wire.arrivals(form, block))
        self._check_silence()

    def _store_newest(self, channel: str, numbers: Integers, codes: Integers, at_s: np.ndarray) -> None:
        """Store the newest value of a channel; raises if it repeats the same sample."""
        if not len(numbers):
            return
        changed = np.flatnonzero(np.diff(codes, prepend=self._codes.get(channel, ~int(codes[0]))))
        changed_s = float(at_s[changed[-1]]) if len(changed) else self._last_seen[channel].change_s
        self._last_seen[channel], self._codes[channel] = LastSeen(float(at_s[-1]), changed_s), int(codes[-1])
        last = np.concatenate([self._numbers.get(channel, numbers[:0]), numbers])[-FROZEN_FRAMES:]
        self._numbers[channel] = last
        if len(last) == FROZEN_FRAMES and not np.diff(last).any():
            raise InstrumentFault(
                self.name, f"channel '{channel}' is frozen: its samples have the sequence number {last[0]}",
                remedy="Switch the unit off and on; it repeats an old sample.",
            )  # fmt: skip

    def _check_silence(self) -> None:
        """Raise if all channels are silent during an acquisition."""
        since_s = self._intake.acquiring_since_s
        if since_s is None:
            return
        silent_s = silence_s(max(sample.period for sample in self._options.channels.values()))
        last_s = max(since_s, *(seen.frame_s for seen in self._last_seen.values()))
        if awake_s(last_s) <= silent_s:
            return
        wanted = describe_frames(form.value.message.id for form in self._formats.values())
        raise NoAnswer(
            self.name, f"no sample ({wanted}) for more than {silent_s:g} s during an acquisition",
            received=f"{describe_frames(self._others)} besides" if self._others else "no other frame either",
            remedy="Check that the unit is on, the CAN cable and the bit rate, and that the DBC belongs to this unit.",
        )  # fmt: skip
