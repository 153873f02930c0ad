"""The instrument of every driver, once: where the contract kit, bad lines, orders and swaps of instruments find it.

Who tries it asks `tried`, which fails when an installed driver is not here. What does not try an instrument says why.
"""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Literal, NamedTuple

from bench.app.request import load_bench_named
from bench.config.devices import DeviceEntry
from bench.config.load import load_file
from bench.config.models import BenchFile
from drivers.description import IdentityPin, Nothing, known_drivers
from drivers.dialects.framed.profile import FrameProfile
from drivers.dialects.modbus_chamber.profile import ChamberProfile
from drivers.schema.fields import DocumentFile
from drivers.transport.address import Address
from tests.support import handling as do
from tests.support.chambers import F4T_DIALECTS
from tests.support.chambers import Dialect as ChamberDialect
from tests.support.chambers_ascii import CTS, CTS_TARGET, P300, SIMSERV
from tests.support.chambers_modbus import BINDER_DIALECTS, F4_DIALECTS, PROFILE_DIALECTS
from tests.support.runs import ROOT

What = Literal["contract", "bad lines", "orders", "swaps"]


class Order(NamedTuple):
    """How one is given, what of it is heard on the wire, and the reading that then has the value it was given."""

    give: Callable[[Any, int], Awaitable[float | None]]
    heard: re.Pattern[bytes]
    reading: str = ""


@dataclass(frozen=True)
class OnLine:
    """One line on which answers suffer.

    `vary` makes the instrument read something new; a reading takes at most `call_s`, whatever the line does. The line
    is that of the instrument unless a `connection` is given, with a `label` where there are several. `checked` says
    whether the dialect has a checksum in every answer.
    """

    vary: do.Vary
    call_s: float
    label: str = ""
    connection: str = ""
    checked: bool = False
    order: Order | None = None


@dataclass(frozen=True)
class Swap:
    """Means to distinguish two instruments of a kind, and the messages of their drivers and a second master.

    `name` gives an instrument the name by which its wire tells the one of a number, 0 or 1, from the other; without, it
    has another serial number.
    """

    act: do.Act
    meddle: do.Meddle
    asks: Callable[[bytes], bool] = do.is_scpi_query
    name: Callable[[Any, int], object] | None = None


@dataclass(frozen=True)
class Instrument:
    """One instrument in a shipped bench, or in the place of another one there at its own connection.

    `tells` are those of "maker", "model", "serial", "firmware" that its wire tells. `client_timeout_s` is how long its
    driver waits for an answer; 0 where nothing is asked. `beside` is for an instrument that the bench does not have, in
    the cable of its source.

    On bad `lines` the channels `moving` are another value by the time they are compared, and after `settles_s` nothing
    else moves any more; without `tells_each` what is dropped is told now and then, and not each time. Chambers have
    `dialects` for swaps, others a `swap`. `apart` is why it is left out.
    """

    bench: str
    role: str
    tells: str = ""
    client_timeout_s: float = 2.0
    connection: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    beside: bool = False
    lines: tuple[OnLine, ...] = ()
    moving: frozenset[str] = frozenset()
    settles_s: float = 2.0
    tells_each: bool = True
    dialects: tuple[ChamberDialect, ...] = ()
    swap: Swap | None = None
    apart: Mapping[What, str] = field(default_factory=dict)

    def entry(self, driver: str, connection: str = "") -> DeviceEntry:
        """Its entry in the bench file, and nothing stated of who it is."""
        entry = bench_named(self.bench).devices["source" if self.beside else self.role]
        update: dict[str, Any] = {"identity": IdentityPin()}
        if entry.driver != driver:
            options = known_drivers()[driver].options.model_validate(dict(self.options))
            update |= {"driver": driver, "options": options}
        if self.beside:
            update |= {"limits": Nothing(), "safe": Nothing(), "calibration": None}
        if connection or self.connection:
            update["connection"] = Address.parse(connection or self.connection)
        return entry.model_copy(update=update)

    @property
    def tried_by(self) -> set[What]:
        """Action that tests it."""
        tries: dict[What, object] = {
            "contract": "contract" not in self.apart, "bad lines": self.lines,
            "orders": any(line.order for line in self.lines), "swaps": self.swap or self.dialects,
        }  # fmt: skip
        return {what for what, has in tries.items() if has}


@lru_cache
def bench_named(name: str) -> BenchFile:
    """A shipped bench; reading one takes as long as a hundred readings."""
    return load_bench_named(name).bench


def tried(what: What) -> dict[str, Instrument]:
    """The instruments of all drivers but those that are left out with a reason, by the name of the driver."""
    if differing := known_drivers().keys() ^ INSTRUMENTS.keys():
        raise AssertionError(f"{', '.join(sorted(differing))}: not both installed and in {__name__}")
    for name, instrument in INSTRUMENTS.items():
        if (what in instrument.tried_by) is (what in instrument.apart):
            raise AssertionError(f"{name}: {what} must try it, or {__name__} must say why not")
    return {name: instrument for name, instrument in INSTRUMENTS.items() if what in instrument.tried_by}


