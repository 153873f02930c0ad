"""Frequency response of an accelerometer on an oscillating table, through its own lever arms (equations 5.5).

At the position (x, y) on the table an input axis along X senses -ω² x - dω/dt y: y follows from the sine at the
frequency of the oscillation, x from that at twice the frequency.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.methods.rate_table.reduction.blocks import Block, TableRecord, cut_into_blocks
from bench.methods.rate_table.reduction.response_points import (
    FrequencyResponse,
    Remarks,
    SweepPoint,
    Swing,
    at_frequency,
    fit_output,
    fit_table,
    frequency_response,
    swing_of_angle,
)
from bench.methods.rate_table.reduction.sampling import Factors, averaging
from bench.methods.rate_table.reduction.sine_fit import resolved
from bench.metrology.least_squares import Array
from bench.metrology.results.flag import INVALID, Flag

RAD_PER_DEG = np.pi / 180
SHORT_ARM_M = 0.005


@dataclass(frozen=True, slots=True)
class LeverArm:
    """Position of the accelerometer in the frame of the table, its input axis along X, with standard uncertainties.

    `swing` is the oscillation of the table meanwhile; `u_sensed_m` is the contribution of the sensor's readings.
    """

    x_m: float
    y_m: float
    u_x_m: float
    u_y_m: float
    swing: Swing
    u_sensed_m: tuple[float, float]


@dataclass(frozen=True, slots=True)
class OnArm:
    """Arm of an accelerometer, and the local gravity by which its output in g becomes m/s²."""

    arm: LeverArm
    local_g_mps2: float


@dataclass(frozen=True, slots=True)
class AccelerometerSweep:
    """Meaning of the samples of a sweep.

    Row k of the record holds the increment of the table angle in rad and the mean acceleration in g over the
    `interval_s` before its time; without that, the table angle in degrees and the acceleration with the sampling
    response of its block. The arms are determined at `lever_hz`.
    """

    local_g_mps2: float
    interval_s: float | None
    lever_hz: float
    settle_s: float = 0.0


def accelerometer_response(record: TableRecord, sweep: AccelerometerSweep) -> tuple[LeverArm | None, FrequencyResponse]:
    """Arms, None if not determined at the lever frequency, and the response relative to that at the lever frequency.

    Without arms, or with both shorter than 5 mm, there are no points and the flag is `invalid`. If only y is that short
    the flag is `lever_arm_short`: the uncertainties of the gains include it.
    """
    remarks, points = Remarks(), []
    blocks = cut_into_blocks(record, remarks.excluded, settle_s=sweep.settle_s)
    levers = [nominal_hz for nominal_hz in blocks if np.isclose(nominal_hz, sweep.lever_hz, rtol=1e-6)]
    arm = lever_arm(blocks.pop(levers[0]), sweep, remarks) if levers else None
    if not arm:
        remarks.flags.append(at_frequency(INVALID, sweep.lever_hz))
    elif abs(arm.y_m) < SHORT_ARM_M:
        remarks.flags.append(Flag("lever_arm_short"))
    if not arm or max(abs(arm.x_m), abs(arm.y_m)) < SHORT_ARM_M:
        return arm, frequency_response([], remarks)
    for nominal_hz, block in blocks.items():
        point = accelerometer_point(block, nominal_hz, arm, sweep, remarks)
        if point:
            points.append(point)
        else:
            remarks.flags.append(at_frequency(INVALID, nominal_hz))
    return arm, frequency_response(points, remarks)


def lever_arm(block: Block, sweep: AccelerometerSweep, remarks: Remarks) -> LeverArm | None:
    """Arms from a block at the lever frequency, None if not determined.

    They are magnitudes with the sign of the real part: a small lag of the channel rotates their phasors but does not
    shorten them.
    """
    swing = _swing(block, sweep.lever_hz, sweep, remarks)
    sensed = fit_output(block, swing, remarks, harmonics=2) if swing else None
    if not swing or not sensed:
        return None
    f_hz, rate = swing.frequency_hz, swing.rate * RAD_PER_DEG
    kept = _kept(np.array([f_hz, 2 * f_hz]), sweep, block)
    at_f, at_2f = sensed.phasors / kept * sweep.local_g_mps2
    u_at_f, u_at_2f = sensed.u / np.abs(kept) * sweep.local_g_mps2
    u_sensed_m = float(2 * u_at_2f / abs(rate) ** 2), float(u_at_f / (2 * np.pi * f_hz * abs(rate)))
    y, x = -at_f / (2j * np.pi * f_hz * rate), -2 * at_2f / rate**2
    return LeverArm(
        x_m=float(np.copysign(abs(x), x.real)),
        y_m=float(np.copysign(abs(y), y.real)),
        u_x_m=float(np.hypot(u_sensed_m[0], 2 * abs(x) * swing.u_relative)),
        u_y_m=float(np.hypot(u_sensed_m[1], abs(y) * swing.u_relative)),
        swing=swing,
        u_sensed_m=u_sensed_m,
    )


def accelerometer_point(
    block: Block, nominal_hz: float, arm: LeverArm, sweep: AccelerometerSweep, remarks: Remarks
) -> SweepPoint | None:
    """Response at one frequency relative to that at the lever frequency, None if the block does not determine it."""
    swing = _swing(block, nominal_hz, sweep, remarks)
    if not swing:
        return None
    two = resolved(block.time_s, 2 * swing.frequency_hz)
    sensed = fit_output(block, swing, remarks, harmonics=2 if two else 1)
    if not sensed:
        return None
    kept = complex(_kept(np.array([swing.frequency_hz]), sweep, block)[0])
    expected_g = -2j * np.pi * swing.frequency_hz * swing.rate * RAD_PER_DEG * arm.y_m / sweep.local_g_mps2 * kept
    response = complex(sensed.phasors[0] / expected_g)
    u_relative = np.hypot(swing.u_relative, arm.u_y_m / abs(arm.y_m))
    u_output, u_across = (float(u[0] / abs(expected_g)) for u in (sensed.u, sensed.u_across))
    u_gain = float(np.hypot(u_output, abs(response) * u_relative))
    return SweepPoint(nominal_hz, swing, response, u_gain, u_output, u_across)


def _swing(block: Block, nominal_hz: float, sweep: AccelerometerSweep, remarks: Remarks) -> Swing | None:
    if sweep.interval_s is None:
        return swing_of_angle(block, nominal_hz, remarks)
    return swing_of_increments(block, nominal_hz, sweep.interval_s, remarks)


def _kept(frequency_hz: Array, sweep: AccelerometerSweep, block: Block) -> Factors:
    """Sampling response of the record for the acceleration at each frequency (m,)."""
    return block.kept(frequency_hz) if sweep.interval_s is None else averaging(frequency_hz, sweep.interval_s)


def swing_of_increments(block: Block, nominal_hz: float, interval_s: float, remarks: Remarks) -> Swing | None:
    """Oscillation of a table from increments of its angle, in rad, over the `interval_s` before each time.

    An increment / its interval is the mean rate, like the mean acceleration of an accelerometer sample.
    """
    fit = fit_table(block, nominal_hz, remarks)
    if not fit:
        return None
    mean_rate = complex(fit.phasors[0]) / interval_s / RAD_PER_DEG
    rate = mean_rate / complex(averaging(np.array([fit.frequency_hz]), interval_s)[0])
    # An increment is a difference of two readings; periodic errors are those of the readings.
    reading = abs(fit.phasors[0]) / (2 * np.sin(np.pi * fit.frequency_hz * interval_s))
    u_periodic = fit.u_periodic / np.sqrt(2) / reading
    u_random = float(fit.u_random[0]) / abs(fit.phasors[0])
    u_relative = float(np.hypot(u_random, u_periodic))
    return Swing(fit.frequency_hz, float(block.time_s[0]), rate, u_relative, bool(u_periodic > u_random))
