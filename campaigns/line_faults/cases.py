"""The instruments of shipped benches, each with a way to make it read something new."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property, lru_cache
from typing import Any

from bench.app.laboratory import Laboratory
from bench.app.request import load_bench_named
from bench.config.devices import DeviceEntry
from bench.config.load import load_file
from bench.config.models import BenchFile
from drivers.description import IdentityPin, known_drivers
from drivers.dialects.framed.profile import FrameProfile
from drivers.dialects.modbus_chamber.profile import ChamberProfile
from drivers.schema.fields import DocumentFile
from drivers.transport.address import Address
from simulators.faults.instrument_faults import FaultPlan
from tests.support.runs import ROOT

PROFILE = ROOT / "config/chambers/fictional.yaml"
FRAMES = ROOT / "config/tables/fictional.yaml"
Vary = Callable[[Laboratory, Any, Any, int], Awaitable[object]]
"""Given the laboratory, a second driver of the instrument on a good line, the one that is tried, and which trial."""


class Link(StrEnum):
    """What sees to it that what arrives is what was said."""

    CHECKSUM = "a checksum of its own"
    TCP = "TCP"  # between its two ends; what an instrument garbles before it sends it is beyond that
    NOTHING = "nothing"  # what enters a result is then asked twice


@lru_cache
def bench_named(name: str) -> BenchFile:
    """A shipped bench; reading one takes as long as a hundred readings."""
    return load_bench_named(name).bench


@dataclass(frozen=True)
class Case:
    """One dialect on one wire.

    `checked` says whether the dialect has a checksum in every answer. `call_s` is how long a reading may take
    at the most, whatever the line does; `patience_s` how long the driver waits for one answer. The channels `moving`
    are another value by the time they are compared. A `driver` with its `options` is another instrument in the place of
    that of the bench. After `settles_s` nothing else moves any more. Without `tells_each` what is dropped is told now
    and then, and not each time.
    """

    bench: str
    role: str
    vary: Vary
    patience_s: float
    call_s: float
    checked: bool = False
    connection: str = ""
    driver: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    moving: frozenset[str] = frozenset()
    settles_s: float = 2.0
    tells_each: bool = True

    @property
    def entry(self) -> DeviceEntry:
        """The instrument of the bench file at another address, or another one in its place."""
        entry = bench_named(self.bench).devices[self.role]
        update: dict[str, Any] = {"connection": Address.parse(self.connection)} if self.connection else {}
        if self.driver:
            options = known_drivers()[self.driver].options.model_validate(dict(self.options))
            update |= {"driver": self.driver, "options": options, "identity": IdentityPin()}
        return entry.model_copy(update=update)

    @cached_property
    def link(self) -> Link:
        """What protects its answers."""
        if self.checked:
            return Link.CHECKSUM
        return Link.NOTHING if self.entry.connection.is_serial_line else Link.TCP


async def _air(laboratory: Laboratory, _twin: Any, _driver: Any, trial: int) -> None:
    laboratory.world.ramp(20.0 + 0.37 * (trial % 50), math.inf)


async def set_volts(driver: Any, trial: int) -> float:
    """Another level of a supply, V."""
    level_v = 1.0 + 0.013 * (trial % 97)
    await driver.set(level_v, limit=0.15, output=True)
    return level_v


async def set_amperes(driver: Any, trial: int) -> float:
    """Another level of a current source, A."""
    level_a = 1e-3 + 7e-6 * (trial % 97)
    await driver.set(level_a, limit=10.0, output=True)
    return level_a


async def move(driver: Any, trial: int) -> float:
    """Another angle of an axis, °."""
    angle_deg = 3.7 * (1 + trial % 90)
    await driver.move_to(angle_deg, approach="direct", settle_s=0.0)
    return angle_deg


async def _output(_laboratory: Laboratory, twin: Any, _driver: Any, trial: int) -> None:
    await set_volts(twin, trial)


async def _current(_laboratory: Laboratory, twin: Any, _driver: Any, trial: int) -> None:
    await set_amperes(twin, trial)


async def _stand(_laboratory: Laboratory, _twin: Any, driver: Any, trial: int) -> None:
    """The axis stands where the driver has sent it, so that it knows the angle to be one that does not change."""
    await move(driver, trial)


async def _angle(laboratory: Laboratory, twin: Any, _driver: Any, trial: int) -> None:
    role = twin.name if twin.name in laboratory.world.axes else None
    laboratory.world.move(3.7 * (trial % 90), 1e6, 1e9, role)


async def _volts(laboratory: Laboratory, twin: Any, driver: Any, trial: int) -> None:
    """A reading that stays, since no two of a real one are alike."""
    meter = laboratory.instruments[twin.name]
    meter.faults = FaultPlan(now_s=laboratory.world.now)
    await _angle(laboratory, twin, driver, trial)
    await twin.poll()
    meter.faults.begin("frozen")


def _chamber(
    driver: str, connection: str, patience_s: float = 3.0, call_s: float = 0.0, *, checked: bool = True,
    **options: object,
) -> Case:  # fmt: skip
    """A chamber of another dialect in the place of the one of the demonstration bench."""
    return Case(
        "simulated", "chamber", _air, patience_s, call_s or 8.0, checked=checked, connection=connection,
        driver=driver, options=options, settles_s=3600.0,
    )  # fmt: skip


def _framed(connection: str) -> Case:
    """A rate table that speaks in frames in the place of the one of the demonstration bench."""
    options = {
        "profile": DocumentFile(FRAMES, load_file(FRAMES, FrameProfile)), "answer_timeout": "0.5 s", "rate": "20 °/s",
        "acceleration": "1000 °/s²", "settle": {"band": "1 arcsec", "hold": "1 s"},
    }  # fmt: skip
    return Case(
        "gyro",
        "table",
        _angle,
        0.5,
        5.0,
        checked=True,
        connection=connection,
        driver="framed_table",
        options=options,
        tells_each=False,
    )


_PORT = "sim+serial:///dev/ttyS0?baud=9600"
_THERMOMETERS = {
    "channels": {"air": {"channel": 101, "sensor": "rtd"}, "wall": {"channel": 102, "sensor": "tc", "type": "K"}}
}
_FICTIONAL = DocumentFile(PROFILE, load_file(PROFILE, ChamberProfile))

CASES = {
    "watlow_f4t, TCP": Case("simulated", "chamber", _air, 3.0, 8.0, settles_s=3600.0),
    "watlow_f4t, RTU": Case("simulated", "chamber", _air, 3.0, 8.0, checked=True, connection=_PORT, settles_s=3600.0),
    "espec_p300": _chamber("espec_p300", _PORT, checked=False),
    "simserv": _chamber("simserv", "sim+tcp://127.0.0.1:2049", call_s=10.0, checked=False),
    "cts": _chamber("cts", "sim+serial:///dev/ttyS0?baud=19200&parity=O"),
    "watlow_f4": _chamber("watlow_f4", _PORT, power_event=1),
    "binder": _chamber("binder", _PORT, controller="mb1", range={"min": "-60 °C", "max": "180 °C"}),
    "modbus_chamber, TCP": _chamber("modbus_chamber", "sim+tcp://127.0.0.1:1502", checked=False, profile=_FICTIONAL),
    "modbus_chamber, RTU": _chamber("modbus_chamber", _PORT, profile=_FICTIONAL),
    "aerotech_ensemble": Case("simulated", "head", _angle, 2.0, 6.0),
    "newport_xps": Case("indexing_telemetry", "head", _angle, 2.0, 6.0),
    "aerotech_ensemble, serial": Case("simulated", "head", _stand, 2.0, 6.0, connection=_PORT),
    "agilent_34970a": Case(
        "simulated",
        "source",
        _air,
        2.0,
        12.0,
        connection=_PORT,
        driver="agilent_34970a",
        options=_THERMOMETERS,
        settles_s=3600.0,
    ),
    "keysight_3458a": Case("volts", "dvm", _volts, 1.9, 14.0),
    "scpi_supply": Case("simulated", "supply", _output, 2.0, 6.0),
    "scpi_supply, serial": Case("simulated", "supply", _output, 2.0, 6.0, connection=_PORT),
    "yokogawa_gs200": Case(
        "simulated",
        "source",
        _current,
        2.0,
        12.0,
        connection="sim+tcp://127.0.0.1:7655",
        driver="yokogawa_gs200",
        options={"range": "10 mA", "compliance": "10 V"},
    ),
    "keithley_6220": Case("simulated", "source", _current, 2.0, 6.0),
    "fluke_5700a": Case("channel", "source", _current, 5.0, 10.0, moving=frozenset({"on_time"})),
    "acutronic_acl": Case("gyro", "table", _angle, 1.0, 4.0),
    "framed_table, TCP": _framed("sim+tcp://127.0.0.1:9000"),
    "framed_table, serial": _framed("sim+serial:///dev/ttyS0?baud=115200"),
}
