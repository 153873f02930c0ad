"""Every byte between drivers and instruments, with the time at which it passed, as lines of text.

    # bench trace 1
    # run 20261103-201500-tumble_static
    0.002000 chamber + tcp://192.168.1.10:502
    0.002000 chamber > 00 01 00 00 00 06 01 03 1a 4a 00 01
    0.004125 chamber < 00 01 00 00 00 05 01 03 02 00 0f
    0.006000 supply > "*IDN?"
    9.500000 chamber -

Seconds of bench time, as in the journal of the run; the device; `+` the connection is open, `-` it is closed, `>` sent
to the instrument, `<` received from it. Printable bytes are written as text, with the escapes of JSON, all others in
hexadecimal; CAN frames as `candump` writes them, `101#0000C8420100`. Only the trace of a run names one.
"""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from typing import NamedTuple, TypeVar

from drivers.can.frame_block import EXTENDED, FrameBlock
from drivers.transport.address import Address
from drivers.transport.frame_link import FrameLink
from drivers.transport.tap import Tap
from drivers.transport.wires import Wires

P = TypeVar("P", bound=asyncio.Protocol)
HEAD = "# bench trace 1"
_OF_RUN = "# run "
_TEXT = re.compile(rb"[\x20-\x7e\r\n]+")
OPENED, CLOSED, SENT, RECEIVED = "+", "-", ">", "<"


class Passed(NamedTuple):
    """One line of a trace; `text` is an address, bytes as `spelled`, or a CAN frame."""

    at_s: float
    device: str
    sign: str
    text: str = ""

    def line(self) -> str:
        """Format the line."""
        return f"{self.at_s:.6f} {self.device} {self.sign} {self.text}".rstrip()

    @property
    def data(self) -> bytes:
        """Bytes that passed; ValueError for a line that has none."""
        if self.text.startswith('"'):
            return str(json.loads(self.text)).encode("ascii")
        return bytes.fromhex(self.text)


def spelled(data: bytes) -> str:
    """Format bytes for a line of a trace."""
    return json.dumps(data.decode("ascii")) if _TEXT.fullmatch(data) else data.hex(" ")


def head_of(run: str | None) -> str:
    """First lines of a trace, of a run or of none."""
    return f"{HEAD}\n" if run is None else f"{HEAD}\n{_OF_RUN}{run}\n"


def run_of(lines: Iterable[str]) -> str:
    """Run named in the head of a trace; empty for a trace of no run, and for any other file."""
    head = [line.rstrip() for line in islice(lines, 2)]
    return head[1].removeprefix(_OF_RUN) if len(head) == 2 and head[0] == HEAD and head[1].startswith(_OF_RUN) else ""


def read_trace(lines: Iterable[str]) -> Iterator[Passed]:
    """Read the lines of a trace, in order; ValueError with the number of an invalid one."""
    for number, line in enumerate(lines, 1):
        if number == 1 and line.strip() != HEAD:
            raise ValueError(f"line 1 is {line.strip()[:40]!r}, a trace begins with {HEAD!r}")
        if line.startswith("#") or not line.strip():
            continue
        parts = line.split(None, 3)
        try:
            at, device, sign = parts[:3]
            if sign not in (OPENED, CLOSED, SENT, RECEIVED):
                raise ValueError
            passed = Passed(float(at), device, sign, parts[3].strip() if len(parts) > 3 else "")
        except ValueError:
            raise ValueError(f"line {number} is no line of a trace: {line.strip()[:60]!r}") from None
        yield passed


class TracedWires:
    """Connections that pass all data to `keep`, line by line."""

    def __init__(self, wires: Wires, keep: Callable[[Passed], object]) -> None:
        self._wires, self._keep = wires, keep

    def note(self, device: str, sign: str, text: str = "", at_s: float | None = None) -> None:
        """Record a line, with the present loop time unless another is given."""
        at_s = asyncio.get_running_loop().time() if at_s is None else at_s
        self._keep(Passed(at_s, device, sign, text))

    async def stream(self, device: str, address: Address, factory: Callable[[], P]) -> P:
        """Connect `factory()` to the other end, with a recorder in between."""
        made: list[P] = []

        def tapped() -> _Recorder:
            made.append(factory())
            return _Recorder(made[-1], self, device, address)

        await self._wires.stream(device, address, tapped)
        return made[-1]

    async def frames(self, device: str, address: Address) -> FrameLink:
        """Open a CAN channel whose frames are recorded when they are taken."""
        link = await self._wires.frames(device, address)
        self.note(device, OPENED, str(address))
        return _RecordedFrames(link, self, device)


class _Recorder(Tap):
    def __init__(self, inner: asyncio.Protocol, wires: TracedWires, device: str, address: Address) -> None:
        super().__init__(inner)
        self._wires, self._device, self._address = wires, device, address

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._wires.note(self._device, OPENED, str(self._address))
        super().connection_made(transport)

    def sent(self, data: bytes) -> None:
        self._wires.note(self._device, SENT, spelled(data))
        super().sent(data)

    def received(self, data: bytes) -> None:
        self._wires.note(self._device, RECEIVED, spelled(data))
        super().received(data)

    def connection_lost(self, exc: Exception | None) -> None:
        self._wires.note(self._device, CLOSED)
        super().connection_lost(exc)


class _RecordedFrames:
    def __init__(self, link: FrameLink, wires: TracedWires, device: str) -> None:
        self._link, self._wires, self._device = link, wires, device

    @property
    def block_s(self) -> float:
        return self._link.block_s

    def take(self) -> FrameBlock:
        block = self._link.take()
        for frame, at_s, dlc, data in zip(
            block.ids.tolist(), block.at_s.tolist(), block.dlc.tolist(), block.data, strict=True
        ):
            name = f"{frame & ~EXTENDED:08X}" if frame & EXTENDED else f"{frame:03X}"
            self._wires.note(self._device, RECEIVED, f"{name}#{data[:dlc].tobytes().hex().upper()}", at_s)
        return block

    def close(self) -> None:
        self._wires.note(self._device, CLOSED)
        self._link.close()
