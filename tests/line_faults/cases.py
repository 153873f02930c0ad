"""The instruments of shipped benches, each with a way to make it read something new."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import Any

from bench.app.laboratory import Laboratory
from drivers.transport.address import Address

Vary = Callable[[Laboratory, Any, int], Awaitable[None]]
"""Given the laboratory, a second driver of the same instrument on a good line, and the number of the trial."""


@dataclass(frozen=True)
class Case:
    """One dialect on one wire.

    `checked` says whether the link has a checksum or a number in every answer. `call_s` is how long a reading may take
    at the most, whatever the line does; `patience_s` how long the driver waits for one answer. The channels `moving`
    are another value by the time they are compared. After `settles_s` nothing else moves any more.
    """

    bench: str
    role: str
    vary: Vary
    patience_s: float
    call_s: float
    checked: bool = False
    connection: str = ""
    device: Mapping[str, object] | None = None
    moving: frozenset[str] = frozenset()
    settles_s: float = 2.0

    @property
    def address(self) -> Address | None:
        """Another address than that of the bench file."""
        return Address.parse(self.connection) if self.connection else None


async def _air(laboratory: Laboratory, _twin: Any, trial: int) -> None:
    laboratory.world.ramp(20.0 + 0.37 * (trial % 50), math.inf)


async def _output(laboratory: Laboratory, twin: Any, trial: int) -> None:
    await twin.set(1.0 + 0.013 * (trial % 97), limit=0.15, output=True)


async def _current(laboratory: Laboratory, twin: Any, trial: int) -> None:
    await twin.set(1e-3 + 7e-6 * (trial % 97), limit=10.0, output=True)


async def _angle(laboratory: Laboratory, twin: Any, trial: int) -> None:
    role = twin.name if twin.name in laboratory.world.axes else None
    laboratory.world.move(3.7 * (trial % 90), 1e6, 1e9, role)


async def _nothing(laboratory: Laboratory, _twin: Any, _trial: int) -> None:
    """What it reads is never the same twice."""


def _chamber(driver: str, connection: str, *, checked: bool = False) -> Case:
    """Another chamber in the place of that of the first bench."""
    limits = {"temperature": {"min": "-50 °C", "max": "100 °C"}, "ramp_rate": {"max": "3 °C/min"}}
    device = {"driver": driver, "connection": connection, "limits": limits}
    return Case("simulated", "chamber", _air, 3.0, 20.0, checked=checked, device=device, settles_s=3600.0)


CASES = {
    "watlow_f4t, TCP": Case("simulated", "chamber", _air, 3.0, 15.0, settles_s=3600.0),
    "watlow_f4t, RTU": Case(
        "simulated",
        "chamber",
        _air,
        3.0,
        15.0,
        checked=True,
        connection="sim+serial:///dev/ttyS0?baud=9600",
        settles_s=3600.0,
    ),
    "espec_p300": _chamber("espec_p300", "sim+serial:///dev/ttyS0?baud=9600"),
    "simserv": _chamber("simserv", "sim+tcp://127.0.0.1:2049"),
    "cts": _chamber("cts", "sim+serial:///dev/ttyS0?baud=19200&parity=O", checked=True),
    "aerotech_ensemble": Case("simulated", "head", _angle, 2.0, 12.0),
    "scpi_supply": Case("simulated", "supply", _output, 2.0, 12.0),
    "keithley_6220": Case("simulated", "source", _current, 2.0, 12.0),
    "fluke_5700a": Case("channel", "source", _current, 5.0, 20.0, moving=frozenset({"on_time"})),
    "acutronic_acl": Case("gyro", "table", _angle, 1.0, 12.0),
}
