"""Gain, phase and bandwidth of a sensor on a table that oscillates at one frequency after the other (equations 5.3).

The reference is the encoder, not the command: the amplitude of a table droops.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import compress

import numpy as np

from bench.methods.rate_table.reduction.blocks import Block, TableRecord, cut_into_blocks
from bench.methods.rate_table.reduction.sine_fit import SineFit, find_frequency, fit_sine
from bench.metrology.least_squares import Array, NotDetermined
from bench.metrology.results.flag import INVALID, Flag

HALF_POWER = 1 / np.sqrt(2)
DROOP = 0.5  # of the rate amplitude at the lowest frequency; below it the table did not oscillate
COARSE_STEP_DEG = 120.0
SIGNIFICANCE = 5.0
OFF_FREQUENCY = 1e-3
TURN_DEG = 360.0


@dataclass(frozen=True, slots=True)
class Swing:
    """Oscillation of the table in one block: `rate` is the phasor of its rate in deg/s at the measured frequency.

    `few_phases`: most of its uncertainty is from encoder errors that repeat in every period. `drooped` is known of a
    sweep, whose amplitude is an angle; None for a frequency that is compared with the others.
    """

    frequency_hz: float
    origin_s: float
    rate: complex
    u_relative: float
    few_phases: bool
    drooped: bool | None = None


@dataclass(frozen=True, slots=True)
class SweepPoint:
    """Response of the sensor, a complex number, at one frequency; `nominal_hz` is that of the record.

    `u_gain` is the uncertainty of its gain, `u_output` the contribution of the sensor's readings to it, and
    `u_across_output` their contribution at right angles to the response, that is, to its phase.
    """

    nominal_hz: float
    swing: Swing
    response: complex
    u_gain: float
    u_output: float = 0.0
    u_across_output: float = 0.0


@dataclass(slots=True)
class Remarks:
    """Diagnostics of an evaluation: flags and notes of the result, samples left out by reason."""

    flags: list[Flag] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    excluded: Counter[str] = field(default_factory=lambda: Counter(missing=0, duplicate=0, outlier=0))


def at_frequency(problem: str, frequency_hz: float) -> Flag:
    """The flag for a problem at one frequency."""
    return Flag(f"{{frequency}} Hz {problem}", values={"frequency": f"{frequency_hz:g}"})


@dataclass(frozen=True, slots=True)
class ResponsePoint:
    """`phase_deg` is negative when the sensor lags, and does not wrap; `table_amplitude_dps` is of the rate."""

    frequency_hz: float
    table_amplitude_dps: float
    gain: float
    gain_db: float
    phase_deg: float
    u_gain: float


@dataclass(frozen=True, slots=True)
class Bandwidth:
    """Frequency at which the gain first falls through 1/√2; `crossings` is the number of such falls.

    Status "ok", "not_reached" or "below_at_start"; the numbers are None unless it is "ok".
    """

    status: str | None
    frequency_hz: float | None = None
    phase_deg: float | None = None
    crossings: int = 0


@dataclass(frozen=True, slots=True)
class Waveform:
    """Motion by the encoder and output of the sensor during one oscillation, arrays (n,) in `unit` about their means.

    `gain` is the ratio of their sines.
    """

    frequency_hz: float
    time_s: Array
    reference: Array
    output: Array
    unit: str
    gain: float


@dataclass(frozen=True, slots=True)
class FrequencyResponse:
    """Points by frequency, with flags, notes and bandwidth; the waveform of one of them where it can be shown.

    Flags: `<f> Hz invalid`, `<f> Hz droop` for a frequency that is left out, `<f> Hz phase_step` where the phase
    changed too much since the point before to be unwrapped with certainty, `invalid` when there is no point at all.
    """

    points: tuple[ResponsePoint, ...]
    bandwidth: Bandwidth
    flags: tuple[Flag, ...]
    notes: tuple[str, ...]
    excluded: dict[str, int]
    waveform: Waveform | None = None


def gyro_response(record: TableRecord, *, settle_s: float = 0.0, to_lowest: bool = False) -> FrequencyResponse:
    """Response of a gyro: `record.block` is the frequency, `table` the angle in degrees, `output` in deg/s.

    The angle may restart each turn. Gains are absolute or, with `to_lowest`, relative to that at the lowest frequency.
    """
    remarks, points = Remarks(), []
    for nominal_hz, block in cut_into_blocks(record, remarks.excluded, settle_s=settle_s).items():
        swung = replace(block, table=np.unwrap(block.table, period=TURN_DEG))
        point = gyro_point(swung, nominal_hz, remarks)
        if point:
            points.append(point)
        else:
            remarks.flags.append(at_frequency(INVALID, nominal_hz))
    return frequency_response(points, remarks, to_lowest=to_lowest)


def gyro_point(block: Block, nominal_hz: float, remarks: Remarks) -> SweepPoint | None:
    """Response at one frequency, None if the block does not determine it; angles in degrees, outputs in deg/s."""
    swing = swing_of_angle(block, nominal_hz, remarks)
    gyro = fit_output(block, swing, remarks) if swing else None
    if not swing or not gyro:
        return None
    kept = complex(block.kept(np.array([swing.frequency_hz]))[0])
    response = complex(gyro.phasors[0] / kept / swing.rate)
    u_output, u_across = (float(u[0] / abs(kept) / abs(swing.rate)) for u in (gyro.u, gyro.u_across))
    u_gain = float(np.hypot(u_output, abs(response) * swing.u_relative))
    return SweepPoint(nominal_hz, swing, response, u_gain, u_output, u_across)


def swing_of_angle(block: Block, nominal_hz: float, remarks: Remarks) -> Swing | None:
    """Oscillation of a table from angle readings in degrees; None if the block does not determine it."""
    fit = fit_table(block, nominal_hz, remarks)
    if not fit:
        return None
    angle, u = complex(fit.phasors[0]), float(fit.u[0])
    rate = 2j * np.pi * fit.frequency_hz * angle
    return Swing(fit.frequency_hz, float(block.time_s[0]), rate, u / abs(angle), fit.few_phases)


def fit_table(block: Block, nominal_hz: float, remarks: Remarks) -> SineFit | None:
    """Fit the sine of the table, including its frequency; None if it is not found in the noise."""
    if not block.complete or not nominal_hz > 0:
        return None
    try:
        frequency_hz = find_frequency(block.time_s, block.table, nominal_hz)
        fit = fit_sine(
            block.time_s, block.table, frequency_hz, origin_s=float(block.time_s[0]), resolution=block.table_step
        )
    except NotDetermined:
        return None
    remarks.excluded["outlier"] += fit.dropped
    return fit if not fit.excessive and abs(fit.phasors[0]) > SIGNIFICANCE * fit.u_random[0] else None


def fit_output(block: Block, swing: Swing, remarks: Remarks, *, harmonics: int = 1) -> SineFit | None:
    """Fit the sine of the sensor at the frequency of the table, and harmonics; None if there are too many outliers."""
    try:
        fit = fit_sine(
            block.time_s, block.output, swing.frequency_hz, harmonics=harmonics, origin_s=swing.origin_s,
            step=block.step, behind=block.behind, rounding=block.rounding,
        )  # fmt: skip
    except NotDetermined:
        return None
    remarks.excluded["outlier"] += fit.dropped
    return None if fit.excessive else fit


def frequency_response(points: Sequence[SweepPoint], remarks: Remarks, *, to_lowest: bool = False) -> FrequencyResponse:
    """Gains, phases and bandwidth of `points`, which are in order of frequency."""
    points = _without_droop(points, remarks)
    if not points:
        remarks.flags.append(Flag(INVALID))
    gain = np.array([abs(point.response) for point in points])
    u_gain = np.array([point.u_gain for point in points])
    if to_lowest and points:
        gain, u_gain = _over_the_first(gain, u_gain)
    phase_deg = np.degrees(np.unwrap(np.angle([point.response for point in points])))
    for i in np.flatnonzero(np.abs(np.diff(phase_deg)) > COARSE_STEP_DEG):
        remarks.flags.append(at_frequency("phase_step", points[i + 1].nominal_hz))
    found = bandwidth(np.array([point.swing.frequency_hz for point in points]), gain, phase_deg)
    if found.crossings > 1:
        remarks.notes.append(f"the gain falls through 1/√2 {found.crossings} times; the bandwidth is the first")
    remarks.notes.extend(note for point in points for note in _notes(point))
    rows = zip(points, gain, _decibel(gain), phase_deg, u_gain, strict=True)
    return FrequencyResponse(
        points=tuple(
            ResponsePoint(point.nominal_hz, abs(point.swing.rate), *map(float, numbers)) for point, *numbers in rows
        ),
        bandwidth=found,
        flags=tuple(remarks.flags),
        notes=tuple(remarks.notes),
        excluded=dict(remarks.excluded),
    )


def bandwidth(frequency_hz: Array, gain: Array, phase_deg: Array) -> Bandwidth:
    """First fall of `gain` (n,) through 1/√2 over increasing frequency, by a line in dB over log f."""
    if not len(gain):
        return Bandwidth(None)
    if gain[0] < HALF_POWER:
        return Bandwidth("below_at_start")
    falls = np.flatnonzero((gain[:-1] >= HALF_POWER) & (gain[1:] < HALF_POWER))
    if not len(falls):
        return Bandwidth("not_reached")
    pair = slice(falls[0], falls[0] + 2)
    (above, below), log_f = _decibel(gain[pair]), np.log(frequency_hz[pair])
    share = (above - _decibel(HALF_POWER)) / (above - below)
    log_at, phase_at_deg = (float(ends[0] + share * (ends[1] - ends[0])) for ends in (log_f, phase_deg[pair]))
    return Bandwidth("ok", float(np.exp(log_at)), phase_at_deg, len(falls))


def _without_droop(points: Sequence[SweepPoint], remarks: Remarks) -> list[SweepPoint]:
    compared = [abs(point.swing.rate) for point in points if point.swing.drooped is None]
    held = [
        abs(point.swing.rate) >= DROOP * compared[0] if point.swing.drooped is None else not point.swing.drooped
        for point in points
    ]
    drooped = [point.nominal_hz for point, well in zip(points, held, strict=True) if not well]
    remarks.flags.extend(at_frequency("droop", nominal_hz) for nominal_hz in drooped)
    return list(compress(points, held))


def _over_the_first(gain: Array, u_gain: Array) -> tuple[Array, Array]:
    relative = gain / gain[0]
    u = np.hypot(u_gain, relative * u_gain[0]) / gain[0]
    u[0] = 0.0
    return relative, u


def _decibel(gain: Array | float) -> Array:
    """20 log10 of a gain; -inf for zero."""
    with np.errstate(divide="ignore"):
        return np.asarray(20 * np.log10(gain))


def _notes(point: SweepPoint) -> list[str]:
    notes = []
    if abs(point.swing.frequency_hz / point.nominal_hz - 1) > OFF_FREQUENCY:
        notes.append(f"{point.nominal_hz:g} Hz: the table swung at {point.swing.frequency_hz:.4f} Hz")
    if point.swing.few_phases:
        notes.append(
            f"{point.nominal_hz:g} Hz: the samples repeat few phases of the swing, so that the resolution of the "
            "encoder does not average out; swing at a frequency that does not divide the sample rate"
        )
    return notes
