"""Where an instrument is: `tcp://host:port`, `serial:///dev/ttyUSB0?baud=9600`, `slcan:///dev/ttyACM0?bitrate=500000`.

`sim+` before an address puts the simulator at its other end, inside the same process.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from urllib.parse import parse_qsl, urlsplit

_SIMULATED = "sim+"
_HOST = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]{0,252}[A-Za-z0-9])?|[0-9a-fA-F:]{2,45}")

# scheme: (needs a port, needs a path, the options it knows)
_SCHEMES: Mapping[str, tuple[bool, bool, frozenset[str]]] = {
    "tcp": (True, False, frozenset()),
    "serial": (False, True, frozenset({"baud", "bytesize", "parity", "stopbits", "flow"})),
    "slcan": (False, True, frozenset({"bitrate", "baud"})),
    "can": (False, True, frozenset({"bitrate"})),
}


class AddressError(ValueError):
    """Text that is not an address."""


@dataclass(frozen=True, slots=True)
class Address:
    """One end of a wire. TCP has `host` and `port`; a device file or `can:INTERFACE/CHANNEL` has `path`."""

    scheme: str
    host: str = ""
    port: int = 0
    path: str = ""
    options: Mapping[str, str] = field(default_factory=dict)
    simulated: bool = False

    @classmethod
    def parse(cls, text: str) -> Address:
        """The address that `text` spells; AddressError says what is wrong with it."""
        simulated = text.startswith(_SIMULATED)
        parts = urlsplit(text.removeprefix(_SIMULATED))
        if parts.scheme not in _SCHEMES:
            raise AddressError(f"'{text}' is not an address; expected {', '.join(_SCHEMES)} before a colon")
        needs_port, needs_path, known = _SCHEMES[parts.scheme]
        options = dict(parse_qsl(parts.query, keep_blank_values=True))
        if unknown := sorted(set(options) - known):
            raise AddressError(f"'{text}' has an unknown option '{unknown[0]}'")
        if needs_port:
            return cls("tcp", *_host_and_port(text, parts.netloc), options=options, simulated=simulated)
        if needs_path and (not parts.path.strip("/") or parts.netloc):
            raise AddressError(f"'{text}' names no device file; write {parts.scheme}:///dev/…")
        return cls(parts.scheme, path=parts.path, options=options, simulated=simulated)

    def option(self, name: str, default: int) -> int:
        """A whole-number option; AddressError when it is something else."""
        text = self.options.get(name, str(default))
        if not text.isascii() or not text.isdigit() or not 0 < int(text) < 10**8:
            raise AddressError(f"{self}: '{name}={text}' is not a whole number")
        return int(text)

    def as_simulated(self) -> Address:
        """The same place with the simulator at its other end."""
        return replace(self, simulated=True)

    @property
    def is_local(self) -> bool:
        """Whether this machine itself could be the other end: loopback, or a file below a temporary directory."""
        return self.host in ("localhost", "127.0.0.1", "::1") or (bool(self.path) and not self.path.startswith("/dev/"))

    def __str__(self) -> str:
        where = f"//{self.host}:{self.port}" if self.scheme == "tcp" else f"//{self.path}"
        query = "&".join(f"{key}={value}" for key, value in self.options.items())
        return f"{_SIMULATED if self.simulated else ''}{self.scheme}:{where}" + (f"?{query}" if query else "")


def _host_and_port(text: str, netloc: str) -> tuple[str, int]:
    host, colon, port = netloc.rpartition(":")
    host = host.strip("[]")
    if not colon or not _HOST.fullmatch(host) or not port.isdigit() or not 0 < int(port) < 65536:
        raise AddressError(f"'{text}' needs a host and a port, like tcp://192.168.1.10:502")
    return host, int(port)
