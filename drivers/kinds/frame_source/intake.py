"""Intake of unsolicited frames: in time, without loss, and divided at the limits of an acquisition."""

from __future__ import annotations

import asyncio
import hashlib
import math
from abc import ABC, abstractmethod
from collections.abc import AsyncIterator, Callable, Iterable, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path
from typing import Generic, Self, TypeVar

from drivers.can.bus_errors import BUS_OFF, RESTARTED, class_names, error_classes
from drivers.can.dbc import Dbc, DbcError, Field, dbc_of, readings_of
from drivers.can.frame_block import ERROR, EXTENDED, FrameBlock
from drivers.can.options import IDLE_BLOCK_S, text_of
from drivers.description import Nothing, OptionsT, Setup, check_identity
from drivers.errors import BadAnswer, DriverError, InstrumentFault, LinkLost, NoAnswer
from drivers.recognised import as_stated
from drivers.transport.dialogue import ReconnectBackoff
from drivers.transport.frame_link import FrameLink
from drivers.values import Identity, LastSeen, Reading

SILENT_PERIODS = 25
LEAST_SILENCE_S = 0.25  # adapters, networks and a busy computer hold frames back for part of this
FROZEN_FRAMES = 3  # so many frames with one sequence number mean that the sender is frozen
ERROR_REPORT_INTERVAL_S = 60.0
MAX_LISTED = 8  # listed when other frames than the expected ones arrive

FormatT = TypeVar("FormatT")


class FrameIntake:
    """Takes frames from a link periodically, more often during an acquisition.

    Every block is passed to `process`; an error of that or of the link ends the intake and the running acquisition, and
    is raised by `check` from then on. So does a bus-off state, even a past one; other error frames are passed to
    `note`, at long intervals. Lifetime: from `begin` to `end` a task of its own receives the frames.
    """

    def __init__(
        self, name: str, link: FrameLink, process: Callable[[FrameBlock], None], note: Callable[[str], object]
    ) -> None:
        self._name, self._link, self._process, self._note = name, link, process, note
        self._errors, self._reported_s = 0, -math.inf  # error frames not yet reported, and the time of the last report
        self._acquisition: _Blocks | None = None
        self._wake = asyncio.Event()
        self._data_event = asyncio.Event()
        self._failure: DriverError | None = None
        self._taken_s = -math.inf
        self._task: asyncio.Task[None]
        self.acquiring_since_s: float | None = None

    def begin(self) -> None:
        """Start the intake."""
        self._task = asyncio.create_task(self._receive(), name=f"{self._name} intake")

    async def end(self) -> None:
        """Stop the intake and close the link."""
        self._task.cancel()
        await asyncio.wait([self._task])
        self._link.close()

    async def wait_for_data(self) -> None:
        """Return when frames were taken in since the last call, or the link is lost."""
        await self._data_event.wait()
        self._data_event.clear()

    @property
    def is_lost(self) -> bool:
        """True if the link is lost and no acquisition has yet to be notified."""
        return isinstance(self._failure, LinkLost) and self._acquisition is None

    def check(self) -> None:
        """Raise the error of the intake, if there is one."""
        if self._failure is not None:
            raise self._failure

    @asynccontextmanager
    async def acquire(self, block_s: float | None) -> AsyncIterator[AsyncIterator[FrameBlock]]:
        """Context manager whose value yields blocks of all frames between entry and exit, the last one after exit.

        Blocks are taken every `block_s`, or more often if the link cannot buffer so long.
        """
        if self._acquisition is not None:
            raise InstrumentFault(self._name, "an acquisition is already running")
        self.drain()
        self.check()
        blocks = self._acquisition = _Blocks(math.inf if block_s is None else block_s)
        self.acquiring_since_s = asyncio.get_running_loop().time()
        self._wake.set()
        try:
            yield blocks
            self.drain()
            self.drain()  # a lost link raises this after its last frames
        finally:
            self._acquisition = self.acquiring_since_s = None
            blocks.end(self._failure)

    async def _receive(self) -> None:
        while self._failure is None:
            try:
                async with asyncio.timeout(self._block_s):
                    await self._wake.wait()
                self._wake.clear()
            except TimeoutError:
                self.drain()

    @property
    def _block_s(self) -> float:
        """Time for which frames stay buffered in the link."""
        link_s = self._link.block_s
        return max(IDLE_BLOCK_S, link_s) if self._acquisition is None else min(link_s, self._acquisition.block_s)

    def poll(self) -> None:
        """Take in the frames that have arrived; raises the error of the intake."""
        if asyncio.get_running_loop().time() > self._taken_s:
            self._take()
        self.check()

    def drain(self) -> None:
        """Take in the frames that have arrived, and notify waiting tasks."""
        self._data_event.set()
        self._take()

    def _take(self) -> None:
        """Take the frames that have arrived; a fault ends the intake and the acquisition."""
        if self._failure is not None:
            return
        self._taken_s = asyncio.get_running_loop().time()
        try:
            block = self._link.take()
            if self._acquisition is not None:
                self._acquisition.put(block)
            self._report_error_frames(block)
            self._process(block)
        except DriverError as problem:
            self._failure = self._root_cause(problem)
            self._link.close()  # otherwise frames would accumulate
            if self._acquisition is not None:
                self._acquisition.end(self._failure)

    def _root_cause(self, problem: DriverError) -> DriverError:
        """The problem, or the reason for the silence if the link knows it."""
        if isinstance(problem, NoAnswer):
            try:
                self._link.take()
            except DriverError as known:
                return known
        return problem

    def _report_error_frames(self, block: FrameBlock) -> None:
        """Report error frames; raises LinkLost if the adapter is bus-off, or was."""
        classes = error_classes(block)
        if not len(classes):
            return
        if (classes & (BUS_OFF | RESTARTED)).any():
            raise LinkLost(
                self._name, f"the adapter is, or was, bus-off ({class_names(classes.tolist())})",
                remedy="Check the wiring, the termination and the bit rate; restart the adapter, then run again.",
            )  # fmt: skip
        self._errors += len(classes)
        now_s = asyncio.get_running_loop().time()
        if now_s - self._reported_s >= ERROR_REPORT_INTERVAL_S:
            self._note(f"error frames on the bus: {self._errors}, {class_names(classes.tolist())}")
            self._errors, self._reported_s = 0, now_s


