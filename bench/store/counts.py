"""From recorded frames to counts, by the DBC that was kept for it."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from bench.metrology.acquisition import Counts, Positions
from bench.store.encoders import positions_of
from bench.store.kept_dbc import kept_format
from drivers.can.frame_block import FrameBlock
from drivers.dialects.can_counter import wire
from drivers.dialects.can_counter.binding import format_of
from drivers.dialects.can_counter.description import CounterOptions


class CountDecoder:
    """Decodes the frames of one counter; StoreError when its DBC in `folder` cannot be read."""

    def __init__(self, options: CounterOptions, folder: Path) -> None:
        self._options = options
        self._format = kept_format(folder / options.dbc.name, partial(format_of, options))

    def counts(self, block: FrameBlock) -> dict[str, Counts]:
        """The counts of every channel in these frames."""
        found, latches = {}, wire.latches_of(self._format, block)
        for name in self._options.channels:
            raw = wire.decode_counts(self._format, name, block, latches)
            found[name] = Counts(
                sequence=raw.sequence,
                tick=raw.tick,
                positive=raw.positive,
                negative=raw.negative,
                host_s=raw.host_s,
                tick_bits=raw.tick_bits,
                counter_bits=raw.counter_bits,
                tick_period_s=self._options.latch.tick_period,
                max_rate_pps=self._options.max_rate,
                lost=raw.lost,
                restarts=raw.restarts,
                gaps=raw.gaps,
            )
        return found

    def positions(self, block: FrameBlock) -> dict[str, Positions]:
        """What the encoders read in these frames, by the devices that drive their axes."""
        if not self._options.positions:
            return {}
        found, latches = {}, wire.latches_of(self._format, block)
        for name, encoder in self._options.positions.items():
            raw = wire.decode_positions(self._format, name, block, latches)
            found[name] = positions_of(raw, self._options.latch.tick_period, encoder)
        return found
