"""A CAN log as a frame link, which plays frames at their recorded intervals."""

from __future__ import annotations

import asyncio
from pathlib import Path

import numpy as np

from drivers.can.frame_block import FrameBlock
from drivers.errors import NoAnswer

LOG_BLOCK_S = 10.0  # recorded frames may stay buffered
ENDED_AFTER_S = 1.0


class LoggedFrames:
    """Plays the frames of a log (N,), starting now."""

    block_s = LOG_BLOCK_S

    def __init__(self, device: str, path: Path, frames: FrameBlock) -> None:
        self._device, self._path = device, path
        since_s = np.maximum.accumulate(frames.at_s - frames.at_s[0])
        began_s = asyncio.get_running_loop().time()
        self._frames = FrameBlock(frames.ids, began_s + since_s, frames.dlc, frames.data)
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
        rows = np.arange(begin, end)
        return FrameBlock(self._frames.ids[rows], at_s[rows], self._frames.dlc[rows], self._frames.payloads(rows))

    def close(self) -> None:
        """Do nothing: nothing is open."""
