"""Interface of a CAN channel that delivers blocks of frames."""

from __future__ import annotations

from typing import Protocol

from drivers.can.frame_block import FrameBlock

DURABLE_BLOCK_S = 1.0  # data not yet in the run store are lost in a power failure


class FrameLink(Protocol):
    """An open CAN channel that buffers received frames until they are taken."""

    @property
    def block_s(self) -> float:
        """Maximum time for which recorded frames may stay in the link; a power cut loses them."""

    def take(self) -> FrameBlock:
        """Frames that have arrived since the last call, in order; LinkLost if the channel is gone."""

    def close(self) -> None:
        """Close the channel; closing twice is harmless."""
