"""From recorded frames to what units sent of their output, by the DBC that was kept for it."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from bench.metrology.acquisition import Codes, Positions
from bench.store.encoders import positions_of
from bench.store.kept_dbc import kept_format
from drivers.can.frame_block import FrameBlock
from drivers.dialects.can_telemetry import wire
from drivers.dialects.can_telemetry.binding import encoders_of, formats_of
from drivers.dialects.can_telemetry.description import TelemetryOptions


class CodeDecoder:
    """Decodes the frames of one telemetry; StoreError when its DBC in `folder` cannot be read."""

    def __init__(self, options: TelemetryOptions, folder: Path) -> None:
        self._options = options
        self._formats = kept_format(folder / options.dbc.name, partial(formats_of, options))
        self._encoders = kept_format(folder / options.dbc.name, partial(encoders_of, options))

    def codes(self, block: FrameBlock) -> dict[str, Codes]:
        """The samples of every channel in these frames."""
        found = {}
        for name, sample in self._options.channels.items():
            raw = wire.decode_samples(self._formats[name], block)
            found[name] = Codes(
                sequence=raw.sequence,
                tick=raw.tick,
                values=raw.values,
                host_s=raw.host_s,
                tick_bits=raw.tick_bits,
                tick_period_s=sample.tick_period,
                step=self._formats[name].step,
                lost=raw.lost,
                dropped=raw.dropped,
                invalid=raw.invalid,
                stuck_after=sample.stuck_after,
                averaged=sample.sample == "mean",
                restarts=raw.restarts,
                gaps=raw.gaps,
            )
        return found

    def positions(self, block: FrameBlock) -> dict[str, Positions]:
        """What the encoders read that are latched with samples, by the devices that drive their axes."""
        found = {}
        for name, encoder in self._options.positions.items():
            raw = wire.decode_positions(self._formats[encoder.channel], self._encoders[name], block)
            sample = self._options.channels[encoder.channel]
            found[name] = positions_of(raw, sample.tick_period, encoder, encoder.channel)
        return found
