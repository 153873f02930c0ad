"""Serial lines: pyserial sets the port up, asyncio moves the bytes."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from typing import TypeVar

import serial

from drivers.errors import CannotConnect
from drivers.transport.address import Address

P = TypeVar("P", bound=asyncio.Protocol)


async def open_serial(device: str, address: Address, factory: Callable[[], P]) -> P:
    """Opens the port for this process alone and joins `factory()` to it; raises CannotConnect.

    Options: baud (9600), bytesize (8), parity (N), stopbits (1), flow (none, rtscts or xonxoff).
    """
    flow = address.options.get("flow", "none")
    try:
        port = serial.Serial(
            address.path,
            baudrate=address.option("baud", 9600),
            bytesize=address.option("bytesize", 8),
            parity=address.options.get("parity", "N"),
            stopbits=address.option("stopbits", 1),
            rtscts=flow == "rtscts",
            xonxoff=flow == "xonxoff",
            timeout=0,
            exclusive=True,
        )
    except (OSError, ValueError, serial.SerialException) as problem:
        raise CannotConnect(
            device, f"cannot open {address}: {problem}",
            remedy="Check the path (ls -l /dev/serial/by-id), the cable, and that no other program has the port.",
        ) from problem  # fmt: skip
    return await _join(port, factory())


async def _join(port: serial.Serial, protocol: P) -> P:
    """Joins the open port to `protocol` by asyncio's own pipe transports, one for each direction."""
    loop = asyncio.get_running_loop()
    writer, _ = await loop.connect_write_pipe(asyncio.BaseProtocol, os.fdopen(os.dup(port.fileno()), "wb", 0))
    reader, _ = await loop.connect_read_pipe(lambda: _Incoming(protocol), port)
    protocol.connection_made(SerialTransport(reader, writer))
    return protocol


class _Incoming(asyncio.Protocol):
    """Hands what arrives to the real protocol, whose transport is the pair."""

    def __init__(self, protocol: asyncio.Protocol) -> None:
        self._protocol = protocol

    def data_received(self, data: bytes) -> None:
        self._protocol.data_received(data)

    def connection_lost(self, exc: Exception | None) -> None:
        self._protocol.connection_lost(exc)


class SerialTransport(asyncio.Transport):
    """Both directions of a character device as one transport."""

    def __init__(self, reader: asyncio.ReadTransport, writer: asyncio.WriteTransport) -> None:
        super().__init__()
        self._reader, self._writer = reader, writer

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Sends `data`."""
        self._writer.write(data)

    def is_closing(self) -> bool:
        """Whether the port is closed or about to be."""
        return self._reader.is_closing()

    def close(self) -> None:
        """Closes the port; closing twice is harmless."""
        self._writer.abort()
        self._reader.close()
