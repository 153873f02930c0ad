"""Dynamic temperature characteristic: one position, the temperature ramped up and down (equations 6.3).

A straight line through all data, and the departures from it: residuals, the loop between rising and falling
temperature, the difference between cycles, jumps, and a model in which the output lags behind the thermometer.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from bench.methods.ramp.reduction.jumps import find_jumps
from bench.methods.ramp.reduction.legs import Leg, RampRecord, cut_into_legs
from bench.metrology.least_squares import Array, NotDetermined, PolynomialFit, fit_polynomial, least_squares
from bench.metrology.results.flag import INVALID
from bench.metrology.temperature_checks import rates_c_per_s

UG_PER_G = 1e6
RATE_SAMPLES = 21  # window of the smoothing of dT/dt
LEFT_BY_LAG = 0.2  # of the mean loop: maximum remainder after the lag model if the loop is lag


@dataclass(frozen=True, slots=True)
class RampLimits:
    """Limits of the verdict, in µg; None is no limit.

    A jump is a step of more than the threshold between `jump_window` samples on either side.
    """

    jump_threshold_ug: float = 60.0
    jump_window: int = 8
    residual_ug: float | None = None
    repeatability_ug: float | None = None


@dataclass(frozen=True, slots=True)
class RampJump:
    """Jump of the output at `temperature_c`; `size_ug` is after minus before in time, `u_ug` from the scatter."""

    cycle: int
    leg: str
    temperature_c: float
    size_ug: float
    u_ug: float


@dataclass(frozen=True, slots=True)
class LagModel:
    """U = bias + slope T + rate dT/dt, found at rates up to `fastest_c_per_s` either way.

    A lag τ behind the thermometer gives a rate coefficient of -slope τ.

    Next to a turn of the ramp, where the smoothing of dT/dt would extend into the other leg, the model is neither
    fitted nor judged: there dT/dt has already changed while a lagging output still turns.
    """

    bias_g: float
    slope_g_per_c: float
    rate_g_s_per_c: float
    max_residual_ug: float
    fastest_c_per_s: float


@dataclass(frozen=True, slots=True)
class Differences:
    """Differences of two legs at whole degrees that both have passed, (n,): one minus other in µg at `temperature_c`.

    `cycle` is that of the one, `leg` is empty for the rising against the falling one. `gain` (n,) are the standard
    deviations of the differences of samples that scatter by 1.
    """

    cycle: int
    leg: str
    temperature_c: Array
    ug: Array
    gain: Array


@dataclass(frozen=True, slots=True)
class DynamicCharacteristic:
    """The straight line U = bias + slope T over all data, in g over °C, and the departures from it in µg.

    `residuals_ug` by leg; `loops` are rising against falling legs of a cycle, empty without a temperature passed on
    both, `changes` the legs of later cycles against the same of the first. `lag` is None if the rate of temperature did
    not change. `is_lag`: the lag model removes most of the loop, which then is no hysteresis. `missing` lists judged or
    required results that the record does not determine. `excluded` counts rows by reason.
    """

    legs: tuple[Leg, ...]
    line: PolynomialFit
    residuals_ug: tuple[Array, ...]
    loops: tuple[Differences, ...]
    changes: tuple[Differences, ...]
    jumps: tuple[RampJump, ...]
    lag: LagModel | None
    is_lag: bool
    verdict: str | None
    missing: tuple[str, ...]
    flags: tuple[str, ...]
    excluded: dict[str, int]

    @property
    def max_residual_ug(self) -> float:
        """Largest departure from the line."""
        return self.line.max_residual * UG_PER_G

    @property
    def rms_residual_ug(self) -> float:
        """Root mean square of the departure from the line."""
        return float(np.sqrt(np.mean(self.line.residuals**2))) * UG_PER_G

    @property
    def hysteresis_ug(self) -> float | None:
        """Largest of the loops; None without one."""
        return _largest(self.loops)

    @property
    def repeatability_ug(self) -> float | None:
        """Largest of the changes between cycles; None without a second cycle."""
        return _largest(self.changes)


def reduce_ramp(record: RampRecord, limits: RampLimits, *, turns: bool = False) -> DynamicCharacteristic:
    """Reduce a ramp to residuals, hysteresis, repeatability, jumps, lag model and verdict.

    All usable samples are used in all results: a jump counts in the residual and in the loop as well. The verdict is
    "pass", "fail", "invalid" if a leg has lost more than half of its samples, "incomplete" if nothing fails but the
    record does not determine all judged results or lacks a direction of the ramp, or None if every leg is too short to
    detect a jump. Flags: `ill_conditioned` without a lag model; `invalid`, with either of the latter two.

    With `turns` the legs have their turn-rounds. Raises NotDetermined without two different temperatures.
    """
    legs, excluded = cut_into_legs(record, turns=turns)
    line = fit_polynomial(_joined(leg.temperature_c for leg in legs), _joined(leg.output_g for leg in legs), 1)
    residuals_ug = [(leg.output_g - line.value(leg.temperature_c)) * UG_PER_G for leg in legs]
    at_degrees = _at_whole_degrees(legs, residuals_ug)
    loops, changes = _loops(at_degrees), _changes(at_degrees)
    jumps = tuple(_jumps(legs, residuals_ug, limits))
    lag, loops_left = _lag_model(legs)
    lost = not all(leg.complete for leg in legs)
    judged = any(len(leg.time_s) >= 2 * limits.jump_window for leg in legs)  # a jump could be detected
    flags = {
        "ill_conditioned": lag is None,
        INVALID: lost or not judged,
    }
    failed = (
        bool(jumps)
        or _exceeds(line.max_residual * UG_PER_G, limits.residual_ug)
        or _exceeds(_largest(changes), limits.repeatability_ug)
    )
    missing = tuple(_missing(loops, changes, limits))
    return DynamicCharacteristic(
        legs=tuple(legs),
        line=line,
        residuals_ug=tuple(residuals_ug),
        loops=loops,
        changes=changes,
        jumps=jumps,
        lag=lag,
        is_lag=bool(loops_left) and _mean(loops_left) < LEFT_BY_LAG * _mean(loops),
        verdict=("invalid" if lost else "fail" if failed else "incomplete" if missing else "pass") if judged else None,
        missing=missing,
        flags=tuple(flag for flag, raised in flags.items() if raised),
        excluded=excluded,
    )


def _missing(loops: Sequence[Differences], changes: Sequence[Differences], limits: RampLimits) -> Iterator[str]:
    if not loops:
        yield "hysteresis: no temperature was passed rising and falling in one cycle"
    if limits.repeatability_ug is not None and not changes:
        yield "repeatability: no temperature was passed the same way in a second cycle"


def _joined(parts: Iterable[Array]) -> Array:
    return np.concatenate([np.zeros(0), *parts])


def _largest(differences: Sequence[Differences]) -> float | None:
    return max((float(np.max(np.abs(each.ug))) for each in differences), default=None)


def _mean(differences: Sequence[Differences]) -> float:
    return float(np.mean(np.abs(_joined(each.ug for each in differences))))


def _exceeds(value: float | None, limit: float | None) -> bool:
    return value is not None and limit is not None and value > limit


@dataclass(frozen=True, slots=True)
class _AtDegrees:
    """Values of each leg, by cycle and name, at every whole degree of the record; NaN if not passed.

    `gains` are the standard deviations of these values for samples with a standard deviation of 1.
    """

    temperature_c: Array
    legs_ug: dict[tuple[int, str], Array]
    gains: dict[tuple[int, str], Array]

    def between(self, one: tuple[int, str], other: tuple[int, str], leg: str) -> Differences | None:
        """Differences of two legs; None if they have no degree in common."""
        differences_ug = self.legs_ug[one] - self.legs_ug[other]
        common = np.isfinite(differences_ug)
        if not common.any():
            return None
        gain = np.hypot(self.gains[one], self.gains[other])
        return Differences(one[0], leg, self.temperature_c[common], differences_ug[common], gain[common])


def _at_whole_degrees(legs: Sequence[Leg], residuals_ug: Sequence[Array]) -> _AtDegrees:
    temperature_c = _joined(leg.temperature_c for leg in legs)
    degrees_c = np.arange(np.ceil(np.min(temperature_c)), np.floor(np.max(temperature_c)) + 1)
    names = [(leg.cycle, leg.name) for leg in legs]
    passed = [_passing(degrees_c, leg, ug) for leg, ug in zip(legs, residuals_ug, strict=True)]
    values, gains = ([each[of] for each in passed] for of in (0, 1))
    return _AtDegrees(degrees_c, dict(zip(names, values, strict=True)), dict(zip(names, gains, strict=True)))


def _passing(degrees_c: Array, leg: Leg, residual_ug: Array) -> Array:
    """Residual of a leg at each of `degrees_c`, by a straight line through the samples within ±0.5 °C of it.

    (2, n): the second row is its standard deviation for samples with a standard deviation of 1. If samples are farther
    apart, the line goes through the next ones. NaN where the line would have to be extrapolated.
    """
    known = np.flatnonzero(np.isfinite(residual_ug))
    if len(known) < 2:
        return np.full((2, len(degrees_c)), np.nan)
    order = known[np.argsort(leg.temperature_c[known])]
    x, y = leg.temperature_c[order], residual_ug[order]
    near_c = max(0.5, float(np.median(np.abs(np.diff(leg.temperature_c[known])))))
    starts = np.searchsorted(x, degrees_c - near_c, "left")
    ends = np.searchsorted(x, degrees_c + near_c, "right")
    return np.array([
        _line_at(degree_c, x[start:end], y[start:end])
        for degree_c, start, end in zip(degrees_c, starts, ends, strict=True)
    ]).reshape(-1, 2).T  # fmt: skip


def _line_at(at: float, x: Array, y: Array) -> tuple[float, float]:
    """Least-squares line through y over ascending x, at a position between them; NaN elsewhere.

    The second value is its standard deviation for y with a standard deviation of 1.
    """
    if not len(x) or not x[0] <= at <= x[-1]:
        return np.nan, np.nan
    away = x - x.mean()
    spread = float(away @ away)
    weights = 1 / len(x) + (away * (at - x.mean()) / spread if spread else np.zeros(len(x)))
    return float(weights @ y), float(np.linalg.norm(weights))


def _loops(at_degrees: _AtDegrees) -> tuple[Differences, ...]:
    """Rising minus falling for each cycle that has both."""
    cycles = [cycle for cycle, leg in at_degrees.legs_ug if leg == "up" and (cycle, "down") in at_degrees.legs_ug]
    found = (at_degrees.between((cycle, "up"), (cycle, "down"), "") for cycle in cycles)
    return tuple(each for each in found if each is not None)


def _changes(at_degrees: _AtDegrees) -> tuple[Differences, ...]:
    """Each later cycle minus the first one, by leg."""
    first = {leg: cycle for cycle, leg in sorted(at_degrees.legs_ug, reverse=True)}
    found = (
        at_degrees.between((cycle, leg), (first[leg], leg), leg)
        for cycle, leg in at_degrees.legs_ug
        if cycle != first[leg]
    )
    return tuple(each for each in found if each is not None)


def _jumps(legs: Sequence[Leg], residuals_ug: Sequence[Array], limits: RampLimits) -> Iterator[RampJump]:
    """Jumps by leg and time; each leg is evaluated by itself, so no step is sought across a turn of the ramp."""
    window, threshold_ug = limits.jump_window, limits.jump_threshold_ug
    for leg, residual_ug in zip(legs, residuals_ug, strict=True):
        for part in leg.stretches(longest_hole=window):
            temperature_c = leg.temperature_c[part]
            for jump in find_jumps(leg.time_s[part], residual_ug[part], threshold=threshold_ug, window=window):
                at_c = (temperature_c[jump.after - 1] + temperature_c[jump.after]) / 2
                yield RampJump(leg.cycle, leg.name, float(at_c), jump.size, jump.u)


def _lag_model(legs: Sequence[Leg]) -> tuple[LagModel | None, tuple[Differences, ...]]:
    """Lag model and the loops that it leaves; None if the rate of temperature is constant."""
    designs = [np.stack([np.ones_like(leg.time_s), leg.temperature_c, rates_of(leg)], axis=-1) for leg in legs]
    design, output_g = np.concatenate(designs), _joined(leg.output_g for leg in legs)
    known = np.isfinite(design[:, 2])
    try:
        fit = least_squares(design[known], output_g[known], names=("B0", "B1", "Bd"))
    except NotDetermined:
        return None, ()
    pairs = zip(legs, designs, strict=True)
    residuals_ug = [(leg.output_g - columns @ fit.coefficients) * UG_PER_G for leg, columns in pairs]
    largest_ug = float(np.max(np.abs(fit.residuals))) * UG_PER_G
    bias_g, slope_g_per_c, rate_g_s_per_c = (float(coefficient) for coefficient in fit.coefficients)
    fastest_c_per_s = float(np.max(np.abs(design[known, 2])))
    model = LagModel(bias_g, slope_g_per_c, rate_g_s_per_c, largest_ug, fastest_c_per_s)
    return model, _loops(_at_whole_degrees(legs, residuals_ug))


def rates_of(leg: Leg) -> Array:
    """dT/dt at each sample, the slope of a line through 21 samples around it, fewer in a leg of fewer than 40.

    NaN where the samples around do not all belong to the leg.
    """
    rate_c_per_s = np.full(len(leg.time_s), np.nan)
    for part in leg.stretches(longest_hole=RATE_SAMPLES // 2):
        samples = min(RATE_SAMPLES, (part.stop - part.start) // 2 | 1)
        if samples >= 3:
            slope = rates_c_per_s(leg.time_s[part], leg.temperature_c[part], samples)
            rate_c_per_s[part.start + samples // 2 : part.stop - samples // 2] = slope
    return rate_c_per_s
