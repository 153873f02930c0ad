"""Checks of devices that send frames against the rest of a bench file: bus load, and latched encoders."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from bench.config.devices import DeviceEntry
from bench.config.document import Place, Problem
from bench.config.models import BenchFile
from drivers.can.options import text_of
from drivers.schema.suggest import did_you_mean

MOST_LOAD = 0.8  # of the capacity of a bus; the rest is for other frames and for retransmission


def counter_misfits(bench: BenchFile) -> Iterator[Problem]:
    """Yield the problems of devices that send frames, with their places."""
    for role, entry in bench.devices.items():
        frames = entry.description.frames
        if frames is not None and all(path.is_file() for path in entry.files.values()):
            wire = frames.bus_load(entry.options)
            yield from _bus(role, entry, wire.bits_per_s)
            for device in entry.encoders:
                yield from _encoder(bench, role, device, wire.position_bits.get(device))
    yield from files_of_one_name(bench)


def files_of_one_name(bench: BenchFile) -> Iterator[Problem]:
    """Yield different files with the same name: a run keeps all files in one folder."""
    texts: dict[str, str] = {}
    for role, entry in bench.devices.items():
        for key, path in entry.files.items():
            if path.is_file() and texts.setdefault(path.name, text := text_of(path)) != text:
                where: Place = ("devices", role, "options", key)
                yield where, f"another device has another file that is called {path.name} as well; rename one"


def _bus(role: str, entry: DeviceEntry, needed: float) -> Iterator[Problem]:
    """Yield devices whose frames exceed the capacity of the bus, in bit/s."""
    bitrate = entry.connection.option("bitrate", 0)
    if bitrate and needed > MOST_LOAD * bitrate:
        share = f"{100 * needed / bitrate:.0f} %"
        yield (
            ("devices", role, "options"),
            f"its frames take up to {needed:.6g} bit/s, {share} of the bus and "
            f"more than {100 * MOST_LOAD:.0f} %: lengthen the period, or raise the bitrate of the connection",
        )


def _encoder(bench: BenchFile, role: str, device: str, bits: int | None) -> Iterator[Problem]:
    """Yield encoders of axes that do not exist, and those that turn half a revolution or more between two latches."""
    where: Place = ("devices", role, "options", "positions", device)
    if device not in bench.axes:
        yield where, f"'{device}' drives no axis of the fixture{did_you_mean(device, bench.axes)}"
        return
    encoder, fastest_dps = bench.devices[role].encoders[device], _fastest_dps(bench.devices[device])
    counts = fastest_dps * encoder.period_s * 3600 / encoder.resolution_arcsec
    if bits is not None and counts >= 2 ** (bits - 1):
        yield (
            where,
            f"its signal has {bits} bits; at {fastest_dps:g} °/s it counts {counts:.6g} in a period, half its range "
            "or more: shorten the period, or use a longer signal",
        )


def _fastest_dps(device: DeviceEntry) -> float:
    limits: Any = device.limits
    fastest: float = getattr(getattr(limits, "rate", None), "max", 0.0)
    return fastest
