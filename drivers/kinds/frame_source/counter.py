"""Common part of drivers of free-running pulse counters, independent of their frame format."""

from __future__ import annotations

import asyncio
from abc import abstractmethod
from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from drivers.can.dbc import Field, Message
from drivers.can.frame_block import EXTENDED, FrameBlock
from drivers.can.sequence_numbers import Integers
from drivers.description import Nothing, OptionsT, Setup
from drivers.errors import InstrumentFault, NoAnswer
from drivers.kinds.frame_source.intake import FROZEN_FRAMES, FrameDriver, describe_frames, silence_s
from drivers.timing.awake import awake_s
from drivers.transport.frame_link import FrameLink
from drivers.values import LastSeen

FIRST_FRAME_S = 3.0
Newest = Mapping[str, tuple[float, tuple[int, int]]]
"""By channel: arrival time of its last frame, and its counts."""


class FreeCounter(FrameDriver[OptionsT]):
    """Free-running counters; the driver never sends.

    A subclass gives the message of latches, its period and the fields of temperatures, and reads blocks. Lifetime: a
    task of its own receives frames from entry to exit. A problem is raised by the next `poll` and by a running
    acquisition.
    """

    def __init__(self, setup: Setup[OptionsT, Nothing, Nothing], period_s: float, channels: Collection[str]) -> None:
        super().__init__(setup)
        self._period_s, self._channels = period_s, channels
        self._last_latch_s = 0.0
        self._last_numbers: list[int] = []  # sequence numbers of the last latches
        self._counts: dict[str, tuple[int, int]] = {}  # newest counts of each channel

    @property
    @abstractmethod
    def _latch(self) -> Message:
        """Message of the latch, sent once per period."""

    @property
    @abstractmethod
    def _temperatures(self) -> Mapping[str, Field]:
        """Temperature fields, by reading name."""

    @abstractmethod
    def _latches(self, block: FrameBlock) -> tuple[Integers, NDArray[np.float64]]:
        """Raw numbers and arrival times of the latches in a block."""

    @abstractmethod
    def _newest(self, block: FrameBlock) -> Newest:
        """Newest counts in a block, without channels that have none."""

    async def _await_frames(self, link: FrameLink) -> None:
        loop = asyncio.get_running_loop()
        deadline = loop.time() + FIRST_FRAME_S
        received_ids: set[int] = set()
        while not len(self._latches(block := link.take())[0]):
            received_ids.update(block.ids.tolist())
            if loop.time() >= deadline:
                raise self._no_latch(received_ids)
            await asyncio.sleep(self._period_s)
        self._last_latch_s = loop.time()
        self._last_seen = dict.fromkeys(self._channels, LastSeen(loop.time(), loop.time()))

    def _no_latch(self, received_ids: Collection[int]) -> NoAnswer:
        """NoAnswer error that lists the frames received instead of a latch."""
        latch = self._latch
        problem = (
            f"no {latch.name} frame (0x{latch.id & ~EXTENDED:x}) within {FIRST_FRAME_S:g} s on {self._setup.address}"
        )
        if received_ids:
            remedy = "Check that the options in the bench file, such as the DBC, fit this counter."
            return NoAnswer(self.name, problem, received=describe_frames(received_ids), remedy=remedy)
        remedy = "Check that the converter is on, the bus is terminated, and the bit rate is right."
        return NoAnswer(self.name, problem, received="no frame at all", remedy=remedy)

    def _process(self, block: FrameBlock) -> None:
        """Decode readings and the newest counts of a block; raises if the block has a problem."""
        self._store_readings(self._temperatures, block)
        self._check_latches(block)
        self._store_newest(block)

    def _check_latches(self, block: FrameBlock) -> None:
        """Raise if latches have stopped, or repeat one sequence number."""
        sequence, at_s = self._latches(block)
        if len(sequence):
            self._last_latch_s = float(at_s[-1])
            self._last_numbers = [*self._last_numbers, *sequence[-FROZEN_FRAMES:].tolist()][-FROZEN_FRAMES:]
        silent_s = silence_s(self._period_s)
        if awake_s(self._last_latch_s) > silent_s:
            raise NoAnswer(
                self.name, f"counter frames have stopped: none for more than {silent_s:g} s",
                remedy="Check the converter's power, the CAN cable and the adapter, then run again.",
            )  # fmt: skip
        if len(self._last_numbers) == FROZEN_FRAMES and len(set(self._last_numbers)) == 1:
            raise InstrumentFault(
                self.name, f"the counter is frozen: its latches have the sequence number {self._last_numbers[0]}",
                remedy="Restart the converter; its frames repeat old counts.",
            )  # fmt: skip

    def _store_newest(self, block: FrameBlock) -> None:
        """Store the newest value of each channel."""
        for channel, (at_s, counts) in self._newest(block).items():
            change_s = self._last_seen[channel].change_s if self._counts.get(channel) == counts else at_s
            self._last_seen[channel], self._counts[channel] = LastSeen(at_s, change_s), counts
