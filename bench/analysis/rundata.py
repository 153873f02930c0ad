"""What a method gets of a run: counts, angles and temperatures of the acquisitions, and what is known of the bench."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]
Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Counts:
    """One channel during one acquisition, a row for each latch that came whole; all (N,) and raw.

    `tick` is the device's clock in `tick_period_s`, `positive` and `negative` are cumulative; they wrap at 2**bits.
    `sequence` is unwrapped: a step above 1 is a gap. `host_s` is the bench time of arrival, good for finding a latch
    and for nothing else. `lost` latches did not come whole, `restarts` is how often the counter began anew.
    `max_rate_pps` is the fastest that the converter can pulse.
    """

    sequence: Integers
    tick: Integers
    positive: Integers
    negative: Integers
    host_s: Array
    tick_bits: int
    counter_bits: int
    tick_period_s: float
    max_rate_pps: float
    lost: int
    restarts: int

    def part(self, first: int, last: int) -> Counts:
        """From row `first` to row `last`, both included; where the counter began anew is not known of a part."""
        rows = slice(first, last + 1)
        sequence = self.sequence[rows]
        lost = int(sequence[-1] - sequence[0]) + 1 - len(sequence) if len(sequence) else 0
        return replace(
            self, sequence=sequence, tick=self.tick[rows], positive=self.positive[rows], negative=self.negative[rows],
            host_s=self.host_s[rows], lost=lost, restarts=0,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Acquisition:
    """One acquisition: its step and the group of steps it belongs to, and what the bench did meanwhile.

    `angle_deg` is what the head read back, `mounted_deg` what the mount of the fixture adds to the mount angles;
    `set_c` is the chamber's set point at the end, `set_from_c` at the beginning, not-a-number before the first ramp;
    `counts` by channel; `temperatures_c` the values of each named reading between `begin_s` and `end_s` of bench time,
    taken at `temperatures_at_s`.
    """

    step: str
    group: str
    loops: Mapping[str, float]
    begin_s: float
    end_s: float
    angle_deg: float
    set_from_c: float
    set_c: float
    counts: Mapping[str, Counts]
    temperatures_c: Mapping[str, Array]
    temperatures_at_s: Mapping[str, Array]
    mounted_deg: float = 0.0


@dataclass(frozen=True, slots=True)
class UnitUnderTest:
    """One unit in its place."""

    place: str
    serial: str
    channel: str
    mount_angle_deg: float
    temperature: str


@dataclass(frozen=True, slots=True)
class BenchRecord:
    """What certificates and surveys say of the bench; every `u` is a standard uncertainty.

    Angles in degrees. The input axis stands at `sense` x head angle + `offset_deg` + level above the horizontal.
    `harmonics_u_deg` are those of the cosine and of the sine amplitude of harmonics 1, 2, … of the head's error.
    `thermometers_u` gives offset (°C) and gain (on the temperature in °C) by the name of the reading.
    """

    gravity_mps2: float
    gravity_u_mps2: float
    sense: int
    offset_deg: float
    level_deg: float
    level_u_deg: float
    zero_u_deg: float
    harmonics_u_deg: tuple[float, ...]
    repeatability_u_deg: float
    time_base_u: float
    thermometers_u: Mapping[str, tuple[float, float]]


@dataclass(frozen=True, slots=True)
class RunData:
    """The acquisitions under one label, in the order of the run, and what is needed to reduce them."""

    label: str
    units: tuple[UnitUnderTest, ...]
    acquisitions: tuple[Acquisition, ...]
    bench: BenchRecord
