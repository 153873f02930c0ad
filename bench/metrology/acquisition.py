"""What was acquired, raw: counts, encoders, volts and codes of an acquisition, and what the bench did meanwhile."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from bench.metrology.missed import Missed

Integers = NDArray[np.int64]
Array = NDArray[np.float64]
NO_GAPS: Integers = np.empty((0, 2), np.int64)


@dataclass(frozen=True, slots=True)
class Shift:
    """A change of an output: `times` its value and `more` in its unit, a rate in pulse/s where pulses are counted."""

    times: float = 1.0
    more: float = 0.0

    def of(self, value: float) -> float:
        """A changed output."""
        return self.times * value + self.more

    def of_each(self, values: Array) -> Array:
        """Changed outputs."""
        return self.times * values + self.more


UNCHANGED = Shift()


@dataclass(frozen=True, slots=True)
class Counts:
    """One channel during one acquisition, a row for each latch that came whole; all (N,) and raw.

    `tick` is the device's clock in `tick_period_s`, `positive` and `negative` are cumulative; they wrap at 2**bits.
    `sequence` is unwrapped: a step above 1 is a gap. `host_s` is the bench time of arrival, good for finding a latch
    and for nothing else. `lost` latches did not come whole, `restarts` is how often the counter began anew.
    `max_rate_pps` is the fastest that the converter can pulse. `gaps` (G, 2) are the numbers of the first and the last
    of each row of latches that did not come whole. `shift` is by what the rate is taken to be another than was counted.
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
    gaps: Integers = field(default_factory=lambda: NO_GAPS)
    shift: Shift = UNCHANGED

    def part(self, first: int, last: int) -> Counts:
        """From row `first` to row `last`, both included; its gaps, and where it began anew, are not told of a part."""
        rows = slice(first, last + 1)
        sequence = self.sequence[rows]
        lost = int(sequence[-1] - sequence[0]) + 1 - len(sequence) if len(sequence) else 0
        return replace(
            self, sequence=sequence, tick=self.tick[rows], positive=self.positive[rows], negative=self.negative[rows],
            host_s=self.host_s[rows], lost=lost, restarts=0, gaps=NO_GAPS,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Positions:
    """The encoder of an axis during one acquisition, a row for each latch that came whole; all (N,) and raw.

    `sequence` numbers the latches as those of the counts of the same counter, or as the samples of the `channel` of
    telemetry that they are latched with. `position` is in counts of `resolution_deg`, wraps at 2**position_bits and may
    be signed; `host_s` is as in Counts.
    """

    sequence: Integers
    tick: Integers
    position: Integers
    tick_bits: int
    position_bits: int
    tick_period_s: float
    resolution_deg: float
    host_s: Array = field(default_factory=lambda: np.empty(0))
    channel: str = ""


@dataclass(frozen=True, slots=True)
class Motion:
    """What a table was told to do while something was acquired, and did fully when that began.

    It turned at `rate_dps`, or swung by ± `amplitude_deg` at `frequency_hz`; the other is None.
    """

    device: str
    rate_dps: float | None = None
    amplitude_deg: float | None = None
    frequency_hz: float | None = None


@dataclass(frozen=True, slots=True)
class Mount:
    """How the units are fixed, in degrees.

    Raised about the output axis by `angle_deg`, then rolled about the input axis, then clocked about the pendulous one.
    """

    name: str = ""
    angle_deg: float = 0.0
    roll_deg: float = 0.0
    clock_deg: float = 0.0


@dataclass(frozen=True, slots=True)
class Voltages:
    """What a voltmeter read during one acquisition, (n,) and raw: `values_v` at `at_s` of bench time, their middles."""

    at_s: Array
    values_v: Array


@dataclass(frozen=True, slots=True)
class Currents:
    """What an ammeter read during one acquisition, (n,): `values_a` at `at_s` of bench time, their middles."""

    at_s: Array
    values_a: Array


@dataclass(frozen=True, slots=True)
class Codes:
    """What a unit sent of its own output during one acquisition, a row for each sample that came once and valid; (N,).

    `values` are codes, or what they are decoded to, in steps of `step`. `sequence`, `tick`, `host_s`, `lost` and `gaps`
    are as in Counts, by the clock of the unit; `dropped` came twice or late, `invalid` the unit marked itself.
    `stuck_after` samples with one value are more than its noise lets be; None where nobody says. With `averaged` a
    sample is the mean over the time from the one before, else the output at its tick. `restarts` is how often the unit
    was seen to begin anew with lower numbers.
    """

    sequence: Integers
    tick: Integers
    values: Array
    host_s: Array
    tick_bits: int
    tick_period_s: float
    step: float
    lost: int
    dropped: int
    invalid: int
    stuck_after: int | None = None
    averaged: bool = True
    restarts: int = 0
    gaps: Integers = field(default_factory=lambda: NO_GAPS)

    def part(self, first: int) -> Codes:
        """From row `first` on; what did not come is not known of a part."""
        rows = slice(first, None)
        return replace(
            self, sequence=self.sequence[rows], tick=self.tick[rows], values=self.values[rows],
            host_s=self.host_s[rows], lost=0, dropped=0, invalid=0, gaps=NO_GAPS,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Window:
    """What is kept of one channel where only its mean is wanted.

    The mean output, such as a net rate in pulse/s, over `span_s` of the clock that it was counted by, which the host's
    clock took for `host_span_s`. A mean of samples is counted by none: both are the host's. `problems` make it
    unusable. `alone_u` and `step_u` are those of an Output.
    """

    mean: float
    span_s: float
    host_span_s: float
    problems: tuple[str, ...]
    alone_u: float = 0.0
    step_u: float = 0.0


@dataclass(frozen=True, slots=True)
class Turned:
    """A rotation meanwhile: of which axis, at which rate it was told, and where it stood when (bench time)."""

    axis: str
    command_dps: float
    from_s: float
    from_deg: float
    to_s: float
    to_deg: float


@dataclass(frozen=True, slots=True)
class Acquisition:
    """One acquisition: its step and the group of steps it belongs to, and what the bench did meanwhile.

    `angles_deg` is what each axis of the table read back, outer first, `mount` how the units were fixed; `set_c` is the
    chamber's set point at the end, `set_from_c` at the beginning, not-a-number before the first ramp; `counts` by
    channel, `voltages` by voltmeter, `currents` by ammeter, `codes` by channel of the telemetry; `temperatures_c` the
    values of each named reading between `begin_s` and `end_s` of bench time, taken at `temperatures_at_s`. Where
    `input` is "source" the converter is fed by a current source; `sources_a` is what those that are on give, by their
    roles, `sources_told_a` what they were read back to give where a certificate corrects that. One that was to become
    stable is read over its last `over_s`; `stable` are the places of the units that did. `turned` is a rotation over
    whole turns meanwhile. Where only means are wanted `windows` stand in place of `counts`, so that a long run is not
    in memory all at once. `positions` are those of the encoders that a counter latches, by the devices that drive the
    axes, `motion` is None where no table turned or swung. `on_since_s` are the supplies that are on, by their roles,
    each with the bench times between which it was put on. `missed` is what did not come, by device and channel.
    `came_from` is the side, "below" or "above", from which each axis came to its angle at last, without those of which
    that is not known; `stand` counts the moves of all axes before, so that it is the same while none has moved.
    `stretch` counts the interruptions of the run before.
    """

    step: str
    group: str
    loops: Mapping[str, float]
    begin_s: float
    end_s: float
    angles_deg: Mapping[str, float]
    set_from_c: float
    set_c: float
    counts: Mapping[str, Counts]
    temperatures_c: Mapping[str, Array]
    temperatures_at_s: Mapping[str, Array]
    mount: Mount = Mount()
    voltages: Mapping[str, Voltages] = field(default_factory=dict)
    turned: Turned | None = None
    windows: Mapping[str, Window] = field(default_factory=dict)
    input: str = "accelerometer"
    sources_a: Mapping[str, float] = field(default_factory=dict)
    sources_told_a: Mapping[str, float] = field(default_factory=dict)
    currents: Mapping[str, Currents] = field(default_factory=dict)
    over_s: float | None = None
    stable: frozenset[str] | None = None
    positions: Mapping[str, Positions] = field(default_factory=dict)
    motion: Motion | None = None
    on_since_s: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    codes: Mapping[str, Codes] = field(default_factory=dict)
    missed: Mapping[tuple[str, str], Missed] = field(default_factory=dict)
    came_from: Mapping[str, str] = field(default_factory=dict)
    stand: int = 0
    stretch: int = 0

    @property
    def angle_deg(self) -> float:
        """The angle of the head, which is the outermost axis; 0 without one."""
        return next(iter(self.angles_deg.values()), 0.0)
