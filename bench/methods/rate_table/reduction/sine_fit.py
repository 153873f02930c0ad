"""Sines fitted to samples at known or nearly known frequency (IEEE 1057; equations 1.8).

A sine is reported as its phasor Z, the complex number with signal = Re[Z exp(i 2π f (t - origin))]: |Z| is the
amplitude, and two phasors of one origin divided give gain and phase between two signals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.methods.rate_table.reduction.blocks import coarseness
from bench.methods.rate_table.reduction.count_quantisation import A_FEW, along_and_across, errors_of_counting, slowly
from bench.metrology.least_squares import Array, GatedFit, LinearFit, NotDetermined, least_squares, reject_outliers
from bench.metrology.sampled_codes import hidden_from_a_swing

Phasors = NDArray[np.complex128]

SAMPLES_PER_PERIOD = 2.05  # samples per period: Shannon's two, and a little
REACH = 0.02  # of the expected frequency: half-width of the search,
REACH_PERIODS = (2, 50)  # but at least and at most this many periods more or less over the record
NEIGHBOURS = 24  # frequencies around a line for the noise under it,
NEIGHBOURS_REACH = 32  # chosen among this many on either side
GRID_PER_PERIOD = 3  # frequencies tried, per period more or less over the record
HARMLESS = 1e-4  # of the amplitude; smaller deviations change it by less, and that is below any encoder error
PHASE_BINS = 1009  # prime, so that phases at whole fractions of a turn do not fall on edges
MANY_PHASES = 500
TURNS = 20
TURNS_OF_NOISE = 4  # iterations: the weights depend on the result


@dataclass(frozen=True, slots=True)
class SineFit:
    """Least squares offset + slope t + the sine and its harmonics; `phasors` (m,) are those of f, 2f, ….

    `u_random` (m,) are the standard uncertainties of the amplitudes from the noise around each line in the spectrum of
    the residuals: the noise need not be white. `u_periodic` is that of each of them from period-synchronous errors,
    such as those of an encoder sampled at few different phases; `u_counting` (m,) are those from the quantisation of
    the samples, which are not in `u_random`, and `u_across_counting` (m,) the same at right angles to the phasors.
    `few_phases` is true if errors that repeat are more of the amplitude's than all noise. `kept` (n,) masks the samples
    that were used.
    """

    frequency_hz: float
    phasors: Phasors
    u_random: Array
    u_periodic: float
    few_phases: bool
    u_counting: Array
    u_across_counting: Array
    kept: NDArray[np.bool_]
    excessive: bool

    @property
    def dropped(self) -> int:
        """Number of outliers."""
        return int(np.sum(~self.kept))

    @property
    def u(self) -> Array:
        """Standard uncertainties (m,) of the amplitudes of independent readings.

        The errors that repeat in every period contain those of quantisation, as far as these repeat.
        """
        return np.hypot(self.u_random, np.maximum(self.u_periodic, self.u_counting))

    @property
    def u_across(self) -> Array:
        """The same (m,) at right angles to the phasors: divided by an amplitude it is that of the phase, in rad."""
        return np.hypot(self.u_random, np.maximum(self.u_periodic, self.u_across_counting))


def fit_sine(
    time_s: Array,
    value: Array,
    frequency_hz: float,
    *,
    harmonics: int = 1,
    origin_s: float = 0.0,
    step: float = 0.0,
    behind: Array | None = None,
    rounding: float = 0.0,
    resolution: float = 0.0,
) -> SineFit:
    """Fit a sine of known frequency, and its harmonics up to `harmonics`, to samples (n,) by increasing time.

    `step` is the resolution of counted samples; `behind` (n,) the lag from converter hysteresis that was removed from
    them. `rounding` is the quantisation step of codes, `resolution` that of an angle, whose middle stays where it is.

    Outliers are left out; `excessive` is true if they were too many. Raises NotDetermined if the samples do not
    separate the columns: a small part of a period, or a harmonic with hardly two samples in its period.
    """
    if not resolved(time_s, harmonics * frequency_hz):
        raise NotDetermined([f"harmonic {harmonics}"], rank=harmonics - 1, of=harmonics, condition=np.inf)
    design = _design(time_s, frequency_hz, harmonics, origin_s)
    gated = _without_outliers(design, value)
    kept, fit = gated.kept, gated.fit
    lines_hz: Array = frequency_hz * np.arange(1.0, harmonics + 1)
    fitted = design[kept] @ fit.coefficients + slowly(fit.residuals, time_s[kept], 1 / frequency_hz)
    errors = _errors_of_steps(fitted, step or resolution, None if behind is None else behind[kept])
    moved = errors @ fit.gain.T
    of_counting = (errors - moved @ design[kept].T)[A_FEW]  # enough for the mean of many lines
    noise, counted = (
        _variances(time_s[kept], each, fit.dof, lines_hz) for each in (fit.residuals[np.newaxis], of_counting)
    )
    pairs = fit.coefficients[2:].reshape(-1, 2)
    along, across = along_and_across(pairs, moved[:, 2:].reshape(-1, harmonics, 2))
    hidden = hidden_from_a_swing(np.linalg.norm(pairs, axis=1), fit.residual_sd, rounding)
    phase = _phases(time_s[kept], frequency_hz)
    if _are_few(phase):
        along, across = (np.maximum(each, _u_few(phase, resolution)) for each in (along, across))
    u_periodic = _u_periodic(phase, fit.residuals)
    return SineFit(
        frequency_hz=frequency_hz,
        phasors=pairs[:, 0] - 1j * pairs[:, 1],
        u_random=_u_amplitudes(fit, np.sqrt(np.maximum(noise - counted, 0.0))),
        u_periodic=u_periodic,
        few_phases=bool(u_periodic > _u_amplitudes(fit, np.sqrt(noise))[0]),
        u_counting=np.hypot(hidden, along),
        u_across_counting=np.hypot(hidden, across),
        kept=kept,
        excessive=gated.excessive,
    )


def find_frequency(time_s: Array, value: Array, near_hz: float) -> float:
    """Frequency of a four-parameter fit to samples (n,) of a sine of nearly known frequency.

    The search starts at the largest line of the spectrum within 2 % of `near_hz`, and within 2 to 50 periods over the
    length of the record; outliers of a sine of `near_hz` are left out. Raises NotDetermined if there is none, or fewer
    than about two samples in a period, because of aliasing.
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
    grid_hz, sums = _spectrum(time_s, level.residuals[np.newaxis], near_hz, 1 / (GRID_PER_PERIOD * span_s), steps)
    return _refined(time_s, value, float(grid_hz[np.argmax(np.abs(sums))]), within_hz=1 / span_s)


