"""From frames to what the encoder of a table read, latched with pulses or with samples."""

from __future__ import annotations

from bench.metrology.acquisition import Positions
from drivers.can.encoder_frames import Positions as Read
from drivers.can.options import PositionOptions


def positions_of(read: Read, tick_period_s: float, encoder: PositionOptions, channel: str = "") -> Positions:
    """What was read, with what its bench file says; `channel` is that of the samples that it was latched with."""
    return Positions(
        sequence=read.sequence,
        tick=read.tick,
        position=read.position,
        tick_bits=read.tick_bits,
        position_bits=read.position_bits,
        tick_period_s=tick_period_s,
        resolution_deg=encoder.resolution / 3600,
        host_s=read.host_s,
        channel=channel,
    )
