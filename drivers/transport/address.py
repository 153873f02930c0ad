"""Addresses of instruments.

`tcp://host:port` is a TCP connection, `serial:///dev/ttyUSB0?baud=9600` a serial line, and
`slcan:///dev/ttyACM0?bitrate=500000` a CAN adapter on one. `socket://host:port` is a serial line behind a TCP serial
server, `socketcand://host:port/can0` a CAN bus behind one, `log:bus.blf` the frames recorded in a file; its path is
relative to the bench file. `person:operator` is the operator, who is prompted.

`sim+` before an address connects to the simulator, inside the same process.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from drivers.quantity.units import quoted
from drivers.schema.suggest import did_you_mean

_SIMULATED = "sim+"
_TCP = re.compile(r"//(?:(?P<host>\w(?:[\w.-]{0,252}\w)?)|\[(?P<v6>[0-9a-fA-F:.]{2,45})\]):(?P<port>\d{1,5})", re.ASCII)
_DEVICE_FILE = re.compile(r"//(?P<path>/[^\x00-\x1f\x7f#]+)")
_INTERFACE = re.compile(r"(?P<path>\w+/[^\x00-\x1f\x7f#/]+)", re.ASCII)
_PERSON = re.compile(r"(?P<path>\w+)", re.ASCII)
_TCP_BUS = re.compile(rf"{_TCP.pattern}/(?P<path>[\w.-]{{1,15}})", re.ASCII)
_FILE = re.compile(r"(?://)?(?P<path>(?<=//)/[^\x00-\x1f\x7f#]+|(?<!/)[^/\x00-\x1f\x7f#][^\x00-\x1f\x7f#]*)")
_NUMBER = re.compile("[1-9][0-9]{0,7}")
_ANY_NUMBER: tuple[str, ...] = ()
_SERIAL_OPTIONS: Mapping[str, tuple[str, ...]] = {
    "baud": _ANY_NUMBER,
    "bytesize": ("5", "6", "7", "8"),
    "parity": ("N", "E", "O", "M", "S"),
    "stopbits": ("1", "2"),
    "flow": ("none", "rtscts", "xonxoff"),
    "rs485": ("adapter", "rts"),
}


class Scheme(NamedTuple):
    """Format of addresses of one kind: `form` follows the colon; options without listed values are numbers."""

    form: re.Pattern[str]
    options: Mapping[str, tuple[str, ...]]
    example: str


SCHEMES: Mapping[str, Scheme] = {
    "tcp": Scheme(_TCP, {}, "tcp://192.168.1.10:502"),
    "socket": Scheme(_TCP, {"baud": _ANY_NUMBER}, "socket://192.168.1.20:4001"),
    "serial": Scheme(_DEVICE_FILE, _SERIAL_OPTIONS, "serial:///dev/ttyUSB0?baud=9600"),
    "slcan": Scheme(_DEVICE_FILE, {"bitrate": _ANY_NUMBER, "baud": _ANY_NUMBER}, "slcan:///dev/ttyACM0?bitrate=500000"),
    "can": Scheme(_INTERFACE, {"bitrate": _ANY_NUMBER}, "can:socketcan/can0?bitrate=500000"),
    "person": Scheme(_PERSON, {}, "person:operator"),
    "socketcand": Scheme(_TCP_BUS, {"bitrate": _ANY_NUMBER}, "socketcand://192.168.1.30:29536/can0"),
    "log": Scheme(_FILE, {}, "log:recorded/bus.blf"),
}


class AddressError(ValueError):
    """Text that is not an address."""


@dataclass(frozen=True, slots=True)
class Address:
    """One end of a wire. TCP has `host` and `port`; a file, `can:INTERFACE/CHANNEL`, a bus or a person has `path`."""

    scheme: str
    host: str = ""
    port: int = 0
    path: str = ""
    options: Mapping[str, str] = field(default_factory=dict)
    simulated: bool = False

    @classmethod
    def parse(cls, text: str) -> Address:
        """Parse `text`; AddressError states the problem."""
        scheme, colon, rest = text.removeprefix(_SIMULATED).partition(":")
        if not colon or scheme not in SCHEMES:
            examples = " or ".join(SCHEMES[known].example for known in ("tcp", "serial"))
            raise AddressError(f"{quoted(text)} is not an address; expected one like {examples}")
        form, known_options, example = SCHEMES[scheme]
        where, _, query = rest.partition("?")
        found = form.fullmatch(where)
        parts = found.groupdict(default="") if found else {}
        port = int(parts.get("port", 0))
        if not found or ("port" in form.groupindex) != (0 < port < 65536):
            raise AddressError(f"{quoted(text)} is not a {scheme} address; expected one like {example}")
        return cls(
            scheme,
            host=parts.get("host", "") or parts.get("v6", ""),
            port=port,
            path=parts.get("path", ""),
            options=_options(text, query, known_options),
            simulated=text.startswith(_SIMULATED),
        )

    def option(self, name: str, default: int) -> int:
        """Integer option; AddressError if it is no integer."""
        if name not in self.options:
            return default
        text = self.options[name]
        if _NUMBER.fullmatch(text) is None:
            raise AddressError(f"{self}: '{name}={text}' is not a whole number")
        return int(text)

    @property
    def is_person(self) -> bool:
        """True if the connection is a person."""
        return self.scheme == "person"

    @property
    def is_serial_line(self) -> bool:
        """True for a serial line, on this machine or behind a TCP serial server."""
        return self.scheme in ("serial", "socket")

    def as_simulated(self) -> Address:
        """The same address with the simulator at its other end."""
        return replace(self, simulated=True)

    @property
    def is_recording(self) -> bool:
        """True for recorded frames: they have no time of their own."""
        return self.scheme == "log"

    @property
    def is_local(self) -> bool:
        """True if this machine itself could be the other end: loopback, or a file that is not in /dev."""
        if self.is_recording:
            return False
        is_file = self.path.startswith("/")
        return self.host in ("localhost", "127.0.0.1", "::1") or (is_file and not self.path.startswith("/dev/"))

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        where = f"//{host}:{self.port}{'/' if self.path else ''}{self.path}" if self.port else self.path
        if self.path.startswith("/"):
            where = f"//{self.path}"
        query = "&".join(f"{key}={value}" for key, value in self.options.items())
        return f"{_SIMULATED if self.simulated else ''}{self.scheme}:{where}" + (f"?{query}" if query else "")


def _options(text: str, query: str, known: Mapping[str, tuple[str, ...]]) -> Mapping[str, str]:
    options: dict[str, str] = {}
    for part in query.split("&") if query else ():
        key, _, value = part.partition("=")
        if key not in known:
            raise AddressError(f"{quoted(text)} has an unknown option {quoted(key)}{did_you_mean(key, known)}")
        if key in options:
            raise AddressError(f"{quoted(text)} has the option '{key}' twice")
        if choices := known[key]:
            fits, expected = value in choices, did_you_mean(value, choices)
        else:
            fits, expected = _NUMBER.fullmatch(value) is not None, "; expected a whole number"
        if not fits:
            raise AddressError(f"{quoted(text)}: the option '{key}' cannot be {quoted(value)}{expected}")
        options[key] = value
    return options
