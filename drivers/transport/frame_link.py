"""CAN as blocks of frames: the contract of a channel, whatever carries it."""

from __future__ import annotations

from typing import Protocol

from drivers.can.frame_block import FrameBlock

DURABLE_BLOCK_S = 1.0  # what is not with the run store yet when the power fails


class FrameLink(Protocol):
    """An open CAN channel that buffers received frames until they are taken."""

    @property
    def block_s(self) -> float:
        """How long frames that are recorded may be left with it; a power cut costs them."""

    def take(self) -> FrameBlock:
        """Every frame that has arrived since the last call, in order; LinkLost when the channel is gone."""

    def close(self) -> None:
        """Closes the channel; closing twice is harmless."""
