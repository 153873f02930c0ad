"""Samples of an acquisition on a rate table: output of a unit and encoder of the table on one clock.

Pulses are latched with the encoder by the counter, and so are the ends of the samples that a unit sends if its
telemetry has the encoder. Readings of a voltmeter, or samples sent without the encoder, have only the host's clock in
common with it: that suffices for means over turns, to some ms, but not for a phase.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from bench.methods.rate_table.reduction.samples import TableSamples, summed_up
from bench.methods.rate_table.reduction.sampling import averaged_over, instantaneous
from bench.methods.rate_table.reduction.temperatures import MeanTemperature
from bench.methods.rate_table.reduction.turning_readings import TurningReadings
from bench.metrology.acquisition import Acquisition, Array, Codes, Counts, Integers, Positions, Voltages
from bench.metrology.outputs import NO_CODES, mean_output, measured
from bench.metrology.pulse_counts import mean_rate, since_first
from bench.metrology.run_data import UnitUnderTest
from bench.metrology.sampled_codes import on_the_host_clock, sampled_at_s

LEAST_LATCHES = 20
LEAST_READINGS = 3  # minimum number for a scatter of the mean
NOTHING: Integers = np.empty(0, np.int64)


def table_samples(acquisition: Acquisition, unit: UnitUnderTest) -> TableSamples:
    """Samples of a unit in one acquisition.

    Problems are those of `mean_output` except dead_band, which an oscillation passes through, no_encoder, and
    no_common_clock for an oscillation whose output has no clock in common with the encoder.
    """
    if unit.is_counted:
        return _counted(acquisition, unit)
    encoder, problems = _encoder(acquisition)
    if unit.telemetry is not None and encoder.channel == unit.telemetry:
        return _sent(acquisition, unit, encoder, problems)
    return _beside(acquisition, unit, encoder, problems)


def encoder_of(acquisition: Acquisition) -> Positions | None:
    """Encoder of the axis that moved, or at rest the first one; None if it was not latched."""
    motion = acquisition.motion
    return acquisition.positions.get(motion.device if motion else next(iter(acquisition.positions), ""))


def _encoder(acquisition: Acquisition) -> tuple[Positions, list[str]]:
    """Encoder of the axis that moved; one without readings, and the problem, if there is none."""
    if (encoder := encoder_of(acquisition)) is not None:
        return encoder, []
    return Positions(NOTHING, NOTHING, NOTHING, 32, 32, 1.0, 0.0), ["no_encoder"]


def _counted(acquisition: Acquisition, unit: UnitUnderTest) -> TableSamples:
    counts = acquisition.counts[unit.channel]
    encoder, missing = _encoder(acquisition)
    problems = [problem for problem in mean_rate(counts).problems if problem != "dead_band"] + missing
    latch, of_counts, of_encoder = np.intersect1d(
        counts.sequence, encoder.sequence, assume_unique=True, return_indices=True
    )
    if len(latch) < LEAST_LATCHES and "too_few_latches" not in problems:
        problems.append("too_few_latches")
    positive = since_first(counts.positive[of_counts], counts.counter_bits)
    negative = since_first(counts.negative[of_counts], counts.counter_bits)
    time_s = np.asarray(since_first(counts.tick[of_counts], counts.tick_bits) * counts.tick_period_s, np.float64)
    total = counts.shift.times * (positive - negative) + counts.shift.more * time_s
    return _samples(acquisition, unit, encoder, (latch, of_encoder, time_s), total, problems)


def _sent(acquisition: Acquisition, unit: UnitUnderTest, encoder: Positions, problems: list[str]) -> TableSamples:
    """Samples sent by a unit with the encoder latched at their ends."""
    codes, mean = acquisition.codes.get(encoder.channel, NO_CODES), mean_output(acquisition, unit)
    latch, of_codes, of_encoder = np.intersect1d(
        codes.sequence, encoder.sequence, assume_unique=True, return_indices=True
    )
    problems = [*mean.problems, *problems]
    if len(latch) < LEAST_LATCHES:
        problems = list(dict.fromkeys([*problems, "too_few_codes"]))
    time_s = np.asarray(since_first(codes.tick[of_codes], codes.tick_bits) * codes.tick_period_s, np.float64)
    total = summed_up(codes.values[of_codes], latch, time_s)
    sampled = averaged_over(_interval_s(time_s, latch)) if codes.averaged else instantaneous
    return _samples(
        acquisition, unit, encoder, (latch, of_encoder, time_s), total, problems,
        step_of_codes=codes.step, sampled=sampled, hidden_u=mean.quantisation_u,
    )  # fmt: skip


def _beside(acquisition: Acquisition, unit: UnitUnderTest, encoder: Positions, problems: list[str]) -> TableSamples:
    """Readings timed by the host: the output is interpolated linearly between them, over the encoder's clock."""
    found, mean, motion = _readings(acquisition, unit), mean_output(acquisition, unit), acquisition.motion
    problems = [*mean.problems, *problems]
    if motion is not None and motion.frequency_hz is not None:
        problems.append("no_common_clock")
    clock_s = np.asarray(since_first(encoder.tick, encoder.tick_bits) * encoder.tick_period_s, np.float64)
    at_s, values = (found.at_s, found.values_v) if isinstance(found, Voltages) else (sampled_at_s(found), found.values)
    rows, total, readings = NOTHING, np.empty(0), None
    if len(at_s) > 1 and len(clock_s) >= LEAST_LATCHES:
        host_s = on_the_host_clock(clock_s, encoder.host_s)
        read_s = clock_s[0] + (at_s - host_s[0]) * (clock_s[-1] - clock_s[0]) / (host_s[-1] - host_s[0])
        rows = np.flatnonzero((clock_s >= read_s[0]) & (clock_s <= read_s[-1]))
        area = np.concatenate(([0.0], np.cumsum(np.diff(read_s) * (values[1:] + values[:-1]) / 2)))
        total = np.interp(clock_s[rows], read_s, area)
        readings = _turning(read_s, values, clock_s, _turned_deg(encoder))
    few = "too_few_voltages" if isinstance(found, Voltages) else "too_few_codes"
    if (readings is None or len(readings.output) < LEAST_READINGS) and few not in problems:
        problems.append(few)
    if len(rows) < LEAST_LATCHES:
        problems.append("too_few_latches")
    latches = encoder.sequence[rows], rows, clock_s[rows]
    return _samples(
        acquisition, unit, encoder, latches, total, problems, hidden_u=mean.quantisation_u, readings=readings
    )


