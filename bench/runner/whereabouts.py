"""Identification of instruments by address: all spellings of an address give the same marks.

A network address has one mark per numeric address that its name resolves to, with the port; all addresses of this
machine are one. A serial port has the mark of its device, whatever link leads there.
"""

from __future__ import annotations

import ipaddress
import os
import socket
import stat

from drivers.transport.address import Address

_HERE = "this machine"


def marks(address: Address) -> frozenset[str]:
    """Return the marks that an address shares with all other addresses of the same instrument.

    Empty for addresses that two programs cannot both drive: a person, a recording, a simulator. A name is resolved,
    which takes as long as the name service; an unknown name is a mark itself.
    """
    if address.simulated or address.is_person or address.is_recording:
        return frozenset()
    if address.port:
        return frozenset(f"port {address.port} of {host}" for host in _hosts(address.host))
    if address.path.startswith("/"):
        return frozenset({_file(address.path)})
    return frozenset({f"{address.scheme} {address.path}"})


def _hosts(name: str) -> set[str]:
    try:
        found = socket.getaddrinfo(name, None, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        return {name.lower()}
    return {_host(str(entry[4][0])) for entry in found}


def _host(numeric: str) -> str:
    """Return the canonical numeric address; that of this machine for all of its own."""
    ip: ipaddress.IPv4Address | ipaddress.IPv6Address = ipaddress.ip_address(numeric.partition("%")[0])
    if isinstance(ip, ipaddress.IPv6Address) and ip.ipv4_mapped is not None:
        ip = ip.ipv4_mapped
    return _HERE if ip.is_loopback or ip.is_unspecified or _is_own(ip) else str(ip)


def _is_own(ip: ipaddress.IPv4Address | ipaddress.IPv6Address) -> bool:
    """Return True if the address is of this machine; connecting a datagram socket sends nothing."""
    family = socket.AF_INET if ip.version == 4 else socket.AF_INET6
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.connect((str(ip), 9))
            return ipaddress.ip_address(probe.getsockname()[0]) == ip
    except OSError:  # no route
        return False


def _file(path: str) -> str:
    """Return the device or file of a path; the resolved path if there is none."""
    try:
        state = os.stat(path)
    except OSError:
        return f"path {os.path.realpath(path)}"
    if stat.S_ISCHR(state.st_mode):
        return f"device {os.major(state.st_rdev)}:{os.minor(state.st_rdev)}"
    return f"file {state.st_dev}:{state.st_ino}"
