"""Agilent 34970A messages and answers: scan setup and readings.

Sources: excerpts of the user's guide, and published sessions. An answer to FETC? has for each channel the reading with
its unit, the seconds since the start of the scan, and the channel: `+2.12468981E+01 C,00000000.370,101`. The readings
of a scan started by INIT stay in memory until the next one, and FETC? waits for its end; those of READ? are not stored.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntFlag
from typing import Literal, NamedTuple

from drivers.protocols import scpi
from drivers.protocols.texts import matched
from drivers.values import Identity

Kind = Literal["TC", "RTD", "FRTD"]

# Headers for the simulator
CONFIGURE = "CONFigure:TEMPerature"
SCAN = "ROUTe:SCAN"
KIND = "[SENSe:]TEMPerature:TRANsducer:TYPE"
TYPES = {kind: f"[SENSe:]TEMPerature:TRANsducer:{kind}:TYPE" for kind in ("TC", "RTD", "FRTD")}
UNIT = "UNIT:TEMPerature"
CONDITION = "STATus:OPERation:CONDition"
CARD = "SYSTem:CTYPe"

REMOTE = ":SYST:REM"  # on RS-232 only: without it the front panel stays in use
SCAN_ONCE, SCANNED = b":INIT;:FETC?", b":FETC?"
SLOTS = (100, 200, 300)
PREPARE = (
    ":ABOR",
    ":TRIG:SOUR IMM;:TRIG:COUN 1",
    ":FORM:READ:UNIT ON;:FORM:READ:TIME ON;:FORM:READ:TIME:TYPE REL;:FORM:READ:CHAN ON;:FORM:READ:ALAR OFF",
)
OVERLOAD = 9.9e37

_READING = re.compile(r"([+-]\d\.\d{8}E[+-]\d{2}) C", re.ASCII)
_SINCE = re.compile(r"\d{8}\.\d{3}", re.ASCII)
_CHANNEL = re.compile(r"[1-3]\d\d", re.ASCII)
_CHANNELS = re.compile(r"\(@((?:[1-3]\d\d(?:,[1-3]\d\d)*)?)\)", re.ASCII)


class Condition(IntFlag):
    """Used bit of the operation condition register."""

    SCANNING = 1 << 4


class Sensor(NamedTuple):
    """Sensor of a channel: a thermocouple of type K and so on, or a two- or four-wire resistor of type 85 or 91."""

    channel: int
    kind: Kind
    type: str


class Sample(NamedTuple):
    """Reading of a channel in a scan: seconds since its start, and °C, None for an open or overloaded sensor."""

    channel: int
    since_s: float
    temperature_c: float | None


@dataclass(frozen=True, slots=True)
class State:
    """The scan list, and whether a scan is running."""

    channels: tuple[int, ...]
    kinds: tuple[str, ...]
    units: tuple[str, ...]
    scanning: bool


def listed(channels: Sequence[int]) -> str:
    """Format a channel list: `(@101,102)`."""
    return f"(@{','.join(map(str, channels))})"


def set_up(sensors: Sequence[Sensor]) -> list[str]:
    """Messages that set up a scan of the sensors, in channel order; CONF replaces the scan list."""
    channels = [sensor.channel for sensor in sensors]
    return [
        *PREPARE,
        *(f":CONF:TEMP {kind},{type_},{listed([channel])}" for channel, kind, type_ in sensors),
        f":UNIT:TEMP C,{listed(channels)}",
        f":ROUT:SCAN {listed(channels)}",
    ]


def state_query(sensors: Sequence[Sensor]) -> bytes:
    """Query of the state of the sensors' channels."""
    channels = listed([sensor.channel for sensor in sensors])
    return f":ROUT:SCAN?;:TEMP:TRAN:TYPE? {channels};:UNIT:TEMP? {channels};:STAT:OPER:COND?".encode()


def type_query(sensor: Sensor) -> bytes:
    """Query of the type of one sensor."""
    return f":TEMP:TRAN:{sensor.kind}:TYPE? {listed([sensor.channel])}".encode()


def state_when(sensors: Sequence[Sensor]) -> State:
    """State of a scanner with this setup that is idle."""
    return State(
        tuple(sensor.channel for sensor in sensors), tuple(sensor.kind for sensor in sensors), ("C",) * len(sensors),
        False,
    )  # fmt: skip


def read_state(line: bytes) -> State:
    """Decode the answer to `state_query`; ValueError."""
    scan, kinds, units, condition = scpi.answers(line, 4)
    scanning = Condition.SCANNING in Condition(scpi.integer(condition) & Condition.SCANNING)
    return State(read_channels(scan), tuple(kinds.split(",")), tuple(units.split(",")), scanning)


def read_channels(text: str) -> tuple[int, ...]:
    """Decode the channels of a definite block like `#214(@101,102,103)`; ValueError."""
    if not re.match(r"#[1-9]", text, re.ASCII):
        raise ValueError("not a block")
    digits = int(text[1])
    length, body = text[2 : 2 + digits], text[2 + digits :]
    if not re.fullmatch(rf"\d{{{digits}}}", length, re.ASCII) or int(length) != len(body):
        raise ValueError(f"a block of {length} characters with {len(body)}")
    listed = matched(_CHANNELS, body, f"'{body}' is no list of channels")[1]
    return tuple(map(int, listed.split(","))) if listed else ()


def read_type(line: bytes) -> str:
    """Decode the type of a sensor: a letter, or 85 or 91 in any number format; ValueError."""
    text = line.decode("ascii").strip(" ")
    return text if re.fullmatch("[A-Z]", text, re.ASCII) else f"{scpi.number(text):g}"


def read_scan(line: bytes) -> list[Sample]:
    """Decode the answer to FETC?, channel by channel; ValueError unless every field has its exact format."""
    fields = line.decode("ascii").split(",")
    if len(fields) % 3:
        raise ValueError(f"{len(fields)} fields are no whole readings")
    return [_sample(*fields[first : first + 3]) for first in range(0, len(fields), 3)]


def _sample(reading: str, since: str, channel: str) -> Sample:
    match = _READING.fullmatch(reading)
    if match is None or not _SINCE.fullmatch(since) or not _CHANNEL.fullmatch(channel):
        raise ValueError(f"'{reading},{since},{channel}' is not a reading in C, a time and a channel")
    value_c = float(match[1])
    return Sample(int(channel), float(since), None if abs(value_c) >= OVERLOAD else value_c)


def read_identity(line: bytes) -> Identity:
    """Decode the answer to *IDN?; a 34970A reports 0 for its unknown serial number. ValueError."""
    found = scpi.identity(line)
    return found._replace(serial="", verified=False) if found.serial == "0" else found


def read_card(line: bytes) -> str:
    """Decode the model in a slot, "0" for none; ValueError."""
    fields = line.decode("ascii").split(",")
    if len(fields) != 4:
        raise ValueError("not maker,model,serial,firmware")
    return fields[1].strip()
