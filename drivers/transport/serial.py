"""Serial lines: pyserial configures the port, asyncio transfers the bytes."""

from __future__ import annotations

import asyncio
import errno
import os
import termios
from collections.abc import Callable
from contextlib import ExitStack
from fcntl import ioctl
from pathlib import Path
from typing import NamedTuple, Protocol, TypeVar

import serial
from serial.rs485 import RS485Settings
from serial.tools import list_ports

from drivers.errors import CannotConnect
from drivers.transport.address import Address

P = TypeVar("P", bound=asyncio.Protocol)
STABLE_NAMES = Path("/dev/serial/by-id")
_REFUSED = {
    errno.EACCES: "no permission; ask the administrator of this computer to add you to its group, mostly dialout",
    errno.EPERM: "no permission; ask the administrator of this computer to add you to its group, mostly dialout",
    errno.EAGAIN: "another program uses it",
    errno.EBUSY: "another program uses it",
    errno.ENOENT: "no such port",
}


class CharacterDevice(Protocol):
    """An open serial port or one end of a pseudo-terminal."""

    def fileno(self) -> int:
        """File descriptor."""

    def close(self) -> None:
        """Close the device."""


class SerialPort(NamedTuple):
    """A port of this machine: its path, by a name that stays with its adapter if there is one, and its description."""

    path: str
    title: str


def serial_ports(stable_names: Path = STABLE_NAMES) -> list[SerialPort]:
    """Available ports, by path."""
    links = {os.path.realpath(link): str(link) for link in sorted(stable_names.glob("*"))}
    ports = list_ports.comports()
    return sorted(SerialPort(links.get(os.path.realpath(port.device), port.device), port.description) for port in ports)


async def open_serial(device: str, address: Address, factory: Callable[[], P]) -> P:
    """Open the port exclusively and connect `factory()` to it; raises CannotConnect.

    Options: baud (9600), bytesize (8), parity (N), stopbits (1), flow (none, rtscts or xonxoff). RS-485 is half-duplex:
    most adapters switch direction by themselves (rs485: adapter), others need RTS for it (rts).
    """
    flow = address.options.get("flow", "none")
    await asyncio.sleep(0)  # a port just closed releases its lock in the next iteration of the loop
    try:
        port = serial.Serial(
            address.path,
            baudrate=address.option("baud", 9600),
            bytesize=address.option("bytesize", 8),
            parity=_parity(address),
            stopbits=address.option("stopbits", 1),
            rtscts=flow == "rtscts",
            xonxoff=flow == "xonxoff",
            timeout=0,
            exclusive=True,
        )
        _keep_others_out(port, address)
        if address.options.get("rs485") == "rts":
            _turn_round_by_rts(port)
    except (OSError, ValueError, serial.SerialException) as problem:
        raise CannotConnect(
            device, f"cannot open {address}: {_REFUSED.get(getattr(problem, 'errno', None) or 0, problem)}",
            remedy="Check the path (ls -l /dev/serial/by-id), the cable, and that no other program has the port.",
        ) from problem  # fmt: skip
    protocol = factory()
    await join_device(port, protocol)
    return protocol


def _keep_others_out(port: serial.Serial, address: Address) -> None:
    """Keep other programs, except those of the administrator, from opening the port until it is closed.

    Not for a pseudo-terminal: it would stay locked after a kill of this program, because its other end keeps it alive.
    """
    if not _is_pseudo_terminal(address):
        ioctl(port.fileno(), termios.TIOCEXCL)


def _turn_round_by_rts(port: serial.Serial) -> None:
    """Let the port hold RTS while it sends; if its driver cannot do that, close it and raise ValueError."""
    try:
        port.rs485_mode = RS485Settings()
    except ValueError as problem:
        port.close()
        raise ValueError(f"this port cannot switch the RS-485 direction by RTS ({problem})") from problem


def _parity(address: Address) -> str:
    """Parity of the address; none for a pseudo-terminal, which carries whole bytes and does not open with a parity."""
    return "N" if _is_pseudo_terminal(address) else address.options.get("parity", "N")


def _is_pseudo_terminal(address: Address) -> bool:
    return os.path.realpath(address.path).startswith("/dev/pts/")


async def join_device(device: CharacterDevice, protocol: asyncio.Protocol) -> DeviceTransport:
    """Connect an open device to `protocol` by asyncio's own pipe transports, one for each direction.

    The transport owns the device from now on, and closes it if connecting fails.
    """
    loop = asyncio.get_running_loop()
    transport = DeviceTransport(protocol)
    with ExitStack() as undo:
        undo.callback(device.close)
        twin = undo.enter_context(os.fdopen(os.dup(device.fileno()), "wb", 0))
        writer, _ = await loop.connect_write_pipe(lambda: _Half(transport), twin)
        undo.callback(writer.abort)
        reader, _ = await loop.connect_read_pipe(lambda: _Half(transport), device)
        undo.pop_all()
    transport.begin(reader, writer)
    return transport


class _Half(asyncio.Protocol):
    """One direction of a device."""

    def __init__(self, whole: DeviceTransport) -> None:
        self._whole = whole

    def data_received(self, data: bytes) -> None:
        self._whole.protocol.data_received(data)

    def connection_lost(self, exc: Exception | None) -> None:
        self._whole.end(exc)


class DeviceTransport(asyncio.Transport):
    """Both directions of a character device as one transport; if one is lost, the other is closed."""

    def __init__(self, protocol: asyncio.Protocol) -> None:
        super().__init__()
        self.protocol = protocol
        self._reader: asyncio.ReadTransport | None = None
        self._writer: asyncio.WriteTransport | None = None
        self._ended = False

    def begin(self, reader: asyncio.ReadTransport, writer: asyncio.WriteTransport) -> None:
        """Connect both directions, and notify the protocol; part of `join_device`."""
        self._reader, self._writer = reader, writer
        self.protocol.connection_made(self)

    def end(self, exc: Exception | None) -> None:
        """Close the other direction after the loss of one, and notify the protocol once."""
        self.close()
        if not self._ended:
            self._ended = True
            self.protocol.connection_lost(exc)

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Send `data`."""
        if self._writer is not None:
            self._writer.write(data)

    def get_write_buffer_size(self) -> int:
        """Number of bytes not yet taken by the kernel."""
        return 0 if self._writer is None else self._writer.get_write_buffer_size()

    def is_closing(self) -> bool:
        """Return whether the device is closed or closing."""
        return self._reader is None or self._reader.is_closing()

    def close(self) -> None:
        """Close the device; bytes not yet taken by the kernel are dropped. Closing twice is harmless."""
        # asyncio's pipe transports must not be closed twice.
        if self._writer is not None and not self._writer.is_closing():
            self._writer.abort()
        if self._reader is not None and not self._reader.is_closing():
            self._reader.close()

    def abort(self) -> None:
        """As `close`."""
        self.close()
