"""Sines fitted to samples at known or nearly known frequency (IEEE 1057; methods.md 1.8).

A sine is reported as its phasor Z, the complex number with signal = Re[Z exp(i 2π f (t - origin))]: |Z| is the
amplitude, and two phasors of one origin divided give gain and phase between two signals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from bench.analysis.codes import hidden_from_a_swing
from bench.analysis.fit import Array, GatedFit, LinearFit, NotDetermined, least_squares, reject_outliers
from bench.analysis.table_blocks import coarseness

Phasors = NDArray[np.complex128]

SAMPLES_PER_PERIOD = 2.05  # Shannon's two, and a little
REACH = 0.02  # of the expected frequency: how far off it is looked for,
REACH_PERIODS = (2, 50)  # but at least and at most so many periods more or less over the record
NEIGHBOURS = 24  # frequencies around a line that tell the noise under it,
NEIGHBOURS_REACH = 32  # among so many on either side
GRID_PER_PERIOD = 3  # frequencies tried, per period more or less over the record
HARMLESS = 1e-4  # of the amplitude; what deviates less moves it by less, and that is below any encoder's figure
PHASE_BINS = 1009  # prime, so that phases at whole fractions of a turn do not fall on edges
MANY_PHASES = 500
TURNS = 20
TURNS_OF_NOISE = 4  # its weights depend on it
SAW_TOOTH = 20  # sines that it is taken for
PHASES = 720  # at which it is looked for where a count turns round


@dataclass(frozen=True, slots=True)
class SineFit:
    """Least squares offset + slope t + the sine and its harmonics; `phasors` (m,) are those of f, 2f, ....

    `u_random` (m,) are the standard uncertainties of the amplitudes from the noise that stands around each line in the
    spectrum of the residuals: the noise need not be white. `u_repeating` is that of any of them from errors that are
    the same in every period, as those of a counting encoder are when few different phases are sampled; `u_counting`
    (m,) are those from the steps of an output that was counted or rounded. `kept` (n,) marks the samples that were
    used.
    """

    frequency_hz: float
    phasors: Phasors
    u_random: Array
    u_repeating: float
    u_counting: Array
    kept: NDArray[np.bool_]
    excessive: bool

    @property
    def dropped(self) -> int:
        """How many samples were outliers."""
        return int(np.sum(~self.kept))

    @property
    def u(self) -> Array:
        """Standard uncertainties (m,) of the amplitudes of independent readings."""
        return np.hypot(np.hypot(self.u_random, self.u_repeating), self.u_counting)


def fit_sine(
    time_s: Array,
    value: Array,
    frequency_hz: float,
    *,
    harmonics: int = 1,
    origin_s: float = 0.0,
    step: float = 0.0,
    at_turns: float = 1.0,
    rounding: float = 0.0,
) -> SineFit:
    """Fits a sine of known frequency, and its harmonics up to `harmonics`, to samples (n,) by increasing time.

    `step` is by what the samples go, where they were counted, `at_turns` how much farther off they are where they turn
    round than those of a counter without play. `rounding` is by what samples go that are codes of an output.

    Outliers are left out; `excessive` tells that they were too many. Raises NotDetermined when the samples cannot tell
    the columns apart: a small part of a period, or a harmonic with hardly two samples in its period.
    """
    if not resolved(time_s, harmonics * frequency_hz):
        raise NotDetermined([f"harmonic {harmonics}"], rank=harmonics - 1, of=harmonics, condition=np.inf)
    design = _design(time_s, frequency_hz, harmonics, origin_s)
    gated = _without_outliers(design, value)
    lines_hz: Array = frequency_hz * np.arange(1.0, harmonics + 1)
    used_s, fit = time_s[gated.kept], gated.fit
    pairs = fit.coefficients[2:].reshape(-1, 2)
    u = [_u_amplitude(fit, 2 + 2 * i, _sd_around(used_s, fit, line_hz, lines_hz)) for i, line_hz in enumerate(lines_hz)]
    hidden = hidden_from_a_swing(np.linalg.norm(pairs, axis=1), fit.residual_sd, rounding)
    return SineFit(
        frequency_hz=frequency_hz,
        phasors=pairs[:, 0] - 1j * pairs[:, 1],
        u_random=np.array(u),
        u_repeating=_u_repeating(used_s, fit.residuals, frequency_hz),
        u_counting=np.hypot(hidden, at_turns * _u_counting(used_s, fit, frequency_hz, step)),
        kept=gated.kept,
        excessive=gated.excessive,
    )


def find_frequency(time_s: Array, value: Array, near_hz: float) -> float:
    """The frequency of a four-parameter fit to samples (n,) of a sine of nearly known frequency.

    It is looked for where the spectrum is largest within 2 % of `near_hz`, and within 2 to 50 periods over the length
    of the record; outliers of a sine of `near_hz` are left out. Raises NotDetermined when there is
    none, or fewer than about two samples in a period: those of another frequency look the same.
    """
    if not resolved(time_s, near_hz):
        raise NotDetermined(["frequency"], rank=0, of=1, condition=np.inf)
    kept = _without_outliers(_design(time_s, near_hz, 1, 0.0), value).kept
    time_s, value = time_s[kept], value[kept]
    span_s = float(np.ptp(time_s))
    least_hz, most_hz = (periods / span_s for periods in REACH_PERIODS)
    reach_hz = min(max(least_hz, min(REACH * near_hz, most_hz)), near_hz / 2)
    level = least_squares(_design(time_s, near_hz, 0, 0.0), value)
    steps = int(GRID_PER_PERIOD * reach_hz * span_s)
    grid_hz, sums = _spectrum(time_s, level.residuals, near_hz, 1 / (GRID_PER_PERIOD * span_s), steps)
    return _refined(time_s, value, float(grid_hz[np.argmax(np.abs(sums))]), within_hz=1 / span_s)


def resolved(time_s: Array, frequency_hz: float) -> bool:
    """Whether samples at increasing times (n,) are close enough to tell `frequency_hz` from all lower ones."""
    return len(time_s) > 1 and float(np.median(np.diff(time_s))) * frequency_hz * SAMPLES_PER_PERIOD <= 1


def _refined(time_s: Array, value: Array, start_hz: float, within_hz: float) -> float:
    """Gauss-Newton from `start_hz`: the sine is linear but in its frequency, whose column is its derivative."""
    frequency_hz = start_hz
    middle_s = float(np.mean(time_s))
    turn_s = 2 * np.pi * (time_s - middle_s)
    cosine, sine = least_squares(_design(time_s, frequency_hz, 1, middle_s), value).coefficients[2:]
    for _ in range(TURNS):
        design = _design(time_s, frequency_hz, 1, middle_s)
        by_hz = turn_s * (sine * design[:, 2] - cosine * design[:, 3])
        fit = least_squares(
            np.column_stack([design, by_hz]), value, names=["offset", "slope", "cosine", "sine", "frequency"]
        )
        cosine, sine = fit.coefficients[2:4]
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


def _without_outliers(design: Array, value: Array) -> GatedFit:
    """The fit of a `_design` without the samples that are far from it."""
    waves = np.array([0.0, 0.0, *np.ones(design.shape[1] - 2)])
    return reject_outliers(design, value, resolution=coarseness(value), harmless=HARMLESS * waves)


def _spectrum(time_s: Array, value: Array, middle_hz: float, step_hz: float, reach: int) -> tuple[Array, Phasors]:
    """Frequencies `middle_hz` + k `step_hz` with k from -`reach` to `reach`, and Σ value exp(-i 2π f t) at each."""
    time_s = time_s - time_s[0]
    frequency_hz = middle_hz + step_hz * np.arange(-reach, reach + 1.0)
    sums = np.empty(len(frequency_hz), dtype=np.complex128)
    turned = value * np.exp(-2j * np.pi * frequency_hz[0] * time_s)
    step = np.exp(-2j * np.pi * step_hz * time_s)
    for k in range(len(frequency_hz)):
        sums[k] = np.sum(turned)
        turned *= step
    return frequency_hz, sums


def _u_amplitude(fit: LinearFit, column: int, sd: float) -> float:
    """Of the sine whose cosine stands in `column` and whose sine follows: the part of the covariance along it."""
    pair = slice(column, column + 2)
    size = np.linalg.norm(fit.coefficients[pair])
    direction = fit.coefficients[pair] / size if size else np.array([1.0, 0.0])
    return float(sd * np.sqrt(direction @ fit.unscaled_covariance[pair, pair] @ direction))


def _u_counting(time_s: Array, fit: LinearFit, frequency_hz: float, step: float) -> float:
    """Of any amplitude, from the steps of counting.

    The error of counting is a saw tooth of the count n, Σ sin(2π m n) / (π m). It averages out but where the count
    turns round, there the less, the more slowly it turns (stationary phase). Where the counts go on by a whole number
    in a period, or by a fraction with a small denominator, all periods have the same error, and no spectrum of
    residuals shows it.
    """
    if not step:
        return 0.0
    counts = fit.coefficients[1:] / step
    orders = np.arange(1, len(counts) // 2 + 1)
    waves = (counts[1::2] - 1j * counts[2::2]) * np.exp(1j * np.outer(np.arange(PHASES) / PHASES * 2 * np.pi, orders))
    on_the_way = float(counts[0]) / frequency_hz
    speed = on_the_way / (2 * np.pi) + np.real(waves @ (1j * orders))  # counts per radian of the phase
    turns = np.sign(speed) != np.sign(np.roll(speed, -1))
    bends = np.maximum(np.abs(np.real(waves @ orders**2))[turns], 1.0)
    m = np.arange(1.0, SAW_TOOTH + 1)
    beat = np.remainder(m * on_the_way + 0.5, 1.0) - 0.5  # of a turn, from period to period
    alike = np.sinc(beat * max(1.0, float(np.ptp(time_s)) * frequency_hz)) / np.sinc(beat)
    return float(step * np.sqrt(np.sum(alike**2 / m**3) * np.sum(1 / bends) / 2) / np.pi**2)


def _sd_around(time_s: Array, fit: LinearFit, line_hz: float, fitted_hz: Array) -> float:
    """Standard deviation of one sample if the noise were as strong at all frequencies as it is around `line_hz`.

    From the residuals' spectrum at whole numbers of periods over the record, without the lines that the fit took out.
    Of few samples it is that of the residuals.
    """
    if len(time_s) < 4 * NEIGHBOURS:
        return fit.residual_sd
    step_hz = 1 / float(np.ptp(time_s))
    around_hz, sums = _spectrum(time_s, fit.residuals, line_hz, step_hz, NEIGHBOURS_REACH)
    free = around_hz > 1.5 * step_hz
    free &= np.all(np.abs(around_hz[:, np.newaxis] - fitted_hz) > 1.5 * step_hz, axis=1)
    nearest = np.argsort(np.abs(around_hz[free] - line_hz), kind="stable")[:NEIGHBOURS]
    power = np.abs(sums[free][nearest]) ** 2
    return float(np.sqrt(_power_at(line_hz, around_hz[free][nearest], power) / len(time_s)))


def _power_at(line_hz: float, around_hz: Array, power: Array) -> float:
    """The power (n,) of noise at frequencies around a line, at the line.

    Noise is a floor, as that of steps of counting, and what falls with the square of the frequency, as that of a rate
    that was summed up: about a low frequency the mean of what is around is far from what is there. Both are fitted by
    least squares, weighted by themselves because powers scatter by as much as they are.
    """
    shapes = np.column_stack([np.ones_like(around_hz), (line_hz / around_hz) ** 2])
    level = np.full(len(power), np.mean(power))
    if not level.all():
        return 0.0
    for _ in range(TURNS_OF_NOISE):
        parts, _ = nnls(shapes / level[:, np.newaxis], power / level)
        level = shapes @ parts
    return float(np.sum(parts))


def _u_repeating(time_s: Array, residuals: Array, frequency_hz: float) -> float:
    """Standard uncertainty of an amplitude from what repeats in the residuals of every period.

    It is what the means at equal phase scatter beyond means of random errors; three of their degrees of freedom went
    into the fit. Unknown (infinite) with three different phases or fewer, taken as 0 where there are many.
    """
    phase = np.round(PHASE_BINS * (frequency_hz * (time_s - time_s[0]) % 1)) % PHASE_BINS
    _, which, count = np.unique(phase, return_inverse=True, return_counts=True)
    if len(count) > min(MANY_PHASES, len(residuals) / 2):
        return 0.0
    if len(count) <= 3:
        return np.inf
    means = np.bincount(which, residuals) / count
    between = float(np.sum(means**2)) / (len(count) - 3)
    within = float(np.var(residuals)) * len(count) / len(residuals)
    return float(np.sqrt(max(between - within, 0.0) * 2 / len(count)))