_PORT = "sim+serial:///dev/ttyS0?baud=9600"
_FAST_PORT = "sim+serial:///dev/ttyS0?baud=115200"
_TCP_WRITE = Order(do.hold, re.compile(rb"(?s)^.{7}[\x06\x10].*"))  # function 6 or 16
_RTU_WRITE = Order(do.hold, re.compile(rb"(?s)^.[\x06\x10].*"))
_SET = re.compile(rb"(?:VOLT|CURR|LEV|OUTP) [^;]*")
_FRAME_MOVE = Order(do.move, re.compile(rb"(?s)\xaa\x55\x24.{12}"), "angle")
_ENSEMBLE_MOVE = Order(do.move, re.compile(rb"MOVEABS.*"), "angle")
_SENDS: Mapping[What, str] = {
    "bad lines": "it sends by itself; bad buses have a campaign of their own", "orders": "it takes none",
    "swaps": "nothing is told to it",
}  # fmt: skip
_MEASURES: Mapping[What, str] = {"orders": "it only measures", "swaps": "it only measures"}
_FRAMES = ROOT / "config/tables/fictional.yaml"
_FRAMED = {
    "profile": DocumentFile(_FRAMES, load_file(_FRAMES, FrameProfile)), "answer_timeout": "0.5 s", "rate": "20 °/s",
    "acceleration": "1000 °/s²", "settle": {"band": "1 arcsec", "hold": "1 s"},
}  # fmt: skip
_REGISTERS = ROOT / "config/chambers/fictional.yaml"
_AIR_S = 3600.0  # in which the air of a chamber comes to rest


def _chamber(tells: str, connection: str, dialects: tuple[ChamberDialect, ...], *lines: OnLine,
             client_timeout_s: float = 3.0, **options: object) -> Instrument:  # fmt: skip
    """In the place of the chamber of the demonstration bench."""
    return Instrument(
        "simulated", "chamber", tells, client_timeout_s, connection, options, lines=lines, settles_s=_AIR_S,
        dialects=dialects,
    )  # fmt: skip


