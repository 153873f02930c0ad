"""Decision whether a drift of an accelerometer channel found at 1 g applies at another input level (equations 2.5).

The slope of a channel with D = S0 (1 + α (T - T0)) I + b0 + β (T - T0) is k = S0 α I + β: a constant part, and one
proportional to the level. With the first part alone, all levels have one slope k; with the second alone, one relative
slope k / D.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincc

from bench.methods.channel.reduction.line import ChannelRun
from bench.methods.channel.words import NO_RATE, OTHER_INVALID, OTHER_POLARITY, OWN_INVALID, UNCERTAIN_SLOPE
from bench.metrology.least_squares import Array, least_squares
from bench.metrology.results.coverage import coverage_factor, effective_dof

Basis = Literal["raw", "normalised"]
Decision = Literal["share", "keep", "invalid"]

LEAST_SIGNIFICANCE = 3.0  # minimum ratio of a slope in a denominator to its standard uncertainty
ROUNDING = 1e-12  # of the rate: rounding of a zero change over a whole run
MISFIT_PROBABILITY = 0.01
LEAST_LEVEL_G = 0.1  # below this a bias may be as large as the input
LARGEST_BIAS_G = 0.5
PROPORTION = 0.1  # maximum relative deviation of a rate per g from that of the other runs


class Decided(NamedTuple):
    """Decision on one basis; marginal if a repeated run might give another. `remarks` are the reasons for none."""

    decision: Decision
    marginal: bool
    remarks: tuple[str, ...]


class RelativeDeviation(NamedTuple):
    """|(x' - x) / x| of a run's x' and its reference's x, its standard uncertainty, and |x' - x|; NaN if unknown."""

    value: float
    u: float
    difference: float


@dataclass(frozen=True, slots=True)
class Comparison:
    """Comparison of a run with its reference, by the slopes k and by the relative slopes k / D.

    `rate` + `slope_per_c` (T - reference temperature) is the model that serves the level; NaN where there is no
    decision. `remarks` state why there is none, or why it is not based on the deviation. `decided` are the decisions on
    both bases; `decision` and `marginal` are those on the chosen one.
    """

    raw: RelativeDeviation
    normalised: RelativeDeviation
    decision: Decision
    marginal: bool
    rate: float
    slope_per_c: float
    remarks: tuple[str, ...]
    decided: Mapping[Basis, Decided]


def compare(run: ChannelRun, reference: ChannelRun, *, threshold: float, basis: Basis) -> Comparison:
    """Decide whether the model of `reference` serves the level of `run` too ("share"), or not ("keep").

    The slope is shared on the basis "raw", the relative slope on the basis "normalised"; the rate is always the run's
    own. "invalid" if one of the runs is, or if the slope of the reference is less than three times its uncertainty:
    then only the differences are given. A run of the other polarity keeps its own model, because the converter has
    another scale factor there.
    """
    certain = _is_certain(reference)
    raw = _deviation(run.slope_per_c, run.u_slope_per_c, reference.slope_per_c, reference.u_slope_per_c, certain)
    normalised = _deviation(
        run.relative_slope_per_c, run.u_relative_slope_per_c,
        reference.relative_slope_per_c, reference.u_relative_slope_per_c, certain,
    )  # fmt: skip
    deviations: Mapping[Basis, RelativeDeviation] = {"raw": raw, "normalised": normalised}
    decided: Mapping[Basis, Decided] = {
        each: _decided(run, reference, deviation, threshold) for each, deviation in deviations.items()
    }
    decision, marginal, remarks = decided[basis]
    shared_slope = reference.slope_per_c if basis == "raw" else reference.relative_slope_per_c * run.rate
    return Comparison(
        raw=raw,
        normalised=normalised,
        decision=decision,
        marginal=marginal,
        rate=np.nan if decision == "invalid" else run.rate,
        slope_per_c={"share": shared_slope, "keep": run.slope_per_c, "invalid": np.nan}[decision],
        remarks=remarks,
        decided=decided,
    )


def _decided(run: ChannelRun, reference: ChannelRun, deviation: RelativeDeviation, threshold: float) -> Decided:
    if invalid := _problems(run, reference, _is_certain(reference), deviation):
        return Decided("invalid", False, invalid)
    if run.rate * reference.rate < 0:
        return Decided("keep", False, (OTHER_POLARITY,))
    k = coverage_factor(_dof(run, reference))
    is_close = bool(deviation.value <= threshold)
    return Decided("share" if is_close else "keep", bool(abs(deviation.value - threshold) < k * deviation.u), ())


def _is_certain(reference: ChannelRun) -> bool:
    """True if a slope is certain enough for a denominator."""
    slope, rate = abs(reference.slope_per_c), abs(reference.rate)
    significant = slope >= LEAST_SIGNIFICANCE * reference.u_slope_per_c
    return significant and slope * reference.span_c > ROUNDING * rate


def _deviation(value: float, u: float, reference: float, u_reference: float, certain: bool) -> RelativeDeviation:
    """Deviation of two independent values."""
    difference = abs(value - reference)
    if not certain:
        return RelativeDeviation(np.nan, np.nan, difference)
    u_ratio = float(np.hypot(u / reference, value / reference * (u_reference / reference)))
    return RelativeDeviation(abs(difference / reference), u_ratio, difference)


def _dof(run: ChannelRun, reference: ChannelRun) -> int | None:
    """Effective degrees of freedom of the uncertainty of the deviation of two slopes, raw or normalised."""
    of_reference = run.slope_per_c / reference.slope_per_c * reference.u_slope_per_c
    return effective_dof([(run.u_slope_per_c, run.dof_slope), (of_reference, reference.dof_slope)])


def _problems(run: ChannelRun, reference: ChannelRun, certain: bool, deciding: RelativeDeviation) -> tuple[str, ...]:
    """Reasons why no decision is possible."""
    problems = {
        OWN_INVALID: not run.valid,
        OTHER_INVALID: not reference.valid,
        UNCERTAIN_SLOPE: not certain,
        NO_RATE: certain and np.isnan(deciding.value),
    }
    return tuple(problem for problem, holds in problems.items() if holds)[:1]


@dataclass(frozen=True, slots=True)
class ChannelDrift:
    """Line k = offset + scale D: the constant part of the drift, and the part proportional to the rate.

    `misfit` is true if the slopes deviate from the line by more than their uncertainties: the drift depends on the
    level in another way. The uncertainties are those of the slopes; NaN where a slope has none. `gain` (2, n) is the
    sensitivity of offset and scale to each slope.
    """

    offset_per_c: float
    scale_per_c: float
    u_offset_per_c: float
    u_scale_per_c: float
    misfit: bool
    gain: Array = field(compare=False, repr=False)


def channel_drift(runs: Sequence[ChannelRun]) -> ChannelDrift:
    """Fit the line through the slopes of at least two runs over their rates, weighted by 1 / u(k).

    The slopes are finite. Raises NotDetermined when the rates are all about the same.
    """
    rate = np.array([run.rate for run in runs])
    slope = np.array([run.slope_per_c for run in runs])
    u = np.array([run.u_slope_per_c for run in runs])
    exact = not (u > 0).all()
    weight = (np.ones_like(u) if exact else 1 / u)[:, np.newaxis]
    design = np.stack([np.ones_like(rate), rate], axis=-1)
    least_squares(design, slope, names=("tempco_offset", "tempco_scale"))  # raises; weights do not separate rates
    fit = least_squares(design * weight, slope * weight[:, 0], condition_limit=np.finfo(np.float64).max)
    u_offset, u_scale = np.full(2, np.nan) if exact else np.sqrt(np.diag(fit.unscaled_covariance))
    # by the distribution of chi²
    chance = gammaincc(fit.dof / 2, float(np.sum(fit.residuals**2)) / 2) if fit.dof and not exact else 1.0
    return ChannelDrift(
        offset_per_c=float(fit.coefficients[0]),
        scale_per_c=float(fit.coefficients[1]),
        u_offset_per_c=float(u_offset),
        u_scale_per_c=float(u_scale),
        misfit=bool(chance < MISFIT_PROBABILITY),
        gain=fit.gain * weight[:, 0],
    )


def out_of_proportion(level_g: Array, rate: Array) -> NDArray[np.bool_]:
    """Mask of runs (n,) whose rate per g differs from that of most others: a wrong unit, fixture or polarity."""
    judged = (np.abs(level_g) >= LEAST_LEVEL_G) & np.isfinite(level_g) & np.isfinite(rate)
    odd = np.zeros(len(level_g), dtype=np.bool_)
    if judged.any():
        per_g = rate[judged] / level_g[judged]
        usual = np.median(per_g)
        odd[judged] = np.abs(per_g - usual) > PROPORTION * np.abs(usual)
        small = ~judged & np.isfinite(level_g) & np.isfinite(rate)
        odd[small] = np.abs(rate[small] - usual * level_g[small]) > LARGEST_BIAS_G * np.abs(usual)
    return odd
