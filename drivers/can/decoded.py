"""Frames of a device decoded: counts, samples and positions as they were on the wire, and what decodes them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.can.frame_block import FrameBlock
from drivers.can.sequence_numbers import Integers


@dataclass(frozen=True, slots=True)
class Counts:
    """One channel as the wire gave it, a row for each latch whose frames all came.

    `sequence` (N,) is unwrapped, so a step above 1 is a gap; `tick`, `positive`, `negative` (N,) are raw and wrap at
    `2**bits` of their field; `host_s` (N,) is the arrival of the latch. `lost` counts latches that did not come whole,
    but for the very last one, whose frames may come after the end; `gaps` (G, 2) are the numbers of the first and of
    the last of each row of them, in the numbers of `sequence`, which begin with that of the `first` latch. `dropped`
    counts frames that came twice or late, `restarts` how often the counter restarted.
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


@dataclass(frozen=True, slots=True)
class Samples:
    """One channel as the wire gave it, a row for each sample that came once, in order and valid.

    `sequence` (N,) is unwrapped, so a step above 1 is a gap; `tick` (N,) is raw and wraps at `2**tick_bits`; `values`
    (N,) are codes, or what they are decoded to; `host_s` (N,) is the arrival. `lost` counts samples that did not come,
    `gaps` (G, 2) are the numbers of the first and of the last of each row of them, in the numbers of `sequence`, which
    begin with that of the `first` sample. `dropped` counts those that came twice or late, `invalid` those that the unit
    marked, `restarts` how often it began anew.
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


@dataclass(frozen=True, slots=True)
class Positions:
    """One encoder as the wire gave it, a row for each latch whose frames all came; `position` wraps.

    `sequence` (N,) numbers the latches, or the samples, that they belong to; `tick` (N,) is raw, `host_s` (N,) is when
    these arrived. `lost` counts those whose frames did not all come, `restarts` changes of a boot counter.
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
    """A value is `factor` times its code plus `offset`."""

    factor: float = 1.0
    offset: float = 0.0


class GapWatch(Protocol):
    """Quick check of the blocks of one acquisition; `is_whole` is False once a frame may be missing."""

    @property
    def is_whole(self) -> bool:
        """True until a frame may be missing."""

    def take(self, block: FrameBlock) -> None:
        """Check the next block."""


class FrameDecoder(ABC):
    """Decodes the frames of one device, live and from the record of a run.

    `scales` are those of channels that send samples, where these are not codes as they come.
    """

    scales: Mapping[str, Scale] = MappingProxyType({})

    @abstractmethod
    def outputs(self, block: FrameBlock) -> Mapping[str, Counts | Samples]:
        """The counts or samples of every channel in these frames."""

    @abstractmethod
    def watches(self) -> Sequence[GapWatch]:
        """Watches for a new acquisition. They may report a gap that is none, but must not miss one."""

    def positions(self, block: FrameBlock) -> Mapping[str, Positions]:
        """What the encoders read, by the devices that drive their axes."""
        return {}
