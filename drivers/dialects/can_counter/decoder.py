"""Frame format of a counter and decoder of its frames, from its bench file entry and the DBC named there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from drivers.can.dbc import Dbc, dbc_in
from drivers.can.decoded import Counts, FrameDecoder, Positions
from drivers.can.frame_block import FrameBlock
from drivers.can.gap_detection import GapDetector
from drivers.dialects.can_counter import wire
from drivers.dialects.can_counter.options import CounterOptions
from drivers.dialects.can_counter.wire import CounterFormat, counter_format


class CounterDecoder(FrameDecoder):
    """Decodes counts and encoders, paired with their latches; raises UnfitFileError and DbcError."""

    def __init__(self, options: CounterOptions) -> None:
        self._format = format_of(options, dbc_in(options.dbc))

    def outputs(self, block: FrameBlock) -> Mapping[str, Counts]:
        """Decode the counts of every channel."""
        latches = wire.latches_of(self._format, block)
        return {name: wire.decode_counts(self._format, name, block, latches) for name in self._format.channels}

    def positions(self, block: FrameBlock) -> Mapping[str, Positions]:
        """Decode the encoder positions latched with the counts."""
        if not self._format.positions:
            return {}
        latches = wire.latches_of(self._format, block)
        return {name: wire.decode_positions(self._format, name, block, latches) for name in self._format.positions}

    def watches(self) -> Sequence[GapDetector]:
        """Gap detector for the latches and the counts of all channels."""
        return [wire.unbroken(self._format)]


def format_of(options: CounterOptions, dbc: Dbc) -> CounterFormat:
    """Resolve the names of the options in the DBC; DbcError names the missing ones."""
    return counter_format(dbc, options.latch, options.channels, options.positions)