class _Blocks(AsyncIterator[FrameBlock]):
    """Blocks from the intake to an acquisition, at least one every `block_s`."""

    def __init__(self, block_s: float) -> None:
        self.block_s = block_s
        self._queue: asyncio.Queue[FrameBlock | DriverError | None] = asyncio.Queue()

    def put(self, block: FrameBlock) -> None:
        if len(block):
            self._queue.put_nowait(block)

    def end(self, problem: DriverError | None) -> None:
        self._queue.put_nowait(problem)

    async def __anext__(self) -> FrameBlock:
        item = await self._queue.get()
        if isinstance(item, FrameBlock):
            return item
        self._queue.put_nowait(item)  # an ended iterator stays ended
        if item is None:
            raise StopAsyncIteration
        raise item


class FrameDriver(ABC, Generic[OptionsT]):
    """Common part of receive-only drivers.

    A subclass processes every block with `_process`, which updates `_readings` (new ones by channel) and `_last_seen`,
    and raises if the block has a problem.

    A poll reconnects a lost link: at once, then after increasing pauses. An acquisition does not, and fails if the link
    is lost: no block spans the gap.
    """

    def __init__(self, setup: Setup[OptionsT, Nothing, Nothing]) -> None:
        self.name = setup.name
        self._setup = setup
        self._options = setup.options
        self._readings: dict[str, list[Reading]] = {}
        self._last_seen: dict[str, LastSeen] = {}
        self._fingerprint = ""
        self._intake: FrameIntake
        self._backoff = ReconnectBackoff()

    async def __aenter__(self) -> Self:
        """Open the channel and wait for a first frame; raises CannotConnect, NoAnswer, BadAnswer."""
        self._begin(await self._open())
        return self

    async def __aexit__(self, *exc: object) -> None:
        """Close the channel."""
        await self._intake.end()

    async def identify(self) -> Identity:
        """Identity stated in the bench file; the fingerprint is that of the frame description."""
        return as_stated(self._setup.identity, self._fingerprint)

    async def poll(self) -> Mapping[str, Sequence[Reading]]:
        """Temperatures received since the last poll; raises the error of the intake."""
        if self._intake.is_lost and self._backoff.left_s() <= 0:
            await self._reconnect()
        self._intake.poll()
        readings, self._readings = self._readings, {}
        return readings

    async def wait_for_data(self) -> None:
        """Return when `poll` may return something new: frames were taken in, or there is a problem."""
        await self._intake.wait_for_data()

    def drain(self) -> None:
        """Take in the frames that have arrived, so that `wait_for_data` returns."""
        self._intake.drain()

    def last_seen(self) -> Mapping[str, LastSeen]:
        """Time of the last frame of each channel, as far as frames were taken in."""
        return self._last_seen

    async def make_safe(self) -> None:
        """Do nothing: a receiver energises nothing."""

    def acquire(self, *, block_s: float | None = None) -> AbstractAsyncContextManager[AsyncIterator[FrameBlock]]:
        """Context manager whose value yields blocks of all frames between entry and exit, the last one after exit.

        Blocks are taken every `block_s`, or more often if the link cannot buffer so long.
        """
        return self._intake.acquire(block_s)

    async def _open(self) -> FrameLink:
        """Open a link that delivers frames; raises CannotConnect, NoAnswer, LinkLost."""
        link = await self._setup.wires.frames(self.name, self._setup.address)
        try:
            await self._await_frames(link)
            check_identity(self.name, self._setup.identity, await self.identify())
        except BaseException:
            link.close()
            raise
        return link

    async def _await_frames(self, link: FrameLink) -> None:
        """Wait for the first frame, where silence is a fault; raises NoAnswer."""

    @abstractmethod
    def _process(self, block: FrameBlock) -> None:
        """Process the content of a block; raises if it has a problem."""

    def _begin(self, link: FrameLink) -> None:
        self._intake = FrameIntake(self.name, link, self._process, self._setup.note)
        self._intake.begin()

    async def _reconnect(self) -> None:
        """Reopen the link; if that fails, it stays lost."""
        try:
            link = await self._open()
            try:
                link.take()  # frames received until now belong to no acquisition; raises if the link is lost again
                await self._intake.end()
            except BaseException:
                link.close()
                raise
        except DriverError:
            self._backoff.failed()
            return
        self._backoff = ReconnectBackoff()
        self._begin(link)
        self._setup.note(f"connected again at {self._setup.address}")

    def _store_readings(self, fields: Mapping[str, Field], block: FrameBlock) -> None:
        for name, (at_s, values) in readings_of(fields, block).items():
            self._readings.setdefault(name, []).extend(map(Reading, at_s.tolist(), values.tolist()))


def silence_s(period_s: float) -> float:
    """Time without a frame, in s, after which a device that sends one every `period_s` has stopped."""
    return max(SILENT_PERIODS * period_s, LEAST_SILENCE_S)


def bound_format(name: str, dbc: Path, bind: Callable[[Dbc], FormatT]) -> tuple[FormatT, str]:
    """Result of `bind` for a DBC, and a fingerprint of its text; BadAnswer if it contradicts the bench file."""
    text = text_of(dbc)
    try:
        form = bind(dbc_of(text))
    except DbcError as problem:
        raise BadAnswer(name, f"{dbc.name}: {problem}", remedy="Correct the bench file.") from problem
    return form, f"dbc sha256:{hashlib.sha256(text.encode()).hexdigest()[:16]}"


def describe_frames(ids: Iterable[int]) -> str:
    """List received frames for a message; shortened if there are many."""
    frames = {frame_id for frame_id in ids if not frame_id & ERROR}
    errors = [frame_id & (ERROR - 1) for frame_id in ids if frame_id & ERROR]
    named = [f"0x{frame_id & ~EXTENDED:x}" for frame_id in sorted(frames)[:MAX_LISTED]]
    return ", ".join([*named, *([f"error frames ({class_names(errors)})"] if errors else [])])
