"""Sines fitted to samples at known or nearly known frequency (IEEE 1057; methods.md 1.8).

A sine is reported as its phasor Z, the complex number with signal = Re[Z exp(i 2π f (t - origin))]: |Z| is the
amplitude, and two phasors of one origin divided give gain and phase between two signals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.analysis.fit import Array, LinearFit, NotDetermined, least_squares, reject_outliers
from bench.analysis.table_blocks import coarseness

Phasors = NDArray[np.complex128]

SAMPLES_PER_PERIOD = 2.05  # Shannon's two, and a little
REACH = 0.02  # of the expected frequency: how far off it is looked for
NEIGHBOURS = 16  # frequencies around a line that tell the noise under it
PHASE_BINS = 1009  # prime, so that phases at whole fractions of a turn do not fall on edges
MANY_PHASES = 500
TURNS = 20


@dataclass(frozen=True, slots=True)
class SineFit:
    """Least squares offset + slope t + the sine and its harmonics; `phasors` (m,) are those of f, 2f, ....

    `u_random` (m,) are the standard uncertainties of the amplitudes from the noise that stands around each line in the
    spectrum of the residuals: the noise need not be white. `u_repeating` is that of any of them from errors that are
    the same in every period, as those of a counting encoder are when few different phases are sampled (`phases`).
    `kept` (n,) marks the samples that were used.
    """

    frequency_hz: float
    phasors: Phasors
    u_random: Array
    u_repeating: float
    phases: int
    residual_sd: float
    kept: NDArray[np.bool_]
    excessive: bool

    @property
    def dropped(self) -> int:
        """How many samples were outliers."""
        return int(np.sum(~self.kept))

    @property
    def u(self) -> Array:
        """Standard uncertainties (m,) of the amplitudes of independent readings."""
        return np.hypot(self.u_random, self.u_repeating)


def fit_sine(
    time_s: Array, value: Array, frequency_hz: float, *, harmonics: int = 1, origin_s: float = 0.0
) -> SineFit:
    """Fits a sine of known frequency, and its harmonics up to `harmonics`, to samples (n,) by increasing time.

    Outliers are left out; `excessive` tells that they were too many. Raises NotDetermined when the samples cannot tell
    the columns apart: less than about a period, or a harmonic that they alias onto something else.
    """
    design = _design(time_s, frequency_hz, harmonics, origin_s)
    gated = reject_outliers(design, value, resolution=coarseness(value))
    lines_hz = frequency_hz * np.arange(1, harmonics + 1)
    used_s, fit = time_s[gated.kept], gated.fit
    pairs = fit.coefficients[2:].reshape(-1, 2)
    u = [
        _u_amplitude(fit, 2 + 2 * i, _sd_around(used_s, fit.residuals, line_hz, lines_hz))
        for i, line_hz in enumerate(lines_hz)
    ]
    repeating_sd, phases = _repeating(used_s, fit.residuals, frequency_hz)
    return SineFit(
        frequency_hz=frequency_hz,
        phasors=pairs[:, 0] - 1j * pairs[:, 1],
        u_random=np.array(u),
        u_repeating=repeating_sd * float(np.sqrt(2 / phases)),
        phases=phases,
        residual_sd=fit.residual_sd,
        kept=gated.kept,
        excessive=gated.excessive,
    )


def find_frequency(time_s: Array, value: Array, near_hz: float) -> float:
    """The frequency of a four-parameter fit to samples (n,) of a sine of nearly known frequency.

    It is looked for where the spectrum is largest within 2 % of `near_hz`, or within two periods over the length of
    the record, whichever is more; outliers of the sine found there are left out. Raises NotDetermined when there is
    none, or fewer than about two samples in a period: those of another frequency look the same.
    """
    spacing_s = float(np.median(np.diff(time_s))) if len(time_s) > 1 else np.inf
    if near_hz * spacing_s * SAMPLES_PER_PERIOD > 1:
        raise NotDetermined(["frequency"], rank=0, of=1, condition=np.inf)
    kept = reject_outliers(_design(time_s, near_hz, 1, 0.0), value, resolution=coarseness(value)).kept
    time_s, value = time_s[kept], value[kept]
    span_s = float(np.ptp(time_s))
    reach_hz = min(max(2 / span_s, REACH * near_hz), near_hz / 2)
    grid_hz = np.linspace(near_hz - reach_hz, near_hz + reach_hz, 2 * int(np.ceil(3 * reach_hz * span_s)) + 1)
    level = least_squares(_design(time_s, near_hz, 0, 0.0), value)
    start_hz = float(grid_hz[np.argmax(np.abs(_spectrum(time_s, level.residuals, grid_hz)))])
    return _refined(time_s, value, start_hz, within_hz=1 / span_s)


def _refined(time_s: Array, value: Array, start_hz: float, within_hz: float) -> float:
    """Gauss-Newton from `start_hz`: the sine is linear but in its frequency, whose column is its derivative."""
    frequency_hz = start_hz
    middle_s = float(np.mean(time_s))
    turn_s = 2 * np.pi * (time_s - middle_s)
    for _ in range(TURNS):
        design = _design(time_s, frequency_hz, 1, middle_s)
        cosine, sine = least_squares(design, value).coefficients[2:]
        by_hz = turn_s * (sine * design[:, 2] - cosine * design[:, 3])
        fit = least_squares(
            np.column_stack([design, by_hz]), value, names=["offset", "slope", "cosine", "sine", "frequency"]
        )
        step_hz, u_hz = float(fit.coefficients[4]), float(np.sqrt(fit.covariance[4, 4]))
        frequency_hz += step_hz
        if abs(frequency_hz - start_hz) > within_hz:
            break
        if abs(step_hz) <= 1e-9 * frequency_hz + 1e-6 * (u_hz if np.isfinite(u_hz) else 0.0):
            return frequency_hz
    raise NotDetermined(["frequency"], rank=4, of=5, condition=np.inf)


def _design(time_s: Array, frequency_hz: float, harmonics: int, origin_s: float) -> Array:
    """Columns of offset, slope, and cosine and sine of each harmonic."""
    angle = 2 * np.pi * frequency_hz * (time_s - origin_s)
    waves = [wave(k * angle) for k in range(1, harmonics + 1) for wave in (np.cos, np.sin)]
    return np.column_stack([np.ones_like(time_s), time_s - np.mean(time_s), *waves])


def _spectrum(time_s: Array, value: Array, frequency_hz: Array) -> Phasors:
    """Σ value exp(-i 2π f t) at each frequency (m,)."""
    return np.asarray(np.exp(-2j * np.pi * np.outer(frequency_hz, time_s - time_s[0])) @ value)


def _u_amplitude(fit: LinearFit, column: int, sd: float) -> float:
    """Of the sine whose cosine stands in `column` and whose sine follows: the part of the covariance along it."""
    pair = slice(column, column + 2)
    size = np.linalg.norm(fit.coefficients[pair])
    direction = fit.coefficients[pair] / size if size else np.array([1.0, 0.0])
    return float(sd * np.sqrt(direction @ fit.unscaled_covariance[pair, pair] @ direction))


def _sd_around(time_s: Array, residuals: Array, line_hz: float, fitted_hz: Array) -> float:
    """Standard deviation of one sample if the noise were as strong at all frequencies as it is around `line_hz`.

    From the residuals' spectrum at whole numbers of periods over the record, without the lines that the fit took out.
    """
    step_hz = 1 / float(np.ptp(time_s))
    away = np.arange(2, NEIGHBOURS * 3)
    around_hz = line_hz + step_hz * np.stack([away, -away], axis=-1).ravel()
    free = around_hz > 1.5 * step_hz
    free &= np.all(np.abs(around_hz[:, np.newaxis] - fitted_hz) > 1.5 * step_hz, axis=1)
    power = np.abs(_spectrum(time_s, residuals, around_hz[free][:NEIGHBOURS])) ** 2
    return float(np.sqrt(np.mean(power) / len(residuals)))


def _repeating(time_s: Array, residuals: Array, frequency_hz: float) -> tuple[float, int]:
    """Standard deviation of what repeats in the residuals of every period, and the number of different phases.

    It is what the means at equal phase scatter beyond the means of random errors; three of the phases' freedoms went
    into the fit. Unknown (infinite) with three phases or fewer, taken as 0 where there are many.
    """
    phase = np.round(PHASE_BINS * (frequency_hz * (time_s - time_s[0]) % 1)) % PHASE_BINS
    _, which, count = np.unique(phase, return_inverse=True, return_counts=True)
    if len(count) > min(MANY_PHASES, len(residuals) / 2):
        return 0.0, len(count)
    if len(count) <= 3:
        return np.inf, len(count)
    means = np.bincount(which, residuals) / count
    between = float(np.sum(means**2)) / (len(count) - 3)
    within = float(np.var(residuals)) * len(count) / len(residuals)
    return float(np.sqrt(max(between - within, 0.0))), len(count)
