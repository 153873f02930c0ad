"""Devices that send frames against the rest of a bench file: their bus, and the encoders that they latch."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from bench.config.devices import DeviceEntry
from bench.config.document import Place, Problem
from bench.config.models import BenchFile
from drivers.can.options import text_of
from drivers.schema.suggest import did_you_mean

MOST_LOAD = 0.8  # of a bus; what is left is for the other frames on it, and for those that are sent again


def counter_misfits(bench: BenchFile) -> Iterator[Problem]:
    """What is wrong with the devices of a bench that send frames, each with its place."""
    for role, entry in bench.devices.items():
        frames = entry.description.frames
        if frames is not None and all(path.is_file() for path in entry.files.values()):
            wire = frames.on_the_wire(entry.options)
            yield from _bus(role, entry, wire.bits_per_s)
            for device in entry.encoders:
                yield from _encoder(bench, role, device, wire.position_bits.get(device))
    yield from files_of_one_name(bench)


def files_of_one_name(bench: BenchFile) -> Iterator[Problem]:
    """Different files with one name, of which a run, that keeps them side by side, could keep only one."""
    texts: dict[str, str] = {}
    for role, entry in bench.devices.items():
        for key, path in entry.files.items():
            if path.is_file() and texts.setdefault(path.name, text := text_of(path)) != text:
                where: Place = ("devices", role, "options", key)
                yield where, f"another device has another file that is called {path.name} as well; rename one"


def _bus(role: str, entry: DeviceEntry, needed: float) -> Iterator[Problem]:
    """More frames than the bus can carry, in bit/s."""
    bitrate = entry.connection.option("bitrate", 0)
    if bitrate and needed > MOST_LOAD * bitrate:
        share = f"{100 * needed / bitrate:.0f} %"
        yield (
            ("devices", role, "options"),
            f"its frames take up to {needed:.6g} bit/s, {share} of the bus and "
            f"more than {100 * MOST_LOAD:.0f} %: lengthen the period, or raise the bitrate of the connection",
        )


def _encoder(bench: BenchFile, role: str, device: str, bits: int | None) -> Iterator[Problem]:
    """An encoder of nothing that turns, or one that comes half round between two latches."""
    where: Place = ("devices", role, "options", "positions", device)
    if device not in bench.axes:
        yield where, f"'{device}' drives no axis of the fixture{did_you_mean(device, bench.axes)}"
        return
    encoder, fastest_dps = bench.devices[role].encoders[device], _fastest_dps(bench.devices[device])
    counts = fastest_dps * encoder.period_s * 3600 / encoder.resolution_arcsec
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
