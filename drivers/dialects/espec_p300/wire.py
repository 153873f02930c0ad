"""Lines of an ESPEC P300 or SCP-220 controller ⇄ values, both directions; no I/O.

Sources: the driver published by the maker's American branch, and third-party drivers for the SH-641 and the PR-3J.
Lines end with CR LF. A query ends with `?`; a setting is answered by `OK:` and the setting, or refused by `NA:` and the
reason. Temperatures are in °C with one decimal.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

from drivers.kinds.chamber.refusal import Refusal
from drivers.kinds.chamber.tenths import as_stored
from drivers.protocols.texts import matched

T = TypeVar("T")

END = b"\r\n"
TYPE_QUERY, ROM_QUERY = "TYPE?", "ROM?"
TEMPERATURE_QUERY, MONITOR_QUERY, ALARM_QUERY = "TEMP?", "MON?", "ALARM?"
POWER_ON, CONSTANT_MODE = "POWER,ON", "MODE,CONSTANT"
OFF, STANDBY, CONSTANT = "OFF", "STANDBY", "CONSTANT"

STEADY_WITHIN_C = 0.25  # possible change of the air temperature between two answers: two steps of its resolution
REFUSALS: Mapping[str, str] = {
    "ADDR ERR": "wrong address",
    "CHB NOT READY": "the chamber is not ready for that",
    "CMD ERR": "an unknown command",
    "DATA NOT READY": "no such program",
    "DATA OUT OF RANGE": "a value beyond its limits",
    "INVALID REQ": "no such function",
    "PARA ERR": "a missing or invalid parameter",
    "PROTECT ON": "its settings are protected at the front panel",
}

_TEMPERATURE = r"(-?\d{1,3}\.\d)"
_TEMPERATURES = re.compile(",".join(4 * [_TEMPERATURE]), re.ASCII)
_MONITOR = re.compile(rf"{_TEMPERATURE},\d{{0,3}},([A-Z][A-Z ]*),(\d{{1,2}})", re.ASCII)
_TYPE = re.compile(r"(?:\w+,){1,2}(\w+),(\d{1,3}\.\d)", re.ASCII)
_ALARMS = re.compile(r"(\d{1,2})((?:,\d{1,3})*)", re.ASCII)


@dataclass(frozen=True, slots=True)
class Temperatures:
    """Answer to TEMP?, °C; the limits are those of the set point."""

    process_value_c: float
    set_point_c: float
    highest_c: float
    lowest_c: float

    def __str__(self) -> str:
        limits = f"limits {self.lowest_c:g} and {self.highest_c:g} °C"
        return f"{self.process_value_c:g} °C, set point {self.set_point_c:g} °C, {limits}"


@dataclass(frozen=True, slots=True)
class Monitor:
    """Answer to MON?: air temperature, °C, operating state, and number of alarms."""

    process_value_c: float
    mode: str
    alarms: int


def agree(one: Temperatures, other: Temperatures) -> bool:
    """Return whether two consecutive answers agree: only the air temperature may differ."""
    near = abs(one.process_value_c - other.process_value_c) <= STEADY_WITHIN_C
    return near and replace(one, process_value_c=other.process_value_c) == other


def set_point(temperature_c: float) -> str:
    """Command: set point."""
    return f"TEMP, S{as_stored(temperature_c):.1f}"


def addressed(command: str, address: int | None) -> str:
    """Add an RS-485 address to a command."""
    return command if address is None else f"{address},{command}"


def unless_refused(read: Callable[[str], T]) -> Callable[[bytes], T | Refusal]:
    """Decode an answer; Refused for a refusal, ValueError if it is neither."""

    def read_line(line: bytes) -> T | Refusal:
        text = line.decode("ascii")
        if not text.startswith("NA:"):
            return read(text)
        reason = text[3:].strip()
        return Refusal(f"NA:{reason}", REFUSALS.get(reason, ""))

    return read_line


def read_done(text: str) -> None:
    """Decode `OK:` and the setting."""
    if not text.startswith("OK:"):
        raise ValueError("neither OK: nor NA:")


def read_temperatures(text: str) -> Temperatures:
    """Decode `23.1,25.0,100.0,-40.0`."""
    return Temperatures(*map(float, matched(_TEMPERATURES, text, "not four temperatures").groups()))


def read_monitor(text: str) -> Monitor:
    """Decode `23.1,50,CONSTANT,0`; the humidity may be empty."""
    process_value, mode, alarms = matched(_MONITOR, text, "not temperature, humidity, mode and alarms").groups()
    return Monitor(float(process_value), mode, int(alarms))


def read_alarms(text: str) -> tuple[int, ...]:
    """Decode `2,1,7`: number of alarms, then the code of each."""
    count, codes = matched(_ALARMS, text, "not a number of alarms and their codes").groups()
    found = tuple(map(int, codes.split(",")[1:]))
    if len(found) != int(count):
        raise ValueError(f"{count} alarms and {len(found)} codes")
    return found


def read_type(text: str) -> str:
    """Decode the controller's name from `T,T,S2,160.0`: sensors, name, highest temperature."""
    return matched(_TYPE, text, "not sensors, controller and temperature").groups()[0]


def read_rom(text: str) -> str:
    """Decode the ROM version, a line of any format."""
    if not text.isprintable() or not text.strip():
        raise ValueError("not a version")
    return text.strip()
