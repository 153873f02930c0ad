"""Frame formats of telemetry, from its bench file entry and the DBC named there."""

from __future__ import annotations

from drivers.can.dbc import Dbc
from drivers.can.encoder_frames import PositionFormat, position_formats
from drivers.dialects.can_telemetry.options import TelemetryOptions
from drivers.dialects.can_telemetry.wire import SampleFormat, sample_formats


def formats_of(options: TelemetryOptions, dbc: Dbc) -> dict[str, SampleFormat]:
    """Resolve the names of each channel in the DBC; DbcError names those missing or spread over several messages."""
    return sample_formats(dbc, {name: sample.model_dump() for name, sample in options.channels.items()})


def encoders_of(options: TelemetryOptions, dbc: Dbc) -> dict[str, PositionFormat]:
    """Resolve the names of each encoder in the DBC; DbcError names the missing ones."""
    return position_formats(dbc, {name: encoder.model_dump() for name, encoder in options.positions.items()})
