"""Receives the frames of a server, without a use: `python -m benchmarks.bare_receiver HOST:PORT SECONDS`."""

from __future__ import annotations

import asyncio
import json
import sys
import time

from drivers.transport.socketcand import RAW_MODE, open_text


class Bare(asyncio.Protocol):
    """Opens a bus and counts the frames of its server."""

    def __init__(self) -> None:
        self.frames, self._requests = 0, [open_text("can0"), RAW_MODE]

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        if self._requests:
            self._transport.write(self._requests.pop(0))
        else:
            self.frames += data.count(b">")


async def main() -> None:
    host, _, port = sys.argv[1].rpartition(":")
    _, bare = await asyncio.get_running_loop().create_connection(Bare, host, int(port))
    began_s = time.process_time()
    await asyncio.sleep(float(sys.argv[2]))
    print(json.dumps({"cpu_s": time.process_time() - began_s, "frames": bare.frames}))


if __name__ == "__main__":
    asyncio.run(main())
