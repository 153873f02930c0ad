"""CAN adapters and logs as frame links: slcan by our own reader, all others and files by python-can."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections import deque
from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import can
import numpy as np

from drivers.can.frame_block import ERROR, EXTENDED, FrameBlock
from drivers.errors import CannotConnect, InstrumentFault, LinkLost, NoAnswer
from drivers.schema.bounded import expect_bounded
from drivers.timing.awake import fair_timeout
from drivers.transport import candump, slcan
from drivers.transport.address import Address
from drivers.transport.frame_link import DURABLE_BLOCK_S, FrameLink
from drivers.transport.serial import open_serial
from drivers.transport.text_frames import TextFrames

P = TypeVar("P", bound=asyncio.Protocol)
LOG_LIMIT_BYTES = 2**30
COLLECT_LIMIT_FRAMES = 2_000_000  # one minute of a fully loaded bus, if frames are not taken
_ANSWER_S = 1.0
LOG_BLOCK_S = 10.0  # recorded frames may stay buffered
ENDED_AFTER_S = 1.0


async def open_can(device: str, address: Address) -> FrameLink:
    """Open the adapter, or the log, at `address`; raises CannotConnect."""
    if address.scheme == "slcan":
        return await open_slcan(device, address, lambda factory: open_serial(device, address, factory))
    if address.is_recording:
        return LoggedFrames(device, Path(address.path), read_log(device, Path(address.path)))
    return PythonCan(device, address)


async def open_slcan(
    device: str, address: Address, join: Callable[[Callable[[], Slcan]], Awaitable[Slcan]]
) -> FrameLink:
    """Open a serial-line adapter: close its channel, set the bit rate, reopen it; raises CannotConnect, LinkLost."""
    bitrate = address.option("bitrate", 500_000)
    if bitrate not in slcan.BITRATES:
        raise CannotConnect(device, f"{address}: slcan knows the bit rates {', '.join(map(str, slcan.BITRATES))}")
    link = await join(lambda: Slcan(device))
    try:
        await link.command(slcan.CLOSE, may_refuse=True)  # refused if it was closed already
        await link.command(slcan.BITRATES[bitrate])
        await link.command(slcan.OPEN)
    except BaseException:
        link.close()
        raise
    return link


class Slcan(TextFrames):
    """A serial-line adapter as a frame link."""

    def __init__(self, device: str) -> None:
        super().__init__(device, slcan.parse, "the CAN adapter", slcan.CLOSE + slcan.END)

    def data_received(self, data: bytes) -> None:
        """Receive bytes of the adapter; while a command waits for its answer, everything else is ignored."""
        if self._answer is not None and not self._answer.done():
            agreed, self._rest = slcan.answer(self._rest + data)
            if agreed is not None:
                self._answer.set_result(agreed)
            return
        super().data_received(data)

    async def command(self, text: bytes, *, may_refuse: bool = False) -> None:
        """Send a command to the adapter itself; raises CannotConnect unless it acknowledges in time."""
        if self._transport is None:
            raise LinkLost(self._device, self.lost)
        self._answer = asyncio.get_running_loop().create_future()
        self._transport.write(text + slcan.END)
        try:
            async with fair_timeout(_ANSWER_S):
                agreed = await self._answer
        except TimeoutError:
            raise CannotConnect(self._device, "the CAN adapter does not answer", sent=repr(text)[1:]) from None
        finally:
            self._answer = None
        if not agreed and not may_refuse:
            raise CannotConnect(self._device, "the CAN adapter refused", sent=repr(text)[1:])


def frame_of(message: can.Message) -> tuple[int, bytes] | None:
    """Identifier and data of a message of python-can for a FrameBlock; None if it has no data."""
    if message.is_remote_frame or message.is_fd:
        return None
    if message.is_error_frame:
        frame_id = ERROR | message.arbitration_id & (ERROR - 1)
    else:
        frame_id = message.arbitration_id | (EXTENDED if message.is_extended_id else 0)
    return frame_id, bytes(message.data[:8])


def read_log(device: str, path: Path) -> FrameBlock:
    """Read the frames of a log, ASC, BLF, candump's or any other that python-can reads; raises CannotConnect.

    Their times are those of the file, in seconds.
    """
    try:
        expect_bounded(path, LOG_LIMIT_BYTES)
        block = candump.read(path) if path.suffix == ".log" else None
        if block is not None and len(block):
            return block
        with can.LogReader(path) as reader:
            kept = [(message.timestamp, *frame) for message in reader if (frame := frame_of(message)) is not None]
    except Exception as problem:  # the readers raise errors of many kinds
        raise CannotConnect(
            device, f"cannot read the log {path}: {str(problem) or type(problem).__name__}",
            remedy="Check its path, which is relative to the bench file, and that its file extension fits its format.",
        ) from problem  # fmt: skip
    if not kept:
        raise CannotConnect(device, f"the log {path} has no frame", remedy="Record it again.")
    return FrameBlock.of(kept)


class PythonCan:
    """Any adapter that python-can knows (`can:socketcan/can0?bitrate=500000`) as a frame link.

    An adapter with a file descriptor is read by the running loop; one without gets a reader thread, so it works in real
    time only.
    """

    block_s = DURABLE_BLOCK_S

    def __init__(self, device: str, address: Address) -> None:
        self._device = device
        interface, _, channel = address.path.strip("/").partition("/")
        self._loop = asyncio.get_running_loop()
        self._frames: deque[tuple[float, int, bytes]] = deque(maxlen=COLLECT_LIMIT_FRAMES)
        self._failure: str = ""
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        try:
            self._bus = can.Bus(channel=channel, interface=interface, bitrate=address.option("bitrate", 500_000))
        except (can.CanError, OSError, ValueError, ImportError) as problem:
            raise CannotConnect(
                device, f"cannot open {address}: {problem}",
                remedy="Check the adapter, its driver, and the interface's name (python-can's documentation).",
            ) from problem  # fmt: skip
        try:
            self._descriptor = self._bus.fileno()
        except NotImplementedError:
            self._descriptor = -1
        if self._descriptor >= 0:
            self._loop.add_reader(self._descriptor, self._read_waiting)
        else:
            self._thread = threading.Thread(target=self._read_for_ever, name=f"can-{device}", daemon=True)
            self._thread.start()

    def take(self) -> FrameBlock:
        """Frames since the last call; LinkLost if there is none and none can follow."""
        count = len(self._frames)
        if self._failure and not count:
            raise LinkLost(self._device, self._failure, remedy="Check the bus, its termination and the adapter.")
        if count == COLLECT_LIMIT_FRAMES:
            raise InstrumentFault(self._device, "frames arrived faster than they were read, and some are lost")
        return FrameBlock.of([self._frames.popleft() for _ in range(count)])

    def close(self) -> None:
        """Close the adapter; closing twice is harmless."""
        if self._closing.is_set():
            return
        self._closing.set()
        if self._descriptor >= 0:
            self._loop.remove_reader(self._descriptor)
        if self._thread is not None:
            self._thread.join(timeout=2)
        self._bus.shutdown()

    def _read_waiting(self) -> None:
        while (message := self._receive(0.0)) is not None:
            self._keep(message)

    def _read_for_ever(self) -> None:
        while not self._closing.is_set() and not self._failure:
            if (message := self._receive(0.1)) is not None:
                self._keep(message)

    def _receive(self, wait_s: float) -> can.Message | None:
        try:
            return self._bus.recv(wait_s)
        except (can.CanError, OSError) as problem:
            with contextlib.suppress(RuntimeError):  # the loop may be closed already
                self._loop.call_soon_threadsafe(self._fail, str(problem))
            self._failure = str(problem)
            return None

    def _keep(self, message: can.Message) -> None:
        if (frame := frame_of(message)) is not None:
            self._frames.append((self._loop.time(), *frame))

    def _fail(self, problem: str) -> None:
        if self._descriptor >= 0:
            self._loop.remove_reader(self._descriptor)
        self._failure = problem


class LoggedFrames:
    """Plays the frames of a log (N,), starting now."""

    block_s = LOG_BLOCK_S

    def __init__(self, device: str, path: Path, frames: FrameBlock) -> None:
        self._device, self._path = device, path
        since_s = np.maximum.accumulate(frames.at_s - frames.at_s[0])
        began_s = asyncio.get_running_loop().time()
        self._frames = replace(frames, at_s=began_s + since_s)
        self._next = 0

    def take(self) -> FrameBlock:
        """Frames since the last call; NoAnswer after the end of the log."""
        at_s, now_s = self._frames.at_s, asyncio.get_running_loop().time()
        begin, end = self._next, int(np.searchsorted(at_s, now_s, side="right"))
        if begin == len(at_s) and now_s > at_s[-1] + ENDED_AFTER_S:
            raise NoAnswer(
                self._device, f"the log {self._path.name} has ended, {at_s[-1] - at_s[0]:.6g} s after its first frame",
                remedy="Record for longer than the sequence takes, or run a shorter one.",
            )  # fmt: skip
        self._next = end
        return self._frames.at(np.arange(begin, end))

    def close(self) -> None:
        """Do nothing: nothing is open."""
