"""CAN as blocks of frames: the contract of a channel, whatever carries it."""

from __future__ import annotations

from typing import Protocol

from drivers.frame_block import FrameBlock


class FrameLink(Protocol):
    """An open CAN channel that collects what arrives until somebody takes it."""

    def take(self) -> FrameBlock:
        """Every frame that has arrived since the last call, in order; LinkLost when the channel is gone."""

    def close(self) -> None:
        """Closes the channel; closing twice is harmless."""
