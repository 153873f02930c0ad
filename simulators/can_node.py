"""What all simulated CAN nodes are: they are worked out lazily, and have sent what was due when somebody takes it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from drivers.dbc import Dbc, Field, encode_frames
from drivers.errors import LinkLost
from drivers.frame_block import FrameBlock
from simulators.faults import LOOKED_FOR, FaultKind, FaultPlan, Mishap
from simulators.world import World

Array = NDArray[np.float64]
TEMPERATURE_PERIOD_S = 1.0
BLOCK_S = 30.0  # what a power cut costs a rehearsal is done again, and a block costs more than its frames


class CanNode(ABC):
    """A node on the bus; a frame link whose frames are those it has sent.

    A block of frames comes into being when somebody takes it, or just before a stimulus changes.
    """

    MISHAPS: ClassVar[Mapping[FaultKind, Mishap]] = {"frozen": LOOKED_FOR, "restart": LOOKED_FOR}

    def __init__(self, name: str, world: World, faults: FaultPlan) -> None:
        self.faults = faults
        self._name, self._world = name, world
        self._sent: list[FrameBlock] = []

    @property
    def block_s(self) -> float:
        """How long its frames may be left with it."""
        return BLOCK_S

    def take(self) -> FrameBlock:
        """Every frame sent since the last call; LinkLost when the connection is cut."""
        self._world.look()
        self._catch_up()
        sent, self._sent = self._sent, []
        if self.faults.active("cut"):
            raise LinkLost(self._name, "the connection was cut", remedy="Check the cable, then run again.")
        return self._heard(FrameBlock.joined(sent))

    def close(self) -> None:  # noqa: B027  nothing is to be done
        """Nobody listens any more; the node does not care."""

    def _heard(self, frames: FrameBlock) -> FrameBlock:
        """Frames without those that were sent while it was silent."""
        for span_s in self.faults.spans_s("silent"):
            begin_s, end_s = self._world.host_time(np.array(span_s))
            frames = _rows(frames, np.flatnonzero((frames.at_s < begin_s) | (frames.at_s >= end_s)))
        return frames

    @abstractmethod
    def _catch_up(self) -> None:
        """Sends what is due."""


def in_order(blocks: list[FrameBlock]) -> FrameBlock:
    """Frames of several blocks in the order of their times."""
    frames = FrameBlock.joined(blocks)
    return _rows(frames, np.argsort(frames.at_s, kind="stable"))


def _rows(frames: FrameBlock, rows: NDArray[np.intp]) -> FrameBlock:
    return FrameBlock(frames.ids[rows], frames.at_s[rows], frames.dlc[rows], frames.payloads(rows))


def temperature_frames(
    dbc: Dbc, fields: Mapping[str, Field], celsius: Callable[[str], Array], host_s: Array
) -> FrameBlock:
    """One frame of each message with temperatures at each time; `celsius` gives them by `Message.Signal`."""
    values: dict[str, dict[str, NDArray[np.int64]]] = {}
    for name, (message, signal) in fields.items():
        raw = np.rint((celsius(name) - signal.offset) / signal.scale).astype(np.int64)
        values.setdefault(message.name, {})[signal.name] = raw
    return encode_frames(dbc, host_s, values)
