"""Decoded frames of a device: counts, samples and positions in raw units, and the decoder interface."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.can.frame_block import FrameBlock
from drivers.can.sequence_numbers import Integers


class Counts(NamedTuple):
    """Raw counts of one channel, one row for each latch of which all frames arrived.

    `sequence` (N,) is unwrapped, so a step above 1 is a gap; `tick`, `positive`, `negative` (N,) are raw and wrap at
    `2**bits` of their field; `host_s` (N,) is the arrival of the latch. `lost` counts incomplete latches, without the
    last one, whose frames may arrive after the end; `gaps` (G, 2) holds the first and last sequence number of each run
    of lost latches, counted as `sequence`, which starts at the number of the `first` latch. `dropped` counts duplicated
    and late frames, `restarts` the restarts of the counter.
    """

    sequence: Integers
    tick: Integers
    positive: Integers
    negative: Integers
    host_s: NDArray[np.float64]
    tick_bits: int
    counter_bits: int
    first: int
    gaps: Integers
    lost: int
    dropped: int
    restarts: int


class Samples(NamedTuple):
    """Samples of one channel, one row for each valid sample that arrived once and in order.

    `sequence` (N,) is unwrapped, so a step above 1 is a gap; `tick` (N,) is raw and wraps at `2**tick_bits`; `values`
    (N,) are codes or decoded values; `host_s` (N,) is the arrival. `lost` counts lost samples, `gaps` (G, 2) holds the
    first and last sequence number of each run of lost samples, counted as `sequence`, which starts at the number of the
    `first` sample. `dropped` counts duplicated and late samples, `invalid` those marked invalid by the unit, `restarts`
    the restarts of the unit.
    """

    sequence: Integers
    tick: Integers
    values: NDArray[np.float64]
    host_s: NDArray[np.float64]
    tick_bits: int
    first: int
    gaps: Integers
    lost: int
    dropped: int
    invalid: int
    restarts: int


class Positions(NamedTuple):
    """Raw positions of one encoder, one row for each latch of which all frames arrived; `position` wraps.

    `sequence` (N,) is the number of the latch or sample of each position; `tick` (N,) is raw, `host_s` (N,) its time of
    arrival. `lost` counts incomplete latches, `restarts` changes of the boot counter.
    """

    sequence: Integers
    tick: Integers
    position: Integers
    host_s: NDArray[np.float64]
    tick_bits: int
    position_bits: int
    lost: int
    restarts: int


class Scale(NamedTuple):
    """Linear scale: a value is `factor` times its code plus `offset`."""

    factor: float = 1.0
    offset: float = 0.0


class GapWatch(Protocol):
    """Quick check of the blocks of one acquisition; `is_whole` is False once a frame may be missing."""

    @property
    def is_whole(self) -> bool:
        """True as long as no frame can be missing."""

    def take(self, block: FrameBlock) -> None:
        """Check the next block."""


class FrameDecoder(ABC):
    """Decodes the frames of one device, live and from the record of a run.

    `scales` convert the codes of channels that send samples; a channel without scale sends decoded values.
    """

    scales: Mapping[str, Scale] = MappingProxyType({})

    @abstractmethod
    def outputs(self, block: FrameBlock) -> Mapping[str, Counts | Samples]:
        """Decode the counts or samples of every channel."""

    @abstractmethod
    def watches(self) -> Sequence[GapWatch]:
        """Gap checks for a new acquisition. They may report a gap where there is none, but must not miss one."""

    def positions(self, block: FrameBlock) -> Mapping[str, Positions]:
        """Decode encoder positions, by the devices that drive their axes."""
        return {}
