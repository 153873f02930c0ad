"""Creation of driver objects from the device entries of a bench file."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from bench.app.laboratory import BenchWires, Laboratory
from bench.config.models import BenchFile
from bench.rig import device_of
from drivers.capabilities import Device
from drivers.person import NO_OPERATOR, Person
from drivers.transport.trace import Passed, TracedWires
from drivers.transport.wires import Wires


def open_devices(
    bench: BenchFile, laboratory: Laboratory | None, keep: Callable[[Passed], object] | None = None,
    note: Callable[[str, str], object] = lambda _role, _text: None, person: Person = NO_OPERATOR,
) -> dict[str, Device]:  # fmt: skip
    """Return an unconnected driver for every device, on simulated connections where the bench file says so.

    `keep` receives all bytes on the connections; `note` the notes of drivers, with the role. `person` answers requests
    for manual actions.
    """
    wires: Wires = BenchWires(bench, laboratory)
    if keep is not None:
        wires = TracedWires(wires, keep)
    return {role: device_of(role, entry, wires, partial(note, role), person) for role, entry in bench.devices.items()}
