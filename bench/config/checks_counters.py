"""Counters and telemetry against the rest of a bench file: their bus, and the encoders that counters latch."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from bench.config.devices import DeviceEntry
from bench.config.document import Place, Problem
from bench.config.models import BenchFile
from drivers.can.options import PositionOptions, position_bits, text_of
from drivers.dialects.can_counter.description import CounterOptions, bus_bits_per_latch
from drivers.dialects.can_telemetry.description import TelemetryOptions, bus_bits_per_s
from drivers.schema.suggest import did_you_mean
from drivers.transport.address import Address

MOST_LOAD = 0.8  # of a bus; what is left is for the other frames on it, and for those that are sent again


def counter_misfits(bench: BenchFile) -> Iterator[Problem]:
    """What is wrong with the counters of a bench, each with its place."""
    for role, entry in bench.devices.items():
        options = entry.options
        if isinstance(options, CounterOptions) and options.dbc.is_file():
            needed = bus_bits_per_latch(options) / options.period
            what = f"the frames of a latch every {options.period:g} s"
            yield from _bus(("devices", role, "options", "period"), entry.connection, needed, what)
            for device, encoder in options.positions.items():
                yield from _encoder(bench, role, device, encoder, options.period)
        elif isinstance(options, TelemetryOptions) and options.dbc.is_file():
            where: Place = ("devices", role, "options", "channels")
            yield from _bus(where, entry.connection, bus_bits_per_s(options), "the samples of all channels")
            for device, sampled in options.positions.items():
                yield from _encoder(bench, role, device, sampled, options.channels[sampled.channel].period)
    yield from files_of_one_name(bench)


def files_of_one_name(bench: BenchFile) -> Iterator[Problem]:
    """Different DBC files with one name, of which a run, that keeps them side by side, could keep only one."""
    texts: dict[str, str] = {}
    for role, entry in bench.devices.items():
        options = entry.options
        if isinstance(options, CounterOptions | TelemetryOptions) and options.dbc.is_file():
            text = text_of(options.dbc)
            if texts.setdefault(options.dbc.name, text) != text:
                where: Place = ("devices", role, "options", "dbc")
                yield where, f"another device has another file that is called {options.dbc.name} as well; rename one"


def _bus(place: Place, connection: Address, needed: float, what: str) -> Iterator[Problem]:
    """More frames than the bus can carry, in bit/s."""
    bitrate = connection.option("bitrate", 0)
    if bitrate and needed > MOST_LOAD * bitrate:
        share = f"{100 * needed / bitrate:.0f} %"
        yield (
            place,
            f"{what} take up to {needed:.6g} bit/s, {share} of the bus and "
            f"more than {100 * MOST_LOAD:.0f} %: lengthen the period, or raise the bitrate of the connection",
        )


def _encoder(bench: BenchFile, role: str, device: str, encoder: PositionOptions, period_s: float) -> Iterator[Problem]:
    """An encoder of nothing that turns, or one that comes half round between two latches."""
    where: Place = ("devices", role, "options", "positions", device)
    if device not in bench.axes:
        yield where, f"'{device}' drives no axis of the fixture{did_you_mean(device, bench.axes)}"
        return
    options: Any = bench.devices[role].options
    bits, fastest_dps = position_bits(options.dbc, encoder), _fastest_dps(bench.devices[device])
    counts = fastest_dps * period_s * 3600 / encoder.resolution
    if bits is not None and counts >= 2 ** (bits - 1):
        yield (
            where,
            f"its signal has {bits} bits; at {fastest_dps:g} °/s it goes {counts:.6g} counts in a period, half round "
            "or more: shorten the period, or use a longer signal",
        )


def _fastest_dps(device: DeviceEntry) -> float:
    limits: Any = device.limits
    fastest: float = getattr(getattr(limits, "rate", None), "max", 0.0)
    return fastest
