"""CAN over TCP in the format of socketcand: texts like `< frame 123 1690000000.000100 0A0B >`, both directions.

The server greets with `< hi >`; `< open can0 >` and `< rawmode >` are each answered by `< ok >`; then frames follow as
on the bus. Texts may be split anywhere, and several may arrive together. The server's timestamps are of its own clock;
frames get their time of arrival.
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import Awaitable, Callable

import numpy as np

from drivers.can.frame_block import ERROR, EXTENDED, FrameBlock
from drivers.errors import CannotConnect, LinkLost
from drivers.timing.awake import fair_timeout
from drivers.transport.address import Address
from drivers.transport.alike import Arrivals, alike, bytes_of, in_order, number_of
from drivers.transport.exchange import printable
from drivers.transport.paced_socket import PacedSocket
from drivers.transport.text_frames import TextFrames

HI, OK, RAW_MODE = b"< hi >", b"< ok >", b"< rawmode >"
ANSWER_S = 3.0
TEXT_LIMIT_BYTES = 4096  # limit for a text without an end

_TEXT = re.compile(rb"<[^<>]*>")
_FRAME = re.compile(rb"< frame ([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8}) \d+\.\d+ +((?:[0-9A-Fa-f]{2} ?){0,8})>")
_FRAMES = re.compile(  # as servers send them
    rb"< frame (?P<id>[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8}) (?P<seconds>\d+)\.(?P<fraction>\d+) +"
    rb"(?P<data>(?:[0-9A-Fa-f]{2}){0,8}) ?>"
)
_ERROR = re.compile(rb"< error ([0-9A-Fa-f]{1,8}) \d+\.\d+ [^<>]*>")
_OTHERS = (b"< rtr ", b"< stat ", b"< echo >", b"< fdframe ", OK)  # neither frames nor errors
_OPEN, _CLOSE = b"<>"
_BITS_29 = EXTENDED // 4 - 1


def open_text(bus: str) -> bytes:
    """Request to open a bus."""
    return b"< open %s >" % bus.encode("ascii")


def parse(data: bytes, arrivals: Arrivals) -> tuple[FrameBlock, bytes, int]:
    """Parse the frames in `data`; also return the rest of an incomplete text, and the number of unknown texts.

    A frame has the time of arrival of its end. Error frames have no data.
    """
    characters = np.frombuffer(data, np.uint8)
    brackets = np.flatnonzero((characters == _OPEN) | (characters == _CLOSE))
    opens = characters[brackets] == _OPEN
    pairs = np.flatnonzero(opens[:-1] & ~opens[1:])
    begins, ends = brackets[pairs], brackets[pairs + 1] + 1
    at_s, parts, left = arrivals.of_bytes(ends - 1), [], np.ones(len(pairs), dtype=bool)
    for rows, digits in alike(characters, begins, ends, _FRAMES):
        left[rows] = False
        ids = number_of(digits["id"], 16).astype(np.uint32)
        if digits["id"].shape[1] == 8:
            ids = ids & np.uint32(_BITS_29) | np.uint32(EXTENDED)
        dlc = np.full(len(rows), digits["data"].shape[1] // 2, np.uint8)
        parts.append((rows, FrameBlock(ids, at_s[rows], dlc, bytes_of(digits["data"]))))
    others = np.flatnonzero(left)
    frames = [_frame(data[begins[row] : ends[row]], float(at_s[row])) for row in others.tolist()]
    known = [row for row, frame in zip(others.tolist(), frames, strict=True) if isinstance(frame, tuple)]
    if known:
        parts.append((np.array(known), FrameBlock.of([frame for frame in frames if isinstance(frame, tuple)])))
    rest = data[ends[-1] :] if len(ends) else data
    return in_order(parts), rest if len(rest) <= TEXT_LIMIT_BYTES else b"", frames.count(False)


def _frame(text: bytes, at_s: float) -> tuple[float, int, bytes] | bool:
    """Time, identifier and data of a frame; else whether the text is a known one."""
    if frame := _FRAME.fullmatch(text):
        number = int(frame[1], 16)
        frame_id = number if len(frame[1]) == 3 else number & _BITS_29 | EXTENDED
        return at_s, frame_id, bytes.fromhex(frame[2].decode("ascii"))
    if error := _ERROR.fullmatch(text):
        return at_s, ERROR | int(error[1], 16) & (ERROR - 1), b""
    return text.startswith(_OTHERS)


def render(block: FrameBlock, since_s: float = 0.0) -> bytes:
    """Encode texts as a server sends them; `since_s` is the time of its clock at time 0."""
    texts = []
    for frame_id, at_s, dlc, data in zip(
        block.ids.tolist(), block.at_s.tolist(), block.dlc.tolist(), block.data, strict=True
    ):
        if frame_id & ERROR:
            texts.append(f"< error {frame_id & (ERROR - 1):03X} {since_s + at_s:.6f} >")
            continue
        name = f"{frame_id & _BITS_29:08X}" if frame_id & EXTENDED else f"{frame_id:03X}"
        texts.append(f"< frame {name} {since_s + at_s:.6f} {data[:dlc].tobytes().hex().upper()} >")
    return "".join(texts).encode("ascii")


async def open_socketcand(
    device: str, address: Address, join: Callable[[Callable[[], Socketcand]], Awaitable[Socketcand]]
) -> Socketcand:
    """Open a bus of a server; raises CannotConnect."""
    link = await join(lambda: Socketcand(device))
    try:
        await link.open(address.path)
    except BaseException:
        link.close()
        raise
    return link


class Socketcand(TextFrames):
    """A bus of a server as a frame link."""

    def __init__(self, device: str) -> None:
        super().__init__(device, parse, "the socketcand server")
        self._wanted = b""
        self._is_open = False
        self._socket: PacedSocket

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Store the transport."""
        super().connection_made(transport)
        if self._transport is not None:
            self._socket = PacedSocket(self._transport, self._keep, self.connection_lost)

    def data_received(self, data: bytes) -> None:
        """Receive bytes of the server; until the bus is open, the first complete text is the awaited answer."""
        if self._is_open:
            super().data_received(data)
            self._socket.note(self._portions[-1])
            return
        self._rest += data
        self._find_answer()

    def take(self) -> FrameBlock:
        """Frames until now since the last call; LinkLost if there is none and the connection is lost."""
        self._socket.read()
        return super().take()

    async def open(self, bus: str) -> None:
        """Request a bus and all its frames; raises CannotConnect."""
        await self.answered(b"", HI)
        await self.answered(open_text(bus), OK)
        await self.answered(RAW_MODE, OK)
        self._is_open = True

    async def answered(self, request: bytes, wanted: bytes) -> None:
        """Send a request; raises CannotConnect unless the next text is the expected one, and in time."""
        if self._transport is None or self.lost:
            raise LinkLost(self._device, self.lost)
        self._answer, self._wanted = asyncio.get_running_loop().create_future(), wanted
        self._transport.write(request)
        self._find_answer()
        try:
            async with fair_timeout(ANSWER_S):
                await self._answer
        except TimeoutError:
            raise self._refused(f"no {wanted.decode()} within {ANSWER_S:g} s", request, self._rest) from None
        except LinkLost as problem:
            raise self._refused("it has closed the connection", request, self._rest) from problem
        finally:
            self._answer = None

    def _find_answer(self) -> None:
        text = _TEXT.search(self._rest)
        if text is None or self._answer is None or self._answer.done():
            return
        if text[0] == self._wanted:
            self._rest = self._rest[text.end() :]
            self._answer.set_result(True)
        else:
            self._answer.set_exception(self._refused("the request was refused", b"", text[0]))

    def _refused(self, problem: str, request: bytes, answer: bytes) -> CannotConnect:
        return CannotConnect(
            self._device, f"the socketcand server does not open the bus: {problem}",
            sent=printable(request) if request else "", received=printable(answer) if answer else "",
            remedy="Check the address: the port of socketcand (29536), and the bus that it was started for (-i can0).",
        )  # fmt: skip
