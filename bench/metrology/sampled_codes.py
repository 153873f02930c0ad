"""Mean of the samples that a unit sends of its own output: sampling times and quantisation uncertainty."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.metrology.acquisition import Array, Codes, Output
from bench.metrology.pulse_counts import LEAST_SHARE, is_irregular, steps_of

FEWEST_CODES = 2  # minimum number for a standard deviation
DITHERED_STEPS = 0.55  # standard deviation in steps above which it is no toggling between two codes, at most 0.5
HARMONICS = 5
HARMONICS_OF_SWINGS = 20
LARGEST_J1 = 0.582


def mean_code(codes: Codes) -> Output:
    """Mean of the samples; NaN with fewer than two.

    Problems: too_few_codes, irregular_clock (device time and numbers disagree, as after a restart of the unit),
    stuck_code (the same value for too long).
    """
    if len(codes.values) < FEWEST_CODES:
        return Output(float("nan"), float("nan"), ("too_few_codes",), float("nan"))
    problems = []
    if len(codes.values) < LEAST_SHARE * (len(codes.values) + codes.lost + codes.invalid):
        problems.append("too_few_codes")
    if has_restarted(codes):
        problems.append("irregular_clock")
    if stuck(codes).any():
        problems.append("stuck_code")
    sd = float(np.std(codes.values, ddof=1))
    scatter_u = sd / float(np.sqrt(len(codes.values)))
    return Output(float(np.mean(codes.values)), scatter_u, tuple(problems), hidden_by_steps(sd, codes.step))


def mean_between(codes: Codes, from_s: float, to_s: float) -> Output:
    """Mean over a time in which the output may oscillate once or more, as over whole turns; problems as above.

    A sample may be the mean since the one before, so that those count which began after `from_s`. Each is weighted with
    the time since the one before; the remainder at both ends is assigned to the nearest, so that whole turns remain
    whole. The scatter is computed from differences of neighbours, which do not contain slow oscillations.
    """
    whole = mean_code(codes)
    at_s = sampled_at_s(codes)
    before_s = np.concatenate(([-np.inf], at_s[:-1]))
    inside = np.flatnonzero((before_s >= from_s) & (at_s <= to_s))
    if whole.problems or len(inside) < FEWEST_CODES:
        return whole._replace(problems=whole.problems or ("too_few_codes",))
    values, lasts_s = codes.values[inside], np.diff(at_s[inside], prepend=from_s)
    lasts_s[-1] += to_s - at_s[inside[-1]]
    sd = float(np.sqrt(np.mean(np.diff(values) ** 2) / 2))
    mean = float(values @ lasts_s) / (to_s - from_s)
    return Output(mean, sd / float(np.sqrt(len(values))), (), hidden_by_steps(sd, codes.step))


def has_restarted(codes: Codes) -> bool:
    """True if clock and sample numbers of the unit disagree, or have gone back."""
    if codes.restarts:
        return True
    if len(codes.tick) < 2:
        return False
    return is_irregular(_device_steps_s(codes) / np.diff(codes.sequence))


def sampled_at_s(codes: Codes) -> Array:
    """Sampling times in bench time (N,).

    The unit's clock is converted to the host's by the straight line through the arrivals: a frame may be late, and both
    clocks have errors. If the unit restarted, only the arrival times are available.
    """
    if len(codes.tick) < 2 or has_restarted(codes):
        return codes.host_s
    return on_the_host_clock(np.concatenate(([0.0], np.cumsum(_device_steps_s(codes)))), codes.host_s)


def on_the_host_clock(device_s: Array, host_s: Array) -> Array:
    """Times of a device's clock (n,) converted by a straight line through the arrival times (n,)."""
    away_s = device_s - device_s.mean()
    return np.asarray(host_s[0] + (host_s - host_s[0]).mean() + host_per_device(device_s, host_s) * away_s)


