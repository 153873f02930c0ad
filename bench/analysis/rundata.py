"""What a method gets of a run: counts, angles and temperatures of the acquisitions, and what is known of the bench."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from bench.analysis.compensation import Compensation
from bench.analysis.finding import Subject

Integers = NDArray[np.int64]
Array = NDArray[np.float64]
Vector = tuple[float, float, float]


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
class Positions:
    """The encoder of an axis during one acquisition, a row for each latch that came whole; all (N,) and raw.

    `sequence` numbers the latches as those of the counts of the same counter. `position` is in counts of
    `resolution_deg`, wraps at 2**position_bits and may be signed.
    """

    sequence: Integers
    tick: Integers
    position: Integers
    tick_bits: int
    position_bits: int
    tick_period_s: float
    resolution_deg: float


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
class Codes:
    """What a unit sent of its own output during one acquisition, a row for each sample that came once and valid; (N,).

    `values` are codes, or what they are decoded to, in steps of `step`. `sequence`, `tick`, `host_s` and `lost` are as
    in Counts, by the clock of the unit; `dropped` came twice or late, `invalid` the unit marked itself. `stuck_after`
    samples with one value are more than its noise lets be; None where nobody says.
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

    def part(self, first: int) -> Codes:
        """From row `first` on; what did not come is not known of a part."""
        rows = slice(first, None)
        return replace(
            self, sequence=self.sequence[rows], tick=self.tick[rows], values=self.values[rows],
            host_s=self.host_s[rows], lost=0, dropped=0, invalid=0,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Window:
    """What is kept of the counts of one channel where only their mean is wanted.

    The net rate in pulse/s over `span_s` of device time, which the host's clock took for `host_span_s`; `problems` make
    it unusable.
    """

    net_pps: float
    span_s: float
    host_span_s: float
    problems: tuple[str, ...]


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
    channel, `voltages` by voltmeter, `codes` by channel of the telemetry; `temperatures_c` the values of each named
    reading between `begin_s` and `end_s` of bench time, taken at `temperatures_at_s`. Where `input` is "source" the
    converter is fed by a current source; `sources_a` is what those that are on give, by their roles, `sources_told_a`
    what they were read back to give where a certificate corrects that. One that was to become stable is read over its
    last `over_s`; `stable` are the places of the units that did. `turned` is a rotation over whole turns meanwhile.
    Where only means are wanted `windows` stand in place of `counts`, so that a long run is not in memory all at once.
    `positions` are those of the encoders that a counter latches, by the devices that drive the axes, `motion` is None
    where no table turned or swung. `on_since_s` are the supplies that are on, by their roles, each with the bench times
    between which it was put on.
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
    over_s: float | None = None
    stable: frozenset[str] | None = None
    positions: Mapping[str, Positions] = field(default_factory=dict)
    motion: Motion | None = None
    on_since_s: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    codes: Mapping[str, Codes] = field(default_factory=dict)

    @property
    def angle_deg(self) -> float:
        """The angle of the head, which is the outermost axis; 0 without one."""
        return next(iter(self.angles_deg.values()), 0.0)


@dataclass(frozen=True, slots=True)
class ReleasedCalibration:
    """How the output of each channel of a unit becomes a value, by names; 1 g in it is `gravity_mps2`, NaN if untold.

    `gravity_u_mps2` is its standard uncertainty.
    """

    channels: Mapping[str, Compensation]
    gravity_mps2: float = math.nan
    gravity_u_mps2: float = 0.0


@dataclass(frozen=True, slots=True)
class UnitUnderTest:
    """One unit in its place; its output are the pulses on a `channel`, or the volts that a `voltmeter` reads.

    Or it is what the unit sends itself on a channel of the `telemetry`, in `sent_unit`. `until_s` is the bench time at
    which it was dropped from the run. `nominal_per_g` is what its output is made to change by for 1 g, in
    `output_unit`; None where nobody says. `converter` is the reading of the thermometer at its converter and `source`
    the current source that can feed that, "" for none; `scale_a_per_g` is its nominal K1. An inertial unit has
    `channels` of the counter, by acc_x to gyro_z, and a thermometer at its gyros. `arm_m` is where the bench file says
    that it is from the axis that turns it, with its standard uncertainty. `supply` is what powers it, "" for none;
    `released` is the calibration that was given to the run for it.
    """

    place: str
    serial: str
    channel: str
    mount_angle_deg: float
    temperature: str
    until_s: float = math.inf
    voltmeter: str | None = None
    nominal_per_g: float | None = None
    channels: Mapping[str, str] = field(default_factory=dict)
    gyro_temperature: str = ""
    converter: str = ""
    source: str = ""
    scale_a_per_g: float = math.nan
    arm_m: Vector | None = None
    arm_u_m: float = 0.0
    supply: str = ""
    released: ReleasedCalibration | None = None
    telemetry: str | None = None
    sent_unit: str = "code"

    @property
    def measured_by(self) -> str:
        """The channel of the counter or of the telemetry, or the voltmeter."""
        return self.telemetry or self.voltmeter or self.channel

    @property
    def is_counted(self) -> bool:
        """Whether a counter counts its pulses."""
        return self.voltmeter is None and self.telemetry is None

    @property
    def output_unit(self) -> str:
        """What its output is in."""
        if self.telemetry is not None:
            return self.sent_unit
        return "pulse/s" if self.voltmeter is None else "V"


@dataclass(frozen=True, slots=True)
class AxisRecord:
    """An axis of the table: where its positive end points while all angles are 0 (east, north, up), and its errors.

    `harmonics_u_deg` are those of the cosine and of the sine amplitude of harmonics 1, 2, … of its error,
    `wobble_u_deg` those of how far it tilts to and fro once a turn.
    """

    points: Vector = (0.0, -1.0, 0.0)
    zero_u_deg: float = 0.0
    harmonics_u_deg: tuple[float, ...] = ()
    repeatability_u_deg: float = 0.0
    wobble_u_deg: float = 0.0


@dataclass(frozen=True, slots=True)
class SourceRecord:
    """What a certificate says of a current source, as standard uncertainties: gain (1), offset (A), drift (1/s)."""

    gain_u: float
    offset_u_a: float
    drift_u_per_s: float


@dataclass(frozen=True, slots=True)
class BenchRecord:
    """What certificates and surveys say of the bench; every `u` is a standard uncertainty.

    `axes` are those of the table, outer first; `x` and `z` are where those of the fixture point while all angles are 0.
    `level_deg` tilts the whole table about south. `thermometers_u` gives offset (°C) and gain (on the temperature in
    °C) by the name of the reading, `voltmeters_u` gain (of the reading) and offset (V) by voltmeter, `sources` the
    current sources that have a certificate, by their roles. `orthogonality_u_deg` is of each axis against the one that
    carries it, in two directions. `encoder_skew_u_s` is that of the time between an encoder's latch and the pulses'.
    """

    gravity_mps2: float
    gravity_u_mps2: float
    axes: Mapping[str, AxisRecord]
    x: Vector
    z: Vector
    level_deg: float
    level_u_deg: float
    time_base_u: float
    thermometers_u: Mapping[str, tuple[float, float]]
    voltmeters_u: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    latitude_deg: float = 0.0
    azimuth_u_deg: float = 0.0
    orthogonality_u_deg: float = 0.0
    sources: Mapping[str, SourceRecord] = field(default_factory=dict)
    encoder_skew_u_s: float = 0.0

    @property
    def head(self) -> AxisRecord:
        """The head, which is the outermost axis; one without errors when there is none."""
        return next(iter(self.axes.values()), AxisRecord())


@dataclass(frozen=True, slots=True)
class RunData:
    """The acquisitions under one label, in the order of the run, and what is needed to reduce them.

    `closure` are those that tell what has changed over the run.
    """

    label: str
    units: tuple[UnitUnderTest, ...]
    acquisitions: tuple[Acquisition, ...]
    bench: BenchRecord
    closure: tuple[Acquisition, ...] = ()

    def subject(self, unit: UnitUnderTest) -> Subject:
        """Whom findings of a unit are of."""
        return Subject(self.label, unit.place, unit.serial)

    def groups(self) -> dict[str, list[Acquisition]]:
        """The acquisitions by the groups of steps that they belong to, both in the order of the run."""
        found: dict[str, list[Acquisition]] = {}
        for acquisition in self.acquisitions:
            found.setdefault(acquisition.group, []).append(acquisition)
        return found

    def by_length(self) -> Iterator[RunData]:
        """The units that were in to the end together, then each that was dropped with what had ended before."""
        stayed = tuple(unit for unit in self.units if math.isinf(unit.until_s))
        if stayed:
            yield replace(self, units=stayed)
        for unit in self.units:
            if unit not in stayed:
                before, closure = (
                    tuple(each for each in acquired if each.end_s <= unit.until_s)
                    for acquired in (self.acquisitions, self.closure)
                )
                yield replace(self, units=(unit,), acquisitions=before, closure=closure)
