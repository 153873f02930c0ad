"""A bad line in front of a TCP address, as a separate process.

    python -m simulators.serving.proxy --listen 127.0.0.1:1602 --to 127.0.0.1:1502 --seed 7 --faults flip,late

Connections to the first address are forwarded to the second, with faults in some answers
(`simulators.faults.line_faults`). With `--first silence,flip` only the first answers have these faults, in order.
"""

from __future__ import annotations

import argparse
import asyncio
import sys

from simulators.faults.line_faults import FaultyLine, LineFault, in_turn, random_faults


class _Passage(asyncio.Protocol):
    """The server's end of a connection: forwards all data between client and target."""

    def __init__(self, host: str, port: int) -> None:
        self._host, self._port = host, port
        self._waiting = bytearray()
        self._target: asyncio.Transport | None = None
        self._joining: asyncio.Task[None] | None = None
        self.client: asyncio.Transport

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Connect to the target."""
        if not isinstance(transport, asyncio.Transport):
            raise TypeError("a stream transport is needed")
        self.client = transport
        self._joining = asyncio.get_running_loop().create_task(self._join())

    def data_received(self, data: bytes) -> None:
        """Forward bytes of the client."""
        if self._target is None:
            self._waiting += data
        else:
            self._target.write(data)

    def connection_lost(self, exc: Exception | None) -> None:
        """Close the connection to the target."""
        if self._target is not None:
            self._target.close()

    async def _join(self) -> None:
        try:
            self._target, _ = await asyncio.get_running_loop().create_connection(
                lambda: _FromTarget(self.client), self._host, self._port
            )
        except OSError:
            self.client.abort()
            return
        self._target.write(bytes(self._waiting))


class _FromTarget(asyncio.Protocol):
    def __init__(self, client: asyncio.Transport) -> None:
        self._client = client

    def data_received(self, data: bytes) -> None:
        self._client.write(data)

    def connection_lost(self, exc: Exception | None) -> None:
        self._client.close()


async def serve_bad_line(listen: tuple[str, int], to: tuple[str, int], bad: FaultyLine) -> asyncio.Server:
    """Start a server at `listen` that leads to `to` over a bad line; OSError if the address is in use."""
    factory = bad.server(lambda: _Passage(*to))
    return await asyncio.get_running_loop().create_server(factory, *listen)


def _address(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    return host, int(port)


def main() -> None:
    """Serve until it is stopped."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--listen", type=_address, required=True, metavar="HOST:PORT")
    parser.add_argument("--to", type=_address, required=True, metavar="HOST:PORT")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--share", type=float, default=0.05, help="share of the answers with a fault")
    parser.add_argument("--faults", default=",".join(LineFault), help="kinds, separated by commas")
    parser.add_argument("--first", default="", help="of the first answers, in order; then none")
    parser.add_argument("--patience", type=float, default=3.0, help="timeout of the client, s")
    options = parser.parse_args()
    kinds = [LineFault(name) for name in options.faults.split(",")]
    first = [LineFault(name) if name else None for name in options.first.split(",")]
    choose = in_turn(first) if options.first else random_faults(options.seed, options.share, kinds)

    async def serve() -> None:
        server = await serve_bad_line(options.listen, options.to, FaultyLine(options.seed, choose, options.patience))
        port = server.sockets[0].getsockname()[1]
        sys.stderr.write(f"ready on port {port}\n")
        await server.serve_forever()

    asyncio.run(serve())


if __name__ == "__main__":
    main()
