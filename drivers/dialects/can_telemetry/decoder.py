"""Frame formats of telemetry and decoder of its frames, from its bench file entry and the DBC named there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from drivers.can.dbc import dbc_in
from drivers.can.decoded import FrameDecoder, Positions, Samples
from drivers.can.encoder_frames import position_formats
from drivers.can.frame_block import FrameBlock
from drivers.can.gap_detection import GapDetector
from drivers.dialects.can_telemetry import wire
from drivers.dialects.can_telemetry.options import TelemetryOptions
from drivers.dialects.can_telemetry.wire import sample_formats


class TelemetryDecoder(FrameDecoder):
    """Decodes samples and the encoders latched with them; raises UnfitFileError and DbcError."""

    def __init__(self, options: TelemetryOptions) -> None:
        dbc = dbc_in(options.dbc)
        self._formats = sample_formats(dbc, options.channels)
        self._encoders = position_formats(dbc, options.positions)
        self._channels = {device: encoder.channel for device, encoder in options.positions.items()}
        self.scales = {name: form.scale for name, form in self._formats.items()}

    def outputs(self, block: FrameBlock) -> Mapping[str, Samples]:
        """Decode the samples of every channel."""
        first = self._first_numbers(block)
        return {name: wire.decode_samples(form, block, first.get(name)) for name, form in self._formats.items()}

    def positions(self, block: FrameBlock) -> Mapping[str, Positions]:
        """Decode the encoder positions latched with samples."""
        first = self._first_numbers(block)
        return {
            name: wire.decode_positions(
                self._formats[self._channels[name]], encoder, block, first.get(self._channels[name])
            )
            for name, encoder in self._encoders.items()
        }

    def _first_numbers(self, block: FrameBlock) -> dict[str, int]:
        """Unwrapped number of the first sample of each channel: as near as possible to that of the first channel.

        Channels that are sampled together have the same numbers, also where a block begins between their frames, and
        one number wraps around there.
        """
        found: dict[str, int] = {}
        for name, form in self._formats.items():
            raw, size = wire.first_number(form, block), 1 << form.sequence.signal.length
            if raw is not None:
                anchor = next(iter(found.values()), raw)
                found[name] = anchor + (raw - anchor + size // 2) % size - size // 2
        return found

    def watches(self) -> Sequence[GapDetector]:
        """Gap detectors, one for each message with samples."""
        return wire.unbroken(self._formats)