def resolved(time_s: Array, frequency_hz: float) -> bool:
    """True if samples at increasing times (n,) are dense enough to distinguish `frequency_hz` from all lower ones."""
    return len(time_s) > 1 and float(np.median(np.diff(time_s))) * frequency_hz * SAMPLES_PER_PERIOD <= 1


def _refined(time_s: Array, value: Array, start_hz: float, within_hz: float) -> float:
    """Refine the frequency by Gauss-Newton: its column is the derivative of the sine, linear in all other terms."""
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
    """Fit of a `_design` without outliers."""
    waves = np.array([0.0, 0.0, *np.ones(design.shape[1] - 2)])
    return reject_outliers(design, value, resolution=coarseness(value), harmless=HARMLESS * waves)


def _spectrum(time_s: Array, values: Array, middle_hz: float, step_hz: float, reach: int) -> tuple[Array, Phasors]:
    """Frequencies (j,) `middle_hz` + i `step_hz` with i from -`reach` to `reach`, and Σ values exp(-i 2π f t), (j, k).

    Values are (k, n), samples of k signals at the same times.
    """
    time_s = time_s - time_s[0]
    frequency_hz = middle_hz + step_hz * np.arange(-reach, reach + 1.0)
    sums = np.empty((len(frequency_hz), len(values)), dtype=np.complex128)
    turned = np.exp(-2j * np.pi * frequency_hz[0] * time_s)
    step = np.exp(-2j * np.pi * step_hz * time_s)
    for i in range(len(frequency_hz)):
        sums[i] = values @ turned.view(np.float64).reshape(-1, 2) @ (1, 1j)
        turned *= step
    return frequency_hz, sums


def _errors_of_steps(fitted: Array, step: float, behind: Array | None) -> Array:
    """Possible counting errors of samples (n,), (k, n); none for samples that were not counted."""
    if not step:
        return np.zeros((1, len(fitted)))
    charge = fitted if behind is None else fitted + behind
    return step * errors_of_counting(charge / step)


