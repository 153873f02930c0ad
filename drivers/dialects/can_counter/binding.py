"""Frame format of a counter, from its bench file entry and the DBC named there."""

from __future__ import annotations

from drivers.can.dbc import Dbc
from drivers.dialects.can_counter.options import CounterOptions
from drivers.dialects.can_counter.wire import CounterFormat, counter_format


def format_of(options: CounterOptions, dbc: Dbc) -> CounterFormat:
    """Resolve the names of the options in the DBC; DbcError names the missing ones."""
    channels = {name: channel.model_dump() for name, channel in options.channels.items()}
    positions = {name: encoder.model_dump() for name, encoder in options.positions.items()}
    return counter_format(dbc, options.latch.model_dump(), options.latch.tick_period, channels, positions)