def _turning(read_s: Array, values: Array, clock_s: Array, angle_deg: Array) -> TurningReadings:
    """Readings within the encoder's latches, at times of its clock, with the motion of the table around them."""
    reach_s = float(np.median(np.diff(read_s))) / 4
    seen = (read_s - reach_s >= clock_s[0]) & (read_s + reach_s <= clock_s[-1])
    before_deg, at_deg, after_deg = (
        np.interp(read_s[seen] + away_s, clock_s, angle_deg) for away_s in (-reach_s, 0.0, reach_s)
    )
    return TurningReadings(values[seen], at_deg, (after_deg - before_deg) / (2 * reach_s))


def _readings(acquisition: Acquisition, unit: UnitUnderTest) -> Voltages | Codes:
    found = measured(acquisition, unit)
    if isinstance(found, Counts):
        raise TypeError(f"the unit in place {unit.place} is counted")
    return found


def _samples(
    acquisition: Acquisition, unit: UnitUnderTest, encoder: Positions, latches: tuple[Integers, Integers, Array],
    total: Array | Integers, problems: list[str], **more: Any,
) -> TableSamples:  # fmt: skip
    """Samples at `latches`: their numbers, their rows of the encoder, and their times."""
    latch, of_encoder, time_s = latches
    return TableSamples(
        step=acquisition.step,
        temperature=MeanTemperature.of(acquisition.temperatures_c[unit.temperature]),
        time_s=time_s - time_s[:1],
        total=np.asarray(total - total[:1], np.float64),
        angle_deg=_turned_deg(encoder, of_encoder),
        latch=latch,
        interval_s=_interval_s(time_s, latch),
        resolution_deg=encoder.resolution_deg,
        problems=tuple(problems),
        **more,
    )


def _turned_deg(encoder: Positions, rows: Integers | slice = slice(None)) -> Array:
    """Angle of the table at rows of an encoder, relative to the first."""
    steps = since_first(encoder.position[rows], encoder.position_bits, either_way=True)
    return np.asarray(steps * encoder.resolution_deg, np.float64)


def _interval_s(time_s: Array, latch: Integers) -> float:
    return float(np.median(np.diff(time_s) / np.diff(latch))) if len(latch) > 1 else np.nan
