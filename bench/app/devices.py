"""From the device entries of a bench file to driver objects."""

from __future__ import annotations

from bench.app.laboratory import BenchWires, Laboratory
from bench.config.models import BenchFile
from drivers.capabilities import Device
from drivers.description import Setup, make_driver


def open_devices(bench: BenchFile, laboratory: Laboratory | None) -> dict[str, Device]:
    """A driver for every device, not yet connected, on wires that lead to the laboratory where the file says so."""
    wires = BenchWires(bench, laboratory)
    return {
        role: make_driver(
            entry.description,
            Setup(role, entry.connection, wires, entry.options, entry.limits, entry.safe, entry.identity),
        )
        for role, entry in bench.devices.items()
    }
