"""State of an uninterruptible power supply, queried from `upsd` of Network UPS Tools (RFC 9271, 4.2.4 and 5.1)."""

from __future__ import annotations

import asyncio
import re
from contextlib import suppress
from typing import Literal, NamedTuple

from bench.config.power import Supply

ANSWER_S = 2.0
LONGEST = 1024  # bytes of a line
_VARIABLE = re.compile(rb'VAR (\S+) ups\.status "((?:[^"\\]|\\.)*)"')

Kind = Literal["line", "battery", "low", "unknown"]


class PowerState(NamedTuple):
    """Power state: *line*, *battery*, *low* battery or *unknown*; with the text of the supply, or the reason."""

    kind: Kind
    text: str


def question(name: str) -> bytes:
    """Encode the request for the status of a supply."""
    return f"GET VAR {name} ups.status\n".encode()


def read_status(line: bytes, name: str) -> PowerState:
    """Decode an answer; *unknown* for an error and for anything else."""
    found = _VARIABLE.fullmatch(line.rstrip(b"\r\n"))
    if found is None or found[1] != name.encode():
        return PowerState("unknown", f"upsd answers {line.decode('ascii', 'replace').strip()!r}")
    text = re.sub(rb"\\(.)", rb"\1", found[2]).decode("ascii", "replace")
    words = set(text.split())
    if "FSD" in words or {"OB", "LB"} <= words:
        return PowerState("low", text)
    if "OB" in words:
        return PowerState("battery", text)
    return PowerState("line" if "OL" in words else "unknown", text)


class Client:
    """Connection to `upsd`, reopened after every error. `ask` takes at most twice ANSWER_S and raises nothing."""

    def __init__(self, supply: Supply) -> None:
        self._supply = supply
        self._open: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None

    async def ask(self) -> PowerState:
        """Return the present state; *unknown* with the reason if it cannot be read."""
        name, host, port = self._supply
        try:
            async with asyncio.timeout(ANSWER_S):
                if self._open is None:
                    self._open = await asyncio.open_connection(host, port, limit=LONGEST)
            reader, writer = self._open
            async with asyncio.timeout(ANSWER_S):
                writer.write(question(name))
                await writer.drain()
                return read_status(await reader.readuntil(b"\n"), name)
        except TimeoutError:
            problem = f"no answer within {ANSWER_S:g} s"
        except (OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError) as error:
            problem = str(error) or type(error).__name__
        await self.close()
        return PowerState("unknown", f"upsd at {host}:{port}: {problem}")

    async def close(self) -> None:
        """Close the connection."""
        if self._open is None:
            return
        (_, writer), self._open = self._open, None
        with suppress(OSError, TimeoutError):
            writer.close()
            async with asyncio.timeout(ANSWER_S):
                await writer.wait_closed()
