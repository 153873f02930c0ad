"""The driver: it only receives; the common part of free-running counters monitors the frames."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from drivers.can.dbc import Field, Message
from drivers.can.frame_block import FrameBlock
from drivers.can.sequence_numbers import Integers
from drivers.description import Nothing, Setup
from drivers.kinds.frame_source.counter import FreeCounter, Newest
from numpy.typing import NDArray

from toy_counter import wire
from toy_counter.description import TEMPERATURE, ToyCounterOptions


class ToyCounter(FreeCounter[ToyCounterOptions]):
    """Decodes the frames of its inputs; all are latched together, so the first represents the latch."""

    def __init__(self, setup: Setup[ToyCounterOptions, Nothing, Nothing]) -> None:
        super().__init__(setup, setup.options.period, setup.options.inputs)
        self._messages = {channel: wire.latch(number) for channel, number in setup.options.inputs.items()}
        self._fingerprint = "fixed frames"

    @property
    def _latch(self) -> Message:
        return next(iter(self._messages.values()))

    @property
    def _temperatures(self) -> Mapping[str, Field]:
        return {TEMPERATURE: wire.TEMPERATURE}

    def _latches(self, block: FrameBlock) -> tuple[Integers, NDArray[np.float64]]:
        rows, words = self._latch.sent_in(block)
        return wire.NUMBER.raw(words), block.at_s[rows]

    def _newest(self, block: FrameBlock) -> Newest:
        found = {}
        for channel, message in self._messages.items():
            rows, words = message.sent_in(block)
            if len(rows):
                data = words[-1:].tobytes()
                counts = wire.POSITIVE.raw_of(data), wire.NEGATIVE.raw_of(data)
                found[channel] = float(block.at_s[rows[-1]]), counts
        return found
