"""What all simulated CAN nodes are: they are worked out lazily, and have sent what was due when somebody takes it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from drivers.dbc import Dbc, Field, encode_frames
from drivers.errors import LinkLost
from drivers.frame_block import FrameBlock
from simulators.faults import FaultPlan
from simulators.world import World

Array = NDArray[np.float64]
TEMPERATURE_PERIOD_S = 1.0
BLOCK_S = 30.0  # what a power cut costs a rehearsal is done again, and a block costs more than its frames


class CanNode(ABC):
    """A node on the bus; a frame link whose frames are those it has sent.

    A block of frames comes into being when somebody takes it, or just before a stimulus changes.
    """

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
        if self.faults.active("silent"):
            return _before(
                FrameBlock.joined(sent), float(self._world.host_time(np.array(self.faults.since_s("silent"))))
            )
        return FrameBlock.joined(sent)

    def close(self) -> None:  # noqa: B027  nothing is to be done
        """Nobody listens any more; the node does not care."""

    @abstractmethod
    def _catch_up(self) -> None:
        """Sends what is due."""


def in_order(blocks: list[FrameBlock]) -> FrameBlock:
    """Frames of several blocks in the order of their times."""
    frames = FrameBlock.joined(blocks)
    return _rows(frames, np.argsort(frames.at_s, kind="stable"))


def _before(frames: FrameBlock, at_s: float) -> FrameBlock:
    """What was sent before a time of the host's clock."""
    return _rows(frames, np.flatnonzero(frames.at_s < at_s))


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
