"""The pulse counter: takes in frames, watches that they keep coming, and hands out blocks of them."""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import AsyncIterator, Collection, Mapping, Sequence
from contextlib import asynccontextmanager
from typing import Self

import numpy as np

from drivers.can_counter import wire
from drivers.can_counter.description import IDLE_BLOCK_S, CounterOptions
from drivers.dbc import Dbc, DbcError
from drivers.description import Nothing, Setup, check_identity
from drivers.errors import BadAnswer, DriverError, InstrumentFault, NoAnswer
from drivers.frame_block import EXTENDED, FrameBlock
from drivers.transport.frames import FrameLink
from drivers.values import Heard, Identity, Reading

FIRST_FRAME_S = 3.0
ACQUIRING_BLOCK_S = 1.0  # what is not yet durable when the power fails
SILENT_PERIODS = 25
STANDING_LATCHES = 3  # as many latches with one sequence number mean that the counter stands still


class CanCounter:
    """Counters that run freely; nothing is ever sent to them.

    Lifetime: a task of its own takes frames in from entry to exit. What it finds wrong is raised by the next `poll`
    and by the acquisition under way.
    """

    def __init__(self, setup: Setup[CounterOptions, Nothing, Nothing]) -> None:
        self.name = setup.name
        self._setup = setup
        self._options = setup.options
        self._readings: dict[str, list[Reading]] = {}
        self._acquisition: _Blocks | None = None
        self._wake = asyncio.Event()
        self._failure: DriverError | None = None
        self._last_latch_s = 0.0
        self._last_numbers = np.empty(0, np.int64)  # of the last latches
        self._heard: dict[str, Heard] = {}
        self._newest: dict[str, tuple[int, int]] = {}  # counts by channel
        self._link: FrameLink
        self._format: wire.CounterFormat
        self._intake: asyncio.Task[None]

    async def __aenter__(self) -> Self:
        """Opens the channel and waits for a first latch; raises CannotConnect, NoAnswer, BadAnswer."""
        self._format, self._dbc_hash = self._bind()
        self._link = await self._setup.wires.frames(self.name, self._setup.address)
        try:
            await self._first_latch()
            check_identity(self.name, self._setup.identity, await self.identify())
        except BaseException:
            self._link.close()
            raise
        self._intake = asyncio.create_task(self._take_in(), name=f"{self.name} intake")
        return self

    async def __aexit__(self, *exc: object) -> None:
        """Closes the channel."""
        self._intake.cancel()
        await asyncio.wait([self._intake])
        self._link.close()

    async def identify(self) -> Identity:
        """The wire tells no serial number; the fingerprint is that of the frames' description."""
        stated = self._setup.identity
        return Identity(
            maker=stated.maker or "", model=stated.model or "", serial=stated.serial or "",
            firmware=stated.firmware or "", verified=False, fingerprint=f"dbc sha256:{self._dbc_hash[:16]}",
        )  # fmt: skip

    async def poll(self) -> Mapping[str, Sequence[Reading]]:
        """Temperatures in the frames since the last poll; raises what has gone wrong with the frames."""
        if self._failure is not None:
            raise self._failure
        readings, self._readings = self._readings, {}
        return readings

    def heard(self) -> Mapping[str, Heard]:
        """When each channel was last heard of, as far as its frames have been taken in."""
        return self._heard

    async def make_safe(self) -> None:
        """Nothing to do: a counter energises nothing."""

    @asynccontextmanager
    async def acquire(self) -> AsyncIterator[AsyncIterator[FrameBlock]]:
        """Blocks of all frames that arrive between entry and exit; iterate on after the exit for the last one."""
        if self._acquisition is not None:
            raise InstrumentFault(self.name, "an acquisition is under way already")
        self._absorb()
        if self._failure is not None:
            raise self._failure
        blocks = self._acquisition = _Blocks()
        self._wake.set()
        try:
            yield blocks
            self._absorb()
        finally:
            self._acquisition = None
            blocks.end(self._failure)

    def _bind(self) -> tuple[wire.CounterFormat, str]:
        options = self._options
        text = options.dbc.read_text(encoding="utf-8", errors="replace")
        channels = {name: channel.model_dump() for name, channel in options.channels.items()}
        positions = {name: encoder.model_dump() for name, encoder in options.positions.items()}
        try:
            form = wire.counter_format(
                Dbc(text), options.latch.model_dump(), options.latch.tick_period, channels, positions
            )
        except DbcError as problem:
            raise BadAnswer(self.name, f"{options.dbc.name}: {problem}", remedy="Correct the bench file.") from problem
        return form, hashlib.sha256(text.encode()).hexdigest()

    async def _first_latch(self) -> None:
        loop = asyncio.get_running_loop()
        deadline = loop.time() + FIRST_FRAME_S
        heard: set[int] = set()
        while not len(wire.latches(self._format, block := self._link.take())[0]):
            heard.update(block.ids.tolist())
            if loop.time() >= deadline:
                raise self._no_latch(heard)
            await asyncio.sleep(self._options.period)
        self._last_latch_s = loop.time()
        self._heard = dict.fromkeys(self._options.channels, Heard(loop.time(), loop.time()))

    def _no_latch(self, heard: Collection[int]) -> NoAnswer:
        """Says which frames came instead of a latch."""
        latch = self._format.sequence.message
        problem = (
            f"no {latch.name} frame (0x{latch.id & ~EXTENDED:x}) within {FIRST_FRAME_S:g} s on {self._setup.address}"
        )
        if heard:
            others = ", ".join(f"0x{frame_id & ~EXTENDED:x}" for frame_id in sorted(heard)[:8])
            return NoAnswer(self.name, problem, received=others, remedy="Check that the DBC is that of this counter.")
        remedy = "Check that the converter is on, the bus is terminated, and the bit rate is right."
        return NoAnswer(self.name, problem, received="no frame at all", remedy=remedy)

    async def _take_in(self) -> None:
        """Takes frames in from time to time, more often while somebody acquires."""
        while self._failure is None:
            block_s = IDLE_BLOCK_S if self._acquisition is None else ACQUIRING_BLOCK_S
            try:
                async with asyncio.timeout(block_s):
                    await self._wake.wait()
                self._wake.clear()
            except TimeoutError:
                self._absorb()

    def _absorb(self) -> None:
        """Takes what has arrived by now; a fault ends the intake and the acquisition."""
        if self._failure is not None:
            return
        try:
            block = self._link.take()
            for name, (at_s, values) in wire.temperatures(self._format, block).items():
                fresh = self._readings.setdefault(name, [])
                fresh.extend(map(Reading, at_s.tolist(), values.tolist()))
            if self._acquisition is not None:
                self._acquisition.put(block)
            self._watch(block)
            self._listen(block)
        except DriverError as problem:
            self._failure = problem
            self._link.close()  # or frames would go on piling up
            if self._acquisition is not None:
                self._acquisition.end(problem)

    def _watch(self, block: FrameBlock) -> None:
        """Raises when latches have stopped coming, or come with one sequence number."""
        sequence, at_s = wire.latches(self._format, block)
        if len(sequence):
            self._last_latch_s = float(at_s[-1])
        self._last_numbers = np.concatenate([self._last_numbers, sequence])[-STANDING_LATCHES:]
        silent_s = SILENT_PERIODS * self._options.period
        if asyncio.get_running_loop().time() - self._last_latch_s > silent_s:
            raise NoAnswer(
                self.name, f"counter frames have stopped: none for more than {silent_s:g} s",
                remedy="Check the converter's power, the CAN cable and the adapter, then run again.",
            )  # fmt: skip
        if len(self._last_numbers) == STANDING_LATCHES and not np.diff(self._last_numbers).any():
            raise InstrumentFault(
                self.name, f"the counter stands still: its latches have the sequence number {self._last_numbers[0]}",
                remedy="Restart the converter; its frames repeat old counts.",
            )  # fmt: skip

    def _listen(self, block: FrameBlock) -> None:
        """Notes what each channel has said."""
        for channel, before in self._heard.items():
            newest = wire.newest_counts(self._format, channel, block)
            if newest is not None:
                at_s, counts = newest
                pulse_s = before.pulse_s if self._newest.get(channel) == counts else at_s
                self._heard[channel], self._newest[channel] = Heard(at_s, pulse_s), counts


class _Blocks(AsyncIterator[FrameBlock]):
    """Blocks from the intake to whoever acquires."""

    def __init__(self) -> None:
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
