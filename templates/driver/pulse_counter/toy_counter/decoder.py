"""Decoder of the counter's frames, live and from the record of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from drivers.can.dbc import Field
from drivers.can.decoded import Counts, FrameDecoder
from drivers.can.frame_block import FrameBlock
from drivers.can.gap_detection import GapDetector

from toy_counter import wire
from toy_counter.description import ToyCounterOptions


class ToyCounterDecoder(FrameDecoder):
    """Decodes the counts of the inputs; each has its own frames with their own numbers."""

    def __init__(self, options: ToyCounterOptions) -> None:
        self._messages = {channel: wire.latch(number) for channel, number in options.inputs.items()}

    def outputs(self, block: FrameBlock) -> Mapping[str, Counts]:
        """Decode the counts of every channel."""
        return {channel: wire.counts_in(message, block) for channel, message in self._messages.items()}

    def watches(self) -> Sequence[GapDetector]:
        """Gap detectors, one for each input."""
        return [
            GapDetector.of(Field(message, wire.NUMBER), Field(message, wire.TICK))
            for message in self._messages.values()
        ]
