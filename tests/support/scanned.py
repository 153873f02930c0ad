"""Every simulated instrument that a scan can find, alone at an address; what scans leave behind is looked at here."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from bench.config.load import load_file
from drivers.description import DriverDescription, known_drivers
from drivers.dialects.modbus_chamber.profile import ChamberProfile
from drivers.schema.fields import DocumentFile
from drivers.transport.address import Address
from drivers.transport.memory import Line
from simulators.faults.instrument_faults import FaultPlan
from simulators.instruments.setup import InstrumentSetup, make_instrument
from simulators.units.settings import WorldSettings
from simulators.world import World
from tests.support.lines import TappedWire
from tests.support.runs import ROOT
from tests.support.voltmeter import Meter

PROFILE = ROOT / "config/chambers/fictional.yaml"
ADDRESSES = {"tcp": "tcp://127.0.0.1:4000", "serial": "serial:///dev/ttyUSB0", "socket": "socket://127.0.0.1:4001"}


@dataclass(frozen=True)
class Case:
    """One simulated instrument at one kind of address; `options` are those that it is made with."""

    driver: str
    scheme: str
    options: Mapping[str, object] = field(default_factory=dict)
    name: str = ""

    def __str__(self) -> str:
        return f"{self.name or self.driver}-{self.scheme}"

    @property
    def description(self) -> DriverDescription:
        return known_drivers()[self.driver]

    @property
    def address(self) -> Address:
        return Address.parse(ADDRESSES[self.scheme])


def cases() -> list[Case]:
    """All of them: an instrument for each driver and each scheme, and kinds that differ on the wire."""
    found = [
        Case(name, scheme)
        for name, description in sorted(known_drivers().items())
        if description.recognition
        for scheme in sorted(description.schemes & ADDRESSES.keys())
    ]
    found += [Case("binder", "serial", {"controller": "mb2"}, "binder-mb2")]
    found += [Case("keithley_6220", "serial", {"terminator": end}, f"keithley-{end}") for end in ("cr", "lf")]
    found += [Case("fluke_5700a", "serial", {"terminator": end}, f"fluke-{end}") for end in ("cr", "lf")]
    found += [Case("acutronic_acl", "tcp", {"byte_order": "big"}, "acl-big")]
    found += [Case("watlow_f4t", "tcp", {"word_order": "high_first"}, "f4t-high-first")]
    return found


@cache
def profile() -> ChamberProfile:
    """The one that the simulated controller behind `modbus_chamber` has."""
    return load_file(PROFILE, ChamberProfile)


def simulated(case: Case) -> Any:
    """The instrument of a case, in the running loop."""
    if case.driver == "keysight_3458a":
        return Meter().instrument
    description = case.description
    recognition = description.recognised_by()
    assert recognition is not None
    given = {**recognition.starter.get("options", {}), **case.options}
    if case.driver == "modbus_chamber":
        given["profile"] = DocumentFile(PROFILE, profile())
    if case.driver == "binder":
        given = {"controller": "mb1", **given}
    now_s = asyncio.get_running_loop().time
    setup = InstrumentSetup(
        "device", World(WorldSettings(1, 9.8), now_s), FaultPlan(now_s=now_s),
        description.options.model_validate(given), is_serial_line=case.address.is_serial_line,
    )  # fmt: skip
    return make_instrument(description.simulator, setup)


class BehindALine:
    """An instrument at a serial line: it does not notice who opens the other end, and keeps half a message."""

    def __init__(self, instrument: Any) -> None:
        self.faults = instrument.faults
        self._session = instrument.session()

    def session(self) -> Any:
        return self._session


def wire_to(case: Case, instrument: Any) -> TappedWire:
    """A wire to it, as fast as its kind is."""
    if case.address.is_serial_line:
        return TappedWire(BehindALine(instrument), Line.serial(9600, 0.004))
    return TappedWire(instrument, Line(latency_s=0.002))


def standing(instrument: Any, ignored: Callable[[str], bool] = lambda _key: False) -> dict[str, str]:
    """Everything that an instrument remembers, as text: numbers, words, sets, and what its parts remember."""
    return {key: text for key, text in _remembered(instrument, "", set()) if not ignored(key)}


def _remembered(value: Any, path: str, seen: set[int]) -> list[tuple[str, str]]:
    if id(value) in seen:
        return []
    if isinstance(value, (int, float, str, bytes, type(None), tuple, list, dict, set, frozenset)) or not hasattr(
        value, "__dict__"
    ):
        return [(path, repr(value))] if " at 0x" not in repr(value) else []
    seen.add(id(value))
    parts = ((key, each) for key, each in vars(value).items() if key not in ("_world", "world", "faults", "_driven"))
    return [found for key, each in parts for found in _remembered(each, f"{path}.{key}", seen)]
