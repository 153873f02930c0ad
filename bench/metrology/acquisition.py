"""Raw data of an acquisition: counts, encoders, voltages and codes, with the state of the bench meanwhile."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.metrology.missed import Missed

Integers = NDArray[np.int64]
Array = NDArray[np.float64]
NO_GAPS: Integers = np.empty((0, 2), np.int64)


class Shift(NamedTuple):
    """A change of an output: `times` its value plus `more` in its unit, a rate in pulse/s for pulse counts."""

    times: float = 1.0
    more: float = 0.0

    def of(self, value: float) -> float:
        """Apply the change to an output."""
        return self.times * value + self.more

    def of_each(self, values: Array) -> Array:
        """Apply the change to outputs (n,)."""
        return self.times * values + self.more


UNCHANGED = Shift()


@dataclass(frozen=True, slots=True)
class Counts:
    """One channel during one acquisition, a row for each complete latch; all (N,) and raw.

    `tick` is the device's clock in `tick_period_s`, `positive` and `negative` are cumulative; they wrap at 2**bits.
    `sequence` is unwrapped: a step above 1 is a gap. `host_s` is the bench time of arrival, suitable only for locating
    a latch. `lost` is the number of lost or incomplete latches, `restarts` that of restarts of the counter.
    `max_rate_pps` is the highest pulse rate of the converter. `gaps` (G, 2) are the numbers of the first and the last
    latch of each gap. `shift` is a change applied to the counted rate.
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
        """Rows `first` to `last`, both included; gaps and restarts of a part are not known."""
        rows = slice(first, last + 1)
        sequence = self.sequence[rows]
        lost = int(sequence[-1] - sequence[0]) + 1 - len(sequence) if len(sequence) else 0
        return replace(
            self, sequence=sequence, tick=self.tick[rows], positive=self.positive[rows], negative=self.negative[rows],
            host_s=self.host_s[rows], lost=lost, restarts=0, gaps=NO_GAPS,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Positions:
    """Encoder of an axis during one acquisition, a row for each complete latch; all (N,) and raw.

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


class Motion(NamedTuple):
    """Commanded motion of a table during an acquisition, reached before it began.

    It rotated at `rate_dps`, or oscillated by ± `amplitude_deg` at `frequency_hz`; the other is None. During a
    continuous sweep the frequency changed from the first to the last of `sweep_hz` within `sweep_s`.
    """

    device: str
    rate_dps: float | None = None
    amplitude_deg: float | None = None
    frequency_hz: float | None = None
    sweep_hz: Sequence[float] = ()
    sweep_s: float | None = None


@dataclass(frozen=True, slots=True)
class Mount:
    """Mounting of the units, in degrees.

    Raised about the output axis by `angle_deg`, then rolled about the input axis, then clocked about the pendulous one.
    """

    name: str = ""
    angle_deg: float = 0.0
    roll_deg: float = 0.0
    clock_deg: float = 0.0


class Voltages(NamedTuple):
    """Readings of a voltmeter during one acquisition, (n,) and raw: `values_v` at bench times `at_s`, their middles."""

    at_s: Array
    values_v: Array


class Currents(NamedTuple):
    """Readings of an ammeter during one acquisition, (n,): `values_a` at `at_s` of bench time, their mid-times."""

    at_s: Array
    values_a: Array


@dataclass(frozen=True, slots=True)
class Codes:
    """Output samples sent by a unit during one acquisition, a row for each valid sample, duplicates removed; (N,).

    `values` are codes, or decoded values, with the quantisation `step`. `sequence`, `tick`, `host_s`, `lost` and `gaps`
    are as in Counts, by the clock of the unit; `dropped` is the number of repeated or late samples, `invalid` that of
    samples that the unit marked invalid. More than `stuck_after` equal samples in a row are incompatible with its
    noise; None if not stated. With `averaged` a sample is the mean over the time from the one before, else the output
    at its tick. `restarts` is the number of restarts of the unit, recognised by lower numbers.
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
        """Rows from `first` on; lost samples of a part are not known."""
        rows = slice(first, None)
        return replace(
            self, sequence=self.sequence[rows], tick=self.tick[rows], values=self.values[rows],
            host_s=self.host_s[rows], lost=0, dropped=0, invalid=0, gaps=NO_GAPS,
        )  # fmt: skip


class Output(NamedTuple):
    """A mean output in its unit; `problems` make it unusable.

    `single_u` is its standard uncertainty by itself: the resolution of the count, or the scatter of the voltmeter's
    readings or of the samples. `quantisation_u` is the quantisation uncertainty of a mean of codes.
    """

    value: float
    single_u: float
    problems: tuple[str, ...]
    quantisation_u: float = 0.0


class ClockReading(NamedTuple):
    """What the clock of a device showed at a time of the host's: `device_s`, which goes back to 0 at `wraps_s`."""

    device_s: float
    wraps_s: float
    host_s: float


class Window(NamedTuple):
    """Mean of one channel, for methods that need no more.

    The mean output, such as a net rate in pulse/s, over `span_s` of the clock of the counter, which is `host_span_s` of
    the host's clock if the table turned; at rest it is not converted. For samples both are by the host's clock.
    `problems` make it unusable. `single_u` and `quantisation_u` are those of an Output. `clock` is that of the counter
    at its first latch, without the scatter of single arrivals.
    """

    mean: float
    span_s: float
    host_span_s: float
    problems: tuple[str, ...]
    single_u: float = 0.0
    quantisation_u: float = 0.0
    clock: ClockReading | None = None


class Turned(NamedTuple):
    """A rotation during an acquisition: axis, commanded rate, and its angle at bench times."""

    axis: str
    command_dps: float
    from_s: float
    from_deg: float
    to_s: float
    to_deg: float


@dataclass(frozen=True, slots=True)
class Acquisition:
    """One acquisition: its step, its group of steps, its data, and the state of the bench meanwhile.

    `angles_deg` is the read-back of each axis of the table, outer first, `mount` the mounting of the units. `set_c` is
    the chamber's set point at the end, `set_from_c` at the beginning, not-a-number before the first ramp. `counts` by
    channel, `voltages` by voltmeter, `currents` by ammeter, `codes` by channel of the telemetry. `temperatures_c` are
    the values of each named reading between `begin_s` and `end_s` of bench time, taken at `temperatures_at_s`. If
    `input` is "source" the converter is fed by a current source, of an inertial unit that of its channel
    `input_channel`; `sources_a` are the currents of those that are on, by
    their roles, corrected by their certificates, `sources_set_a` their uncorrected read-backs. An acquisition until
    stability is evaluated over its last `over_s`; `stable` are the places of the units that were stable. `turned` is a
    rotation over whole turns meanwhile. For methods that need only means, `windows` replace `counts`, so that a long
    run is not in memory all at once. `positions` are those of the encoders that a counter latches, by the devices that
    drive the axes; `motion` is None if no table moved. `on_since_s` are the supplies that are on, by their roles, each
    with the bench times between which it was switched on. `missed` are lost latches and samples, by device and channel.
    `came_from` is the side, "below" or "above", from which each axis last reached its angle, where known; `stand`
    counts the preceding moves of all axes: it is the same for acquisitions without a move between them. `stretch`
    counts the preceding interruptions of the run.
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
    input_channel: str = ""
    sources_a: Mapping[str, float] = field(default_factory=dict)
    sources_set_a: Mapping[str, float] = field(default_factory=dict)
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
        """Angle of the head, which is the outermost axis; 0 without one."""
        return next(iter(self.angles_deg.values()), 0.0)
