"""Decoding of frames, recorded or live, into counts, codes and encoder positions by the decoder of their driver."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bench.config.devices import DeviceEntry
from bench.errors import StoreError
from bench.metrology.acquisition import Codes, Counts, Positions
from drivers.can import decoded
from drivers.can.dbc import DbcError
from drivers.can.decoded import FrameDecoder, GapWatch
from drivers.can.frame_block import FrameBlock
from drivers.can.sent_frames import Counted, Encoder, Sampled
from drivers.installed import loaded
from drivers.schema.bounded import UnfitFileError

_OF_COUNTS = [name for name in decoded.Counts._fields if name not in ("first", "dropped")]
_OF_SAMPLES = [name for name in decoded.Samples._fields if name != "first"]
_OF_POSITIONS = [name for name in decoded.Positions._fields if name not in ("lost", "restarts")]


class Decoder:
    """Decoder of the frames of one device that sends them unsolicited.

    With the `folder` of a run it uses the description files kept there. Raises StoreError if they cannot be read or
    have changed.
    """

    def __init__(self, entry: DeviceEntry, folder: Path | None = None) -> None:
        self._outputs, self._encoders = entry.outputs, entry.encoders
        self._frames = _frame_decoder(entry, folder)

    @property
    def scales(self) -> Mapping[str, decoded.Scale]:
        """Scales that convert codes to values, by channel, for channels that have one."""
        return self._frames.scales

    def outputs(self, block: FrameBlock) -> dict[str, Counts | Codes]:
        """Return the counts or samples of every channel in these frames."""
        return {name: self._output(name, raw) for name, raw in self._frames.outputs(block).items()}

    def positions(self, block: FrameBlock) -> dict[str, Positions]:
        """Return the encoder positions in these frames, by the device that drives the axis."""
        return {name: _positions(raw, self._encoders[name]) for name, raw in self._frames.positions(block).items()}

    def watches(self) -> Sequence[GapWatch]:
        """Return gap detectors for a new acquisition."""
        return self._frames.watches()

    def _output(self, name: str, raw: decoded.Counts | decoded.Samples) -> Counts | Codes:
        output = self._outputs[name]
        match raw, output:
            case decoded.Counts(), Counted():
                return _counts(raw, output)
            case decoded.Samples(), Sampled():
                return _codes(raw, output, self._frames.scales.get(name, decoded.Scale()))
        raise TypeError(f"channel '{name}' is described as {type(output).__name__}, decoded as {type(raw).__name__}")


def decoders_of(devices: Mapping[str, DeviceEntry], folder: Path | None = None) -> dict[str, Decoder]:
    """Return a decoder for each of these devices that sends frames, by role. Raises StoreError."""
    return {role: Decoder(entry, folder) for role, entry in devices.items() if entry.description.frames is not None}


def _frame_decoder(entry: DeviceEntry, folder: Path | None) -> FrameDecoder:
    frames = entry.description.frames
    if frames is None:
        raise StoreError(f"the driver '{entry.driver}' describes no frames; nothing that it sent can be decoded")
    files = dict(entry.files) if folder is None else {key: folder / path.name for key, path in entry.files.items()}
    try:
        made: FrameDecoder = loaded(frames.decoder)(entry.options.model_copy(update=files))
    except (UnfitFileError, DbcError) as problem:
        named = ", ".join(map(str, files.values())) or entry.driver
        raise StoreError(f"{named}: the frames of this run cannot be decoded ({problem})") from problem
    return made


def _counts(raw: decoded.Counts, output: Counted) -> Counts:
    return Counts(**_kept(raw, _OF_COUNTS), tick_period_s=output.tick_period_s, max_rate_pps=output.max_rate_pps)


def _codes(raw: decoded.Samples, output: Sampled, scale: decoded.Scale) -> Codes:
    return Codes(
        **_kept(raw, _OF_SAMPLES),
        tick_period_s=output.tick_period_s,
        step=abs(scale.factor),
        stuck_after=output.stuck_after,
        averaged=output.averaged,
    )


def _positions(raw: decoded.Positions, encoder: Encoder) -> Positions:
    return Positions(
        **_kept(raw, _OF_POSITIONS),
        tick_period_s=encoder.tick_period_s,
        resolution_deg=encoder.resolution_arcsec / 3600,
        channel=encoder.channel,
    )


def _kept(raw: object, names: Sequence[str]) -> dict[str, Any]:
    return {name: getattr(raw, name) for name in names}
