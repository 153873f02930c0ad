"""A broker of MQTT 5 in the loop of a test, that can be told to lose its connections."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

CONNACK, PUBACK, PINGRESP, SUBACK = 0x20, 0x40, 0xD0, 0x90


class MiniBroker:
    """Broker that keeps the JSON of each message that it acknowledges, by topic, in order.

    After `patience` publishings of a connection it closes this, and forgets the last of them, unacknowledged.
    """

    def __init__(self, *patience: int) -> None:
        self.patience = list(patience)
        self.kept: list[tuple[str, Any]] = []
        self.port = 0
        self.connections = 0
        self.heard = asyncio.Event()  # set with the first message

    def of(self, ending: str) -> list[Any]:
        """Return what was acknowledged on topics with an ending."""
        return [content for topic, content in self.kept if topic.endswith(ending)]

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one connection."""
        self.connections += 1
        left = self.patience.pop(0) if self.patience else 1_000_000
        try:
            while left:
                kind = (await reader.readexactly(1))[0]
                body = await reader.readexactly(await _length(reader))
                if kind >> 4 == 3:
                    left -= 1
                    if left:
                        self._publish(kind, body, writer)
                else:
                    _answer(kind, body, writer)
                await writer.drain()
        except (asyncio.IncompleteReadError, OSError):
            pass
        finally:
            writer.close()

    def _publish(self, kind: int, body: bytes, writer: asyncio.StreamWriter) -> None:
        size = int.from_bytes(body[:2], "big")
        topic, rest = body[2 : 2 + size].decode(), body[2 + size :]
        if kind & 6:
            number, rest = rest[:2], rest[2:]
            writer.write(bytes([PUBACK, 2]) + number)
        payload = rest[1 + rest[0] :]  # after the properties
        self.kept.append((topic, json.loads(payload) if payload else None))
        self.heard.set()


def _answer(kind: int, body: bytes, writer: asyncio.StreamWriter) -> None:
    if kind >> 4 == 1:
        writer.write(bytes([CONNACK, 3, 0, 0, 0]))
    elif kind >> 4 == 8:
        writer.write(bytes([SUBACK, 4]) + body[:2] + bytes([0, 1]))
    elif kind >> 4 == 12:
        writer.write(bytes([PINGRESP, 0]))


async def _length(reader: asyncio.StreamReader) -> int:
    value = shift = 0
    while True:
        (byte,) = await reader.readexactly(1)
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            return value


@asynccontextmanager
async def mini_broker(*patience: int) -> AsyncIterator[MiniBroker]:
    """A broker at a free port, until the block ends."""
    made = MiniBroker(*patience)
    async with await asyncio.start_server(made.serve, "127.0.0.1", 0) as server:
        made.port = server.sockets[0].getsockname()[1]
        yield made