INSTRUMENTS: Mapping[str, Instrument] = {
    "acutronic_acl": Instrument(
        "gyro", "table", "maker model firmware", client_timeout_s=1.0,
        lines=(OnLine(do.other_angle, 4.0, order=Order(do.move, re.compile(rb":DEM:POS.*"), "angle")),),
        swap=Swap(
            do.turn, do.told(":DEM:RATE 1,{}\n"),
            name=lambda acutrol, n: setattr(acutrol, "_identity", acutrol._identity.replace(",0,", f",{1000 + n},")),
        ),
    ),
    "aerotech_ensemble": Instrument(
        "simulated", "head",
        lines=(
            OnLine(do.other_angle, 6.0, order=_ENSEMBLE_MOVE),
            OnLine(do.standing_at_another, 6.0, "serial", _PORT, order=_ENSEMBLE_MOVE),
        ),
        swap=Swap(
            do.go, do.told("MOVEABS X {} F20\n"), do.asks_by(rb"GETPARM|PFBK|AXISSTATUS|AXISFAULT"),
            name=lambda ensemble, n: ensemble._parameters.update(COUNTSPERUNIT=str(1_000_000 + n)),
        ),
    ),
    "agilent_34970a": Instrument(
        "simulated", "source", "maker model firmware", connection="sim+tcp://127.0.0.1:5025",
        options={"channels": {
            "air": {"channel": 101, "sensor": "rtd"}, "wall": {"channel": 102, "sensor": "tc", "type": "K"},
        }},
        lines=(OnLine(do.other_air, 12.0, connection=_PORT),), settles_s=_AIR_S, apart=_MEASURES,
    ),
    "binder": _chamber(
        "", _PORT, BINDER_DIALECTS, OnLine(do.other_air, 8.0, checked=True, order=_RTU_WRITE), client_timeout_s=1.0,
        controller="mb1", range={"min": "-60 °C", "max": "180 °C"},
    ),
    "can_counter": Instrument("simulated", "counter", client_timeout_s=0.0, apart=_SENDS),
    "can_telemetry": Instrument("channel_telemetry", "telemetry", client_timeout_s=0.0, apart=_SENDS),
    "cts": _chamber(
        "firmware", "sim+serial:///dev/ttyS0?baud=19200&parity=O", (CTS, CTS_TARGET),
        OnLine(do.other_air, 8.0, checked=True, order=Order(do.hold, re.compile(rb"\xe1\xb0\xa0.*"))),  # "a0 "
    ),
    "espec_p300": _chamber(
        "model firmware", _PORT, (P300,), OnLine(do.other_air, 8.0, order=Order(do.hold, re.compile(rb"TEMP, S.*")))
    ),
    "fluke_5700a": Instrument(
        "channel", "source", "maker model serial firmware", client_timeout_s=5.0,
        lines=(
            OnLine(do.other_amperes, 10.0, order=Order(do.set_amperes, re.compile(rb"OUT [^\r]*|OPER"), "current")),
        ),
        moving=frozenset({"on_time"}), swap=Swap(do.give_amperes, do.told("OUT {}E-3 A, 0 HZ\r\n")),
    ),
    "framed_head": Instrument(
        "simulated", "head", "serial", 0.5, _FAST_PORT, _FRAMED,
        apart=dict.fromkeys(("bad lines", "orders", "swaps"), "it has the line of framed_table"),
    ),
    "framed_table": Instrument(
        "gyro", "table", "serial", 0.5, "sim+tcp://127.0.0.1:9000", _FRAMED,
        lines=(
            OnLine(do.other_angle, 5.0, "TCP", checked=True, order=_FRAME_MOVE),
            OnLine(do.other_angle, 5.0, "serial", _FAST_PORT, checked=True, order=_FRAME_MOVE),
        ),
        tells_each=False, swap=Swap(do.turn, do.turned_by_frame, do.asks_by(rb"\xaa\x55\x10")),
    ),
    "keithley_6220": Instrument(
        "simulated", "source", "maker model serial firmware",
        lines=(OnLine(do.other_amperes, 6.0, order=Order(do.set_amperes, _SET, "current")),),
        swap=Swap(do.give_amperes, do.told(":SOUR:CURR {}E-3\r\n")),
    ),
    "keysight_3458a": Instrument(
        "volts", "dvm", "maker model firmware", lines=(OnLine(do.other_reading, 14.0),), apart=_MEASURES
    ),
    "keysight_3458a_ammeter": Instrument(
        "channel", "dmm", "maker model firmware", connection="sim+tcp://127.0.0.1:1235", options={"range": "10 mA"},
        beside=True, apart=_MEASURES | {"bad lines": "it has the line of keysight_3458a"},
    ),
    "modbus_chamber": _chamber(
        "", "sim+tcp://127.0.0.1:1502", PROFILE_DIALECTS, OnLine(do.other_air, 8.0, "TCP", order=_TCP_WRITE),
        OnLine(do.other_air, 8.0, "RTU", _PORT, checked=True, order=_RTU_WRITE),
        profile=DocumentFile(_REGISTERS, load_file(_REGISTERS, ChamberProfile)),
    ),
    "newport_xps": Instrument(
        "indexing_telemetry", "head", "model firmware",
        lines=(OnLine(do.other_angle, 6.0, order=Order(do.move, re.compile(rb"GroupMoveAbsolute.*"), "angle")),),
        swap=Swap(
            do.go, do.told("GroupMoveAbsolute(HEAD.Pos,{})"), do.asks_by(rb"\w+(?:Get|Read)\("),
            name=lambda xps, n: setattr(xps, "firmware", xps.firmware.replace("V1", f"V{n + 1}") + f" {n}"),
        ),
    ),
    "operator_head": Instrument(
        "by_hand", "head", apart=dict.fromkeys(("contract", "bad lines", "orders", "swaps"), "a person has no wire")
    ),
    "scpi_supply": Instrument(
        "simulated", "supply", "maker model serial firmware",
        lines=(
            OnLine(do.other_volts, 6.0, order=Order(do.set_volts, _SET, "voltage")),
            OnLine(do.other_volts, 6.0, "serial", _PORT, order=Order(do.set_volts, _SET, "voltage")),
        ),
        swap=Swap(do.give_volts, do.told("VOLT {}1\n")),
    ),
    "simserv": _chamber(
        "model serial", "sim+tcp://127.0.0.1:2049", (SIMSERV,),
        OnLine(do.other_air, 10.0, order=Order(do.hold, re.compile(rb"11001.*"))),
    ),
    "watlow_f4": _chamber(
        "firmware", _PORT, F4_DIALECTS, OnLine(do.other_air, 8.0, checked=True, order=_RTU_WRITE), power_event=1
    ),
    "watlow_f4t": _chamber(
        "", "", F4T_DIALECTS, OnLine(do.other_air, 8.0, "TCP", order=_TCP_WRITE),
        OnLine(do.other_air, 8.0, "RTU", _PORT, checked=True, order=_RTU_WRITE),
    ),
    "yokogawa_gs200": Instrument(
        "simulated", "source", "maker model serial firmware", connection="sim+tcp://127.0.0.1:7655",
        options={"range": "10 mA", "compliance": "10 V"},
        lines=(OnLine(do.other_amperes, 12.0, order=Order(do.set_amperes, _SET, "current")),),
        swap=Swap(do.give_amperes, do.told(":SOUR:LEV {}E-3\n")),
    ),
}  # fmt: skip
