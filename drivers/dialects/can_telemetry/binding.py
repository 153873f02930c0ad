"""The frame formats of telemetry, from its bench file entry and the DBC named there."""

from __future__ import annotations

from drivers.can.dbc import Dbc
from drivers.can.encoder_frames import PositionFormat, position_formats
from drivers.dialects.can_telemetry.options import TelemetryOptions
from drivers.dialects.can_telemetry.wire import SampleFormat, sample_formats


def formats_of(options: TelemetryOptions, dbc: Dbc) -> dict[str, SampleFormat]:
    """The names of each channel bound to the DBC; DbcError names what it does not have, or has in several messages."""
    return sample_formats(dbc, {name: sample.model_dump() for name, sample in options.channels.items()})


def encoders_of(options: TelemetryOptions, dbc: Dbc) -> dict[str, PositionFormat]:
    """The names of each encoder bound to the DBC; DbcError names what it does not have."""
    return position_formats(dbc, {name: encoder.model_dump() for name, encoder in options.positions.items()})
