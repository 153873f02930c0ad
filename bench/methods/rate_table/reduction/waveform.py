"""Course of one oscillation: motion by the encoder and output of the sensor, sample by sample (equations 5.3, 5.6).

Both are means over the same intervals: one sample of a gyro, two of an accelerometer, whose reference is that of two
samples.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from bench.methods.rate_table.reduction.lever_arm import OnArm
from bench.methods.rate_table.reduction.response_points import FrequencyResponse, SweepPoint, Waveform
from bench.methods.rate_table.reduction.samples import TableSamples
from bench.methods.rate_table.reduction.sampling import instantaneous
from bench.methods.rate_table.reduction.sine_fit import fit_sine
from bench.methods.rate_table.reduction.two_sample import velocity_increments
from bench.metrology.least_squares import Array, NotDetermined

EVEN = 1e-6  # relative difference of two successive intervals; a lost latch makes it 1


def shown_point(
    points: Sequence[SweepPoint], found: FrequencyResponse, asked_hz: float | None, constant: Collection[float]
) -> SweepPoint | None:
    """Return the point at a frequency of `constant` nearest to `asked_hz`; default: bandwidth, or the highest."""
    held = {point.frequency_hz for point in found.points}
    at_hz = asked_hz or found.bandwidth.frequency_hz or max(held, default=0.0)
    return min(
        (point for point in points if point.nominal_hz in held and point.nominal_hz in constant),
        key=lambda point: abs(point.nominal_hz - at_hz), default=None,
    )  # fmt: skip


def of_gyro(samples: TableSamples, point: SweepPoint, per_pulse: float) -> Waveform | None:
    """Mean rates over each sample, in °/s."""
    taken_s = np.diff(samples.time_s)
    middle_s = samples.time_s[1:] - taken_s / 2
    rates = np.diff(samples.angle_deg) / taken_s, np.diff(samples.total) * per_pulse / taken_s
    return _waveform(point, middle_s, *rates, np.diff(samples.latch) == 1, "°/s", 1.0)


def of_accelerometer(samples: TableSamples, point: SweepPoint, per_pulse: float, on: OnArm) -> Waveform | None:
    """Mean accelerations over two successive samples each, in m/s²."""
    taken_s, angle_rad = np.diff(samples.time_s), np.radians(np.diff(samples.angle_deg))
    both_s = taken_s[:-1] + taken_s[1:]
    increments, _ = velocity_increments(
        angle_rad[:-1], angle_rad[1:], total_s=float(np.median(both_s)), x_m=on.arm.x_m, y_m=on.arm.y_m
    )
    sensed = (samples.total[2:] - samples.total[:-2]) * per_pulse * on.local_g_mps2
    even = np.abs(taken_s[1:] / taken_s[:-1] - 1) < EVEN
    half = np.pi * point.swing.frequency_hz * float(np.median(both_s)) / 2
    excess = float(np.tan(half) / half)  # of the tangential part of the reference on a sine
    if samples.sampled is instantaneous:  # and of a sum of two such samples over a mean
        excess *= float(np.sinc(half / np.pi))
    return _waveform(point, samples.time_s[1:-1], increments / both_s, sensed / both_s, even, "m/s²", excess)


def _waveform(
    point: SweepPoint, time_s: Array, reference: Array, output: Array, kept: NDArray[np.bool_], unit: str, excess: float
) -> Waveform | None:  # fmt: skip
    """Return the course without the offsets and slow changes that a fit of both finds; None if it finds no sine."""
    time_s, reference, output = time_s[kept], reference[kept], output[kept]
    frequency_hz = point.swing.frequency_hz
    try:
        sines = [fit_sine(time_s, values, frequency_hz, harmonics=2).phasors[0] for values in (reference, output)]
    except NotDetermined:
        return None
    if not abs(sines[0]):
        return None
    return Waveform(
        frequency_hz=point.nominal_hz, time_s=time_s, reference=reference - np.mean(reference),
        output=output - np.mean(output), unit=unit, gain=float(abs(sines[1] / sines[0]) * excess),
    )  # fmt: skip