def host_per_device(device_s: Array, host_s: Array) -> float:
    """Seconds of the host's clock per second of a device's, from arrivals (n,) at its times (n,), ascending, n ≥ 2.

    Tukey's resistant line: between the medians of the first and of the last third. Arrivals are delayed by the latency
    timer of an adapter, and some of them by much more while the computer is busy. 1 if no time passes between them.
    """
    third = max(1, len(host_s) // 3)
    late_s = host_s - device_s
    passed_s, more_s = (np.median(each[-third:]) - np.median(each[:third]) for each in (device_s, late_s))
    return float(1.0 + more_s / passed_s) if passed_s > 0 else 1.0


def stuck(codes: Codes) -> NDArray[np.bool_]:
    """Mask (N,) of samples in a row of equal values longer than the unit's noise permits."""
    if codes.stuck_after is None or not len(codes.values):
        return np.zeros(len(codes.values), dtype=bool)
    begins = np.flatnonzero(np.diff(codes.values, prepend=np.nan) != 0)
    lengths = np.diff(begins, append=len(codes.values))
    return np.repeat(lengths >= codes.stuck_after, lengths)


def hidden_by_steps(sd: float, step: float) -> float:
    """Quantisation uncertainty of a mean of samples with standard deviation `sd`.

    Noise linearises the quantisation: with a standard deviation s of noise and steps q the mean of rounded samples has
    an error with the harmonics k of a sawtooth, each of amplitude q/(π k) exp(-2 π² k² s²/q²). If the scatter is no
    more than toggling between two codes, the error may be that of the whole step, q/√12.
    """
    if sd < DITHERED_STEPS * step:
        return step / float(np.sqrt(12))
    noise2 = (sd / step) ** 2 - 1 / 12  # rounding contributes to the scatter
    k = np.arange(1, HARMONICS + 1)
    return step * float(np.sqrt(np.sum((np.exp(-2 * np.pi**2 * k**2 * noise2) / (np.pi * k)) ** 2 / 2)))


def hidden_from_a_swing(amplitude: Array, sd: float, step: float) -> Array:
    """Quantisation uncertainties (m,) of sinusoidal amplitudes in samples.

    As in `hidden_by_steps`; an oscillation passes through the sawtooth: its harmonic k contributes 2 J1(2π k A/q) at
    the frequency of the oscillation, at most and on average 1/√(π z) for J1(z). `sd` is that of the samples without the
    sine. Without noise that is about 0.02 of a step for a sine of 30 steps.
    """
    if not step:
        return np.zeros_like(amplitude)
    noise2 = max((sd / step) ** 2 - 1 / 12, 0.0)
    k = np.arange(1, HARMONICS_OF_SWINGS + 1)
    sawtooth = step / (np.pi * k) * np.exp(-2 * np.pi**2 * k**2 * noise2)
    bessel2 = np.minimum(1 / (np.pi * np.maximum(2 * np.pi * np.outer(amplitude / step, k), 1e-9)), LARGEST_J1**2)
    return np.asarray(np.sqrt(np.sum(2 * sawtooth**2 * bessel2, axis=1)))


def quantisation_by_angle(gain: Array, quantisation_u: Array, angle_rad: Array) -> Array:
    """Quantisation uncertainty of a result with sensitivities `gain` (n,) to readings, one error for each angle.

    Readings at one angle fall into one step, and have the same error.
    """
    return quantisation_by_level(gain, quantisation_u, np.asarray(np.round(np.degrees(angle_rad), 1), np.float64))


def quantisation_by_level(gain: Array, quantisation_u: Array, level: Array) -> Array:
    """The same for readings at levels (n,) of the measured quantity."""
    _, place = np.unique(level, return_inverse=True)
    return np.asarray(np.bincount(place, weights=gain * quantisation_u), np.float64)


def _device_steps_s(codes: Codes) -> Array:
    return np.asarray(steps_of(codes.tick, codes.tick_bits) * codes.tick_period_s, np.float64)
