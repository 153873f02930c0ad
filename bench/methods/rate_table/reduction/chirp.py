"""Response of a sensor during a continuous sweep of the table's frequency (equations 5.9).

The record is divided into windows. In each, the encoder's angle and the output summed up over the same time are fitted
with one sine whose frequency changes at a constant rate, known from when the angle passes its middle, and whose
amplitude and phase may bend; the ratio of both at the middle of the window is the response there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.methods.rate_table.reduction.converter_hysteresis import MOST_TURNS, SETTLED
from bench.methods.rate_table.reduction.count_quantisation import errors_of_counting
from bench.methods.rate_table.reduction.lever_arm import RAD_PER_DEG, OnArm
from bench.methods.rate_table.reduction.response_points import DROOP, SweepPoint, Swing
from bench.methods.rate_table.reduction.samples import TableSamples
from bench.methods.rate_table.reduction.sampling import averaging
from bench.metrology.acquisition import Motion
from bench.metrology.least_squares import Array, NotDetermined, least_squares

PERIODS, LEAST_S, POINTS = 24, 2.0, 60  # least periods and time of a window, and most windows of a sweep
EVEN_RAD = 0.05  # r.m.s. deviation of the phase from a parabola; with more the frequency did not change evenly
AS_COMMANDED = 0.1  # relative deviation of the change of frequency
FINE = 16  # points between two latches at which a reversal is looked for
NOISE_LINES = np.concatenate([np.arange(-12, -4), np.arange(5, 13)])  # of the window, clear of the bends of the sine
BENT = 1.5  # of a constant beside a slope and a curvature, over that of a constant alone: the root of 9/4


@dataclass(frozen=True, slots=True)
class Window:
    """Sine at the middle of a window: phasors of angle in ° and summed output, with standard uncertainties.

    `bend` is the second derivative of its phase, in rad/s², and `stroke` the least change of a counted charge between
    two reversals, in pulses, infinite of samples.
    """

    frequency_hz: float
    middle_s: float
    angle: complex
    output: complex
    u_angle: float
    u_output: float
    bend: float
    stroke: float

    @property
    def nominal_hz(self) -> float:
        """Frequency by which its point is named."""
        return float(f"{self.frequency_hz:.5g}")


def chirp_points(
    windows: Sequence[Window], samples: TableSamples, motion: Motion, per_pulse: float, on: OnArm | None = None
) -> Iterator[SweepPoint]:
    """Responses of a gyro in windows of its samples; with `on`, those of an accelerometer.

    The sum of a gyro's output is an angle, that of an accelerometer's a velocity, -rate · y.
    """
    for window, ratio in zip(windows, _settled(windows), strict=True):
        at_hz = np.array([window.frequency_hz])
        rate = 2j * np.pi * window.frequency_hz  # of 1°, in °/s
        u_relative = window.u_angle / abs(window.angle)
        drooped = abs(window.angle) < DROOP * (motion.amplitude_deg or 0.0)
        swing = Swing(
            window.frequency_hz, window.middle_s, rate * window.angle, u_relative, few_phases=False, drooped=drooped
        )
        expected = 1.0 + 0j  # of 1°
        if on is not None:
            expected = -rate * RAD_PER_DEG * on.arm.y_m / on.local_g_mps2
            u_relative = float(np.hypot(u_relative, on.arm.u_y_m / abs(on.arm.y_m)))
        if samples.sampled is not None:  # a sum takes each sample for the mean over its interval
            expected *= complex((samples.sampled(at_hz) / averaging(at_hz, samples.interval_s))[0])
        response = ratio * per_pulse / expected
        u_output = window.u_output * abs(per_pulse / expected / window.angle)
        u_gain = float(np.hypot(u_output, abs(response) * u_relative))
        yield SweepPoint(window.nominal_hz, swing, complex(response), u_gain, u_output, u_output)


def _settled(windows: Sequence[Window]) -> NDArray[np.complex128]:
    """Ratios (n,) of output to angle at constant frequencies.

    While the phase φ of the input bends, the ratio is H - i φ'' H''/2, with derivatives of H over angular frequency:
    the second term of the convolution of a chirp. H'' is that of a parabola through three neighbours.
    """
    ratio = np.array([window.output / window.angle for window in windows])
    if len(windows) < 3:
        return ratio
    slope = np.diff(ratio) / np.diff(omega := 2 * np.pi * np.array([window.frequency_hz for window in windows]))
    bend = np.pad(2 * np.diff(slope) / (omega[2:] - omega[:-2]), 1, mode="edge")
    return np.asarray(ratio + 0.5j * np.array([window.bend for window in windows]) * bend)


def swept_windows(samples: TableSamples, motion: Motion, play_pulses: float) -> Iterator[Window]:
    """Windows in which the frequency changes as commanded, in order of time."""
    first_hz, last_hz = motion.sweep_hz
    sweep_s = motion.sweep_s or np.nan
    wanted_hz_per_s, least_s = (last_hz - first_hz) / sweep_s, max(LEAST_S, sweep_s / POINTS)
    crossings_s = _crossings_s(samples.time_s, samples.angle_deg)
    begin = 0
    while begin + 2 < len(crossings_s):
        begin_s = crossings_s[begin]
        end_s = begin_s + max(least_s, PERIODS * (crossings_s[begin + 2] - begin_s))
        end = int(np.searchsorted(crossings_s, end_s))
        if end >= len(crossings_s):
            return
        phase = _phase(crossings_s[begin : end + 1], begin)
        if phase is not None and abs(phase[2] / (np.pi * wanted_hz_per_s) - 1) < AS_COMMANDED:
            rows = (samples.time_s >= begin_s) & (samples.time_s < crossings_s[end])
            with suppress(NotDetermined):
                yield _window(samples, rows, (begin_s + crossings_s[end]) / 2, phase, play_pulses)
        begin = end


def _crossings_s(time_s: Array, angle_deg: Array) -> Array:
    """Times (m,) at which an angle (n,) passes the middle of its range, interpolated between samples."""
    away = angle_deg - (np.max(angle_deg) + np.min(angle_deg)) / 2
    before = np.flatnonzero((away[:-1] < 0) != (away[1:] < 0))
    share = away[before] / (away[before] - away[before + 1])
    return np.asarray(time_s[before] + share * (time_s[before + 1] - time_s[before]))


def _phase(crossings_s: Array, first: int) -> Array | None:
    """Coefficients (3,) of the phase in rad over the time since the middle; None if it is no parabola.

    The phase grows by π from one crossing to the next.
    """
    at_s = crossings_s - (crossings_s[0] + crossings_s[-1]) / 2
    turned = np.pi * np.arange(first, first + len(at_s))
    phase = np.polynomial.polynomial.polyfit(at_s, turned, 2)
    uneven = turned - np.polynomial.polynomial.polyval(at_s, phase)
    return phase if np.sqrt(np.mean(uneven**2)) < EVEN_RAD else None


def _window(samples: TableSamples, rows: NDArray[np.bool_], middle_s: float, phase: Array, play: float) -> Window:
    """Fit angle and output of a window; the play of a converter is taken out of its counts."""
    counted = samples.sampled is None
    at_s, total = samples.time_s[rows] - middle_s, samples.total[rows]
    half_s = float(np.max(np.abs(at_s)))
    design, turned = _design(at_s, phase, half_s)
    angle = least_squares(design, samples.angle_deg[rows])
    output, behind, stroke, of_counting = angle.gain @ total, np.zeros_like(total), np.inf, 0.0
    if counted:
        steps = np.arange(FINE) / FINE
        fine_s = np.append((at_s[:-1, np.newaxis] + np.diff(at_s)[:, np.newaxis] * steps).ravel(), at_s[-1])
        fine, _ = _design(fine_s, phase, half_s)
        for _ in range(MOST_TURNS if play else 0):
            before, behind = behind, _behind(fine @ output, play / 2)[::FINE]
            output = angle.gain @ (total - behind)
            if float(np.max(np.abs(behind - before))) < SETTLED:
                break
        stroke = _stroke(fine @ output, len(_crossings_s(at_s, samples.angle_deg[rows])) / 2)
        of_counting = _u_counting(design @ output + behind, angle.gain[:2])
    lines = np.exp(-1j * (turned + np.pi * NOISE_LINES[:, np.newaxis] * at_s / half_s))
    return Window(
        float(phase[1] / (2 * np.pi)), middle_s, _phasor(angle.coefficients), _phasor(output),
        _u(angle.residuals, lines), max(_u(total - behind - design @ output, lines), of_counting),
        float(2 * phase[2]), stroke,
    )  # fmt: skip


def _design(at_s: Array, phase: Array, half_s: float) -> tuple[Array, Array]:
    """Columns of the fit, cosine and sine first, and the phase in rad at each time (n,)."""
    turned, along = np.polynomial.polynomial.polyval(at_s, phase), at_s / half_s
    sines = [wave(turned) * along**power for power in range(3) for wave in (np.cos, np.sin)]
    slow = [along**power for power in range(3)]
    return np.column_stack([*sines, np.cos(2 * turned), np.sin(2 * turned), *slow]), np.asarray(turned, np.float64)


def _phasor(coefficients: Array) -> complex:
    return complex(coefficients[0], -coefficients[1])


def _u(residuals: Array, lines: NDArray[np.complex128]) -> float:
    """Standard uncertainty of a phasor along and across, by the noise beside its line in the spectrum."""
    beside = 2 * (lines @ residuals) / len(residuals)
    return float(BENT * np.sqrt(np.mean(np.abs(beside) ** 2) / 2))


def _u_counting(charge: Array, gain: Array) -> float:
    """Standard uncertainty of a phasor by counting a charge (n,); `gain` (2, n) are its rows of a fit.

    Errors of counting that repeat from period to period are at the line, not beside it.
    """
    return float(np.sqrt(np.mean((errors_of_counting(charge) @ gain.T) ** 2)))


def _reversals(charge: Array) -> tuple[NDArray[np.bool_], NDArray[np.intp]]:
    """True where a charge (n,) rises, and indices at which that changes."""
    rising = np.diff(charge, append=2 * charge[-1] - charge[-2]) > 0
    return rising, np.flatnonzero(rising[1:] != rising[:-1]) + 1


def _stroke(charge: Array, periods: float) -> float:
    """Least change of a charge (n,) from one reversal to the next; that of a period if it does not reverse."""
    _, reversed_at = _reversals(charge)
    if len(reversed_at) < 2:
        return float(abs(charge[-1] - charge[0]) / periods)
    return float(np.min(np.abs(np.diff(charge[reversed_at]))))


def _behind(charge: Array, half: float) -> Array:
    """Difference of the counts (n,) of a converter with play from its charge; before the first reversal half of it."""
    rising, reversed_at = _reversals(charge)
    last = np.zeros(len(charge), np.int64)
    last[reversed_at] = reversed_at
    last = np.maximum.accumulate(last)
    began = np.where(last > 0, charge[last], np.where(rising, -np.inf, np.inf))
    return np.where(rising, np.maximum(began + half, charge - half), np.minimum(began - half, charge + half)) - charge
