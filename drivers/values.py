"""What drivers give and take: readings, identities, frame blocks, positions of chamber and axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Reading(NamedTuple):
    """A value of one channel and the loop time at which it was true; the channel's description names the unit."""

    at_s: float
    value: float


@dataclass(frozen=True, slots=True)
class Identity:
    """Who answered. `verified` is False where the wire cannot tell a serial number; `fingerprint` is what it can."""

    maker: str = ""
    model: str = ""
    serial: str = ""
    firmware: str = ""
    verified: bool = True
    fingerprint: str = ""


@dataclass(frozen=True, slots=True)
class ChamberState:
    """One coherent look at a chamber, °C; `set_point_c` is in force now and moves while the chamber ramps."""

    process_value_c: float
    set_point_c: float
    target_c: float


@dataclass(frozen=True, slots=True)
class SourceReading:
    """What a supply or a source says of its output: V, A, and whether the output is on."""

    voltage_v: float
    current_a: float
    output: bool


@dataclass(frozen=True, slots=True)
class FrameBlock:
    """CAN frames in order of arrival.

    `ids` (N,) uint32, `at_s` (N,) float64 loop time of arrival, `dlc` (N,) uint8, `data` (N, 8) uint8, zero past dlc.
    """

    ids: NDArray[np.uint32]
    at_s: NDArray[np.float64]
    dlc: NDArray[np.uint8]
    data: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.ids)

    @classmethod
    def empty(cls) -> FrameBlock:
        """A block without frames."""
        return cls(np.empty(0, np.uint32), np.empty(0, np.float64), np.empty(0, np.uint8), np.empty((0, 8), np.uint8))
