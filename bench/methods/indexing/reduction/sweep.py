"""A sweep of small angles on an indexing table with the unit on one of its two ends (equations 3.3, 3.4 and 3.6).

The table turns the input axis by θ from the horizontal, up to the largest angle and back, and the output at rest is U =
b + G sin θ: `b` and `G` are the bias and the scale factor of this end. Misalignment and cross coupling of the unit make
them differ between the ends.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc

from bench.methods.indexing.reduction.residual_spectrum import conspicuous_periods
from bench.methods.indexing.words import FEW_ANGLES, MANY_OUTLIERS, NO_LINE, NOT_FOLLOWING
from bench.metrology.least_squares import (
    EXCESSIVE_OUTLIERS,
    Array,
    LinearFit,
    NotDetermined,
    fit_polynomial,
    least_squares,
    reject_outliers,
)
from bench.metrology.results.flag import Flag
from bench.metrology.rows import Rows
from bench.metrology.temperature_checks import broken_at_rest

LEAST_ANGLES = 3
LEAST_REPEATS = 4
SMOOTH_DEGREE = 5  # degree of the curve of a sensor over the angle
SAME_ANGLE = 1e-3  # relative to the range: repeated stops at one angle are not exactly equal
SAME_ANGLE_DEG = 5e-4  # 2 arcsec, the minimum
FEW_READINGS = 5.0
DRIFT_CHANCE = 1e-4  # probability that noise looks like a drift of the bias
DRIFT_SHARE = 0.5  # minimum share of the scatter of below minus above; the rest is hysteresis


@dataclass(frozen=True, slots=True)
class SweepRecord(Rows):
    """One row per dwell in any order, all arrays (n,); a missing number is NaN, a missing word empty.

    `end` is "up" or "down", `direction` "fwd" or "rev", `sequence` numbers the dwells in time order. The temperature
    may be unknown. `side` is the side of approach of the input, "below" or "above"; `stand` is equal for dwells without
    a move of the table between them.
    """

    end: NDArray[np.str_]
    direction: NDArray[np.str_]
    sequence: Array
    angle_deg: Array
    output_v: Array
    stable: NDArray[np.bool_]
    temperature_c: Array
    side: NDArray[np.str_]
    stand: NDArray[np.int_]

    def __len__(self) -> int:
        return len(self.end)

    @property
    def angle_rad(self) -> Array:
        """Angle of the table."""
        return np.radians(self.angle_deg)

    @property
    def temperature_change_c(self) -> float:
        """Largest minus smallest temperature; 0 if unknown. Readings of a broken thermometer do not count."""
        known_c = self.temperature_c[np.isfinite(self.temperature_c)]
        known_c = known_c[~broken_at_rest(known_c)]
        return float(np.ptp(known_c)) if len(known_c) else 0.0


def by_travel(record: SweepRecord) -> SweepRecord:
    """Record with the sides and stands that follow from the order of the angles at each end; known sides are kept.

    The side of the first dwell of an end is unknown.
    """
    stand, side = np.full(len(record), -1), record.side.astype("<U5")
    for end in np.unique(record.end):
        rows = np.flatnonzero((record.end == end) & np.isfinite(record.sequence) & np.isfinite(record.angle_deg))
        rows = rows[np.argsort(record.sequence[rows], kind="stable")]
        moved_deg = np.diff(record.angle_deg[rows], prepend=record.angle_deg[rows[:1]])
        moved = np.abs(moved_deg) > SAME_ANGLE_DEG
        stand[rows] = np.cumsum(moved) + np.max(stand, initial=-1) + 1
        last = np.maximum.accumulate(np.where(moved, np.arange(len(rows)), -1))
        came = np.where(last < 0, "", np.where(moved_deg[last] > 0, "below", "above"))
        side[rows] = np.where(side[rows] == "", came, side[rows])
    return replace(record, side=side, stand=stand)


def usable_rows(record: SweepRecord, output_limit_v: float) -> tuple[SweepRecord, Counter[str]]:
    """Dwells that can be fitted, in time order within each end, and the number left out for each reason.

    Left out are rows with missing values (except the temperature), duplicates, unstable dwells, and outputs at
    `output_limit_v` or beyond.
    """
    present = np.isfinite(np.stack([record.sequence, record.angle_deg, record.output_v])).all(axis=0)
    present &= (record.end != "") & (record.direction != "")
    excluded = Counter(missing=int(np.sum(~present)))
    record = record.rows(present)
    keys = np.stack([record.end == "down", record.sequence, record.direction == "rev", record.angle_deg], axis=-1)
    first = np.unique(keys, axis=0, return_index=True)[1]
    excluded["duplicate"] = len(record) - len(first)
    record = record.rows(first)
    saturated = record.stable & (np.abs(record.output_v) >= output_limit_v)
    excluded["unstable"] = int(np.sum(~record.stable))
    excluded["saturated"] = int(np.sum(saturated))
    return record.rows(record.stable & ~saturated), excluded


@dataclass(frozen=True, slots=True)
class EndFit:
    """U = b + G sin θ through the dwells of one end; V and V/g.

    `gain` (2, n) is the sensitivity of b and G to each reading. `residuals` (n,) are those of the line, including the
    drift if there is one. `drift_v` is the change of the bias from one dwell to the next; b is then the bias at the
    first dwell of the record. `loop_v` are those from below minus those from above at each angle to which the input
    came from both sides. `pattern` is the number of periods of a periodic pattern of the residuals, None without one.
    """

    dwells: SweepRecord
    bias_v: float
    scale_v_per_g: float
    gain: Array
    residuals: Array
    reading_sd_v: float
    drift_v: float | None
    loop_v: Array
    pattern: int | None

    @property
    def covariance(self) -> Array:
        """Covariance (2, 2) of b and G, type A."""
        return self.gain @ self.gain.T * self.reading_sd_v**2

    @property
    def u(self) -> Array:
        """Standard uncertainties (2,) of b and G, type A."""
        return np.sqrt(np.diag(self.covariance))

    def repeats(self, *, standing: bool) -> tuple[float, int]:
        """Sum of squares of readings at one angle from one side, about their mean, and its degrees of freedom.

        It contains neither hysteresis nor nonlinearity. Those `standing` were read without a move of the table between.
        """
        angle, side, stand = _same_angle(self.dwells.angle_deg), self.dwells.side, self.dwells.stand
        alike = np.stack([angle, side == "below", side == "above", stand if standing else 0 * stand], axis=-1)
        group = np.unique(alike, axis=0, return_inverse=True)[1].reshape(-1)
        about_mean = self.residuals - _means(group, self.residuals)[group]
        return float(np.sum(about_mean**2)), len(group) - len(np.unique(group))

    @property
    def linearity(self) -> float:
        """Largest residual relative to the span of the output."""
        sine = np.sin(self.dwells.angle_rad)
        return float(np.max(np.abs(self.residuals)) / np.abs(self.scale_v_per_g * np.ptp(sine)))

    @property
    def hysteresis_v(self) -> float | None:
        """Largest difference between the means from below and from above at one angle; None without such an angle."""
        return float(np.max(np.abs(self.loop_v))) if len(self.loop_v) else None

    @property
    def factors(self) -> Array:
        """Coefficients of cos θ and sin θ cos θ (columns) in b and G (rows): about 1 over small angles."""
        sine, cosine = np.sin(self.dwells.angle_rad), np.cos(self.dwells.angle_rad)
        return np.asarray(self.gain @ np.stack([cosine, sine * cosine], axis=-1))


@dataclass(frozen=True, slots=True)
class EndSweep:
    """Dwells of one end without outliers, and their line; `fit` is None if that failed, for the reason `why`."""

    dwells: SweepRecord
    outliers: int
    fit: EndFit | None
    why: Flag | None = None

    def with_drift(self, first: float) -> EndSweep:
        """The same with a drift in the line, if it is determined, and b for the sequence number `first`."""
        if self.fit is None:
            return self
        try:
            return replace(self, fit=fit_line(self.dwells, drift_from=first))
        except NotDetermined:
            return self


def reduce_end(dwells: SweepRecord, *, outlier_k: float) -> EndSweep:
    """Remove outliers from the usable dwells (n,) of one end and fit the line."""
    if len(np.unique(_same_angle(dwells.angle_deg))) < LEAST_ANGLES:
        return EndSweep(dwells, 0, None, Flag(FEW_ANGLES, values={"least": LEAST_ANGLES}))
    good = _without_outliers(dwells, outlier_k)
    outliers = len(dwells) - int(np.sum(good))
    kept = dwells.rows(good)
    if outliers > EXCESSIVE_OUTLIERS * len(dwells):
        of_all = {"outliers": outliers, "count": len(dwells)}
        return EndSweep(kept, outliers, None, Flag(MANY_OUTLIERS, values=of_all))
    try:
        fit = fit_line(kept)
    except NotDetermined:
        return EndSweep(kept, outliers, None, Flag(NO_LINE))
    if not abs(fit.scale_v_per_g) * np.ptp(np.sin(kept.angle_rad)) > _rounding(kept):  # NaN counts as not following
        return EndSweep(kept, outliers, None, Flag(NOT_FOLLOWING))
    return EndSweep(kept, outliers, fit)


def _without_outliers(dwells: SweepRecord, outlier_k: float) -> NDArray[np.bool_]:
    """Mask of dwells (n,) that are no outliers from a curved line for each side.

    Otherwise hysteresis would form two clusters of residuals, and the robust standard deviation could be that of one of
    them.
    """
    sine, side = np.sin(dwells.angle_rad), np.where(dwells.side == "above", -1.0, 1.0)
    shapes = [np.ones_like(sine), sine, sine**2]
    return _kept(([*shapes, side, side * sine], shapes, shapes[:2]), dwells, outlier_k)


def _kept(choices: Sequence[Sequence[Array]], dwells: SweepRecord, outlier_k: float) -> NDArray[np.bool_]:
    """Mask of dwells (n,) without outliers from the first of several sets of columns that they determine.

    Dwells of one stand share the error of its angle, so the stands count, not the dwells. The median of few residuals
    with many parameters is too small; it is corrected after Rousseeuw and Leroy (Robust Regression and Outlier
    Detection, 1987, 5.1.2): 1 + 5 / (n - p).
    """
    stands = len(np.unique(dwells.stand))
    for columns in choices:
        if stands <= len(columns):
            continue
        few = 1 + FEW_READINGS / (stands - len(columns))
        try:
            return reject_outliers(np.stack(columns, axis=-1), dwells.output_v, sigmas=few * outlier_k).kept
        except NotDetermined:
            continue
    return np.ones(len(dwells), dtype=np.bool_)


def fit_line(dwells: SweepRecord, *, drift_from: float | None = None) -> EndFit:
    """Fit all dwells by ordinary least squares. Raises NotDetermined when the angles do not suffice.

    `drift_from` adds a drift term; b is then the bias at this sequence number.
    """
    sine, middle = np.sin(dwells.angle_rad), float(np.mean(dwells.sequence))
    columns = [np.ones_like(sine), sine]
    to_line = np.eye(2)
    if drift_from is not None:
        columns.append(dwells.sequence - middle)
        to_line = np.array([[1, 0, drift_from - middle], [0, 1, 0]])
    return _end_fit(dwells, least_squares(np.stack(columns, axis=-1), dwells.output_v), to_line)


def _end_fit(dwells: SweepRecord, fit: LinearFit, to_line: Array) -> EndFit:
    """Fit of an end; `to_line` converts the fitted coefficients to b and G."""
    bias_v, scale_v_per_g = (to_line @ fit.coefficients).tolist()
    return EndFit(
        dwells=dwells,
        bias_v=bias_v,
        scale_v_per_g=scale_v_per_g,
        gain=to_line @ fit.gain,
        residuals=fit.residuals,
        reading_sd_v=fit.residual_sd,
        drift_v=float(fit.coefficients[2]) if len(fit.coefficients) > 2 else None,
        loop_v=_below_minus_above(dwells, fit.residuals)[0],
        pattern=_pattern(dwells, fit.residuals),
    )


def bias_drifts(fit: EndFit) -> bool:
    """True if below minus above of a fit without a drift is proportional to the time between the two."""
    loop_v, dwells_between = _below_minus_above(fit.dwells, fit.residuals)
    if len(loop_v) < LEAST_ANGLES + 1 or np.ptp(dwells_between) == 0 or np.ptp(loop_v) <= _rounding(fit.dwells):
        return False
    line = fit_polynomial(dwells_between, loop_v, 1)
    unexplained = float(np.var(line.residuals) / np.var(loop_v))
    by_chance = betainc(line.dof / 2, 0.5, unexplained)  # distribution of the squared correlation coefficient
    return bool(by_chance < DRIFT_CHANCE and unexplained < 1 - DRIFT_SHARE)


def _below_minus_above(dwells: SweepRecord, value: Array) -> tuple[Array, Array]:
    """Mean `value` from below minus from above, and mean time difference, at each angle approached from both sides."""
    angle = _same_angle(dwells.angle_deg)
    below, above = dwells.side == "below", dwells.side == "above"
    both = np.intersect1d(angle[below], angle[above])
    return (
        _means(angle[below], value[below])[both] - _means(angle[above], value[above])[both],
        _means(angle[below], dwells.sequence[below])[both] - _means(angle[above], dwells.sequence[above])[both],
    )


def _means(group: NDArray[np.int_], value: Array) -> Array:
    """Mean of `value` by group number; 0 for a number without a value."""
    return np.asarray(np.bincount(group, value) / np.maximum(np.bincount(group), 1))


def _same_angle(angle_deg: Array) -> NDArray[np.int_]:
    """Group numbers (n,) of the angles, ascending; equal for dwells at one angle."""
    order = np.argsort(angle_deg)
    number = np.zeros(len(angle_deg), dtype=np.int_)
    span_deg = np.ptp(angle_deg) if len(angle_deg) else 0.0
    number[order[1:]] = np.cumsum(np.diff(angle_deg[order]) > max(SAME_ANGLE * span_deg, SAME_ANGLE_DEG))
    return number


def _pattern(dwells: SweepRecord, residuals: Array) -> int | None:
    """Periods over all angles of a pattern of the residuals, beside a smooth curve; None without one."""
    angle = _same_angle(dwells.angle_deg)
    mean_v, mean_deg = _means(angle, residuals), _means(angle, dwells.angle_deg)
    degree = min(SMOOTH_DEGREE, len(mean_v) // 3)
    if degree == 0 or np.ptp(mean_v) <= _rounding(dwells):
        return None
    return conspicuous_periods(fit_polynomial(mean_deg, mean_v, degree).residuals)


def _rounding(dwells: SweepRecord) -> float:
    """Differences (V) that are rounding only."""
    return 64 * float(np.finfo(np.float64).eps * np.max(np.abs(dwells.output_v)))