def _u_amplitudes(fit: LinearFit, sd: Array) -> Array:
    """Standard uncertainties of the sines (m,) from the standard deviation of a sample: the covariance along them."""
    found = []
    for column, each in zip(range(2, len(fit.coefficients), 2), sd, strict=True):
        pair = slice(column, column + 2)
        size = np.linalg.norm(fit.coefficients[pair])
        direction = fit.coefficients[pair] / size if size else np.array([1.0, 0.0])
        found.append(each * np.sqrt(direction @ fit.unscaled_covariance[pair, pair] @ direction))
    return np.array(found)


def _variances(time_s: Array, residuals: Array, dof: int, lines_hz: Array) -> Array:
    """Variances (m,) of one sample if the noise were as strong at all frequencies as around each of `lines_hz`.

    From the spectra of residuals (k, n) of fits with those lines, at whole numbers of periods over the record and
    without the lines, as a mean over all k. With few samples it is that of the residuals.
    """
    if not residuals.any():
        return np.zeros(len(lines_hz))
    if len(time_s) < 4 * NEIGHBOURS:
        of_all = float(np.mean(np.sum(residuals**2, axis=1))) / dof if dof else np.nan
        return np.full(len(lines_hz), of_all)
    return np.array([_variance_around(line_hz, time_s, residuals, lines_hz) for line_hz in lines_hz])


def _variance_around(line_hz: float, time_s: Array, residuals: Array, fitted_hz: Array) -> float:
    step_hz = 1 / float(np.ptp(time_s))
    around_hz, sums = _spectrum(time_s, residuals, line_hz, step_hz, NEIGHBOURS_REACH)
    free = around_hz > 1.5 * step_hz
    free &= np.all(np.abs(around_hz[:, np.newaxis] - fitted_hz) > 1.5 * step_hz, axis=1)
    nearest = np.argsort(np.abs(around_hz[free] - line_hz), kind="stable")[:NEIGHBOURS]
    power = np.mean(np.abs(sums[free][nearest]) ** 2, axis=1)
    return _power_at(line_hz, around_hz[free][nearest], power) / len(time_s)


def _power_at(line_hz: float, around_hz: Array, power: Array) -> float:
    """Power (n,) of noise at a line, from frequencies around it.

    Noise is a floor, as from counting, plus a part that falls with the square of the frequency, as of an integrated
    rate: near a low frequency the mean of the neighbourhood is far from the power at the line. Both parts are fitted by
    least squares, weighted by the result, because the scatter of powers is proportional to them.
    """
    from scipy.optimize import nnls  # imports many modules, which most runs do not need

    shapes = np.column_stack([np.ones_like(around_hz), (line_hz / around_hz) ** 2])
    level = np.full(len(power), np.mean(power))
    if not level.all():
        return 0.0
    for _ in range(TURNS_OF_NOISE):
        parts, _ = nnls(shapes / level[:, np.newaxis], power / level)
        level = shapes @ parts
    return float(np.sum(parts))


def _phases(time_s: Array, frequency_hz: float) -> Array:
    """Bins of phase of samples (n,)."""
    return np.asarray(np.round(PHASE_BINS * (frequency_hz * (time_s - time_s[0]) % 1)) % PHASE_BINS)


def _are_few(phase: Array) -> bool:
    """True if samples (n,) repeat a few phases, and with them the errors of a resolution."""
    return len(np.unique(phase)) <= min(MANY_PHASES, len(phase) / 2)


def _u_few(phase: Array, resolution: float) -> float:
    """Standard uncertainty of an amplitude from independent errors of a resolution at few phases (n,).

    Of a swing about the middle or the edge of a step those of opposite angles are opposite, and half of them
    independent.
    """
    return float(resolution / np.sqrt(12) * np.sqrt(2 / (len(np.unique(phase)) / 2)))


def _u_periodic(phase: Array, residuals: Array) -> float:
    """Standard uncertainty of an amplitude from errors that repeat in the residuals of every period.

    It is the scatter of means at equal phase beyond that of means of random errors; three of their degrees of freedom
    are used by the fit. Unknown (infinite) with three different phases or fewer, taken as 0 if there are many.
    """
    if not _are_few(phase):
        return 0.0
    _, which, count = np.unique(phase, return_inverse=True, return_counts=True)
    if len(count) <= 3:
        return np.inf
    means = np.bincount(which, residuals) / count
    between = float(np.sum(means**2)) / (len(count) - 3)
    within = float(np.var(residuals)) * len(count) / len(residuals)
    return float(np.sqrt(max(between - within, 0.0) * 2 / len(count)))
