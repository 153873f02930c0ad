"""Streams in one event loop."""

import asyncio
from collections.abc import Callable

from drivers.transport.memory import Line, join


def open_memory_stream(
    server: Callable[[], asyncio.Protocol], line: Line, address: object
) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    """Reader and writer connected to `server()`, as `asyncio.open_connection` returns for a socket."""
    loop = asyncio.get_running_loop()
    reader = asyncio.StreamReader(loop=loop)
    protocol = asyncio.StreamReaderProtocol(reader, loop=loop)
    transport = join(protocol, server(), line, address)
    return reader, asyncio.StreamWriter(transport, protocol, reader, loop)
