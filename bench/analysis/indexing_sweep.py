"""A sweep of small angles on an indexing table with the unit on one of its two ends (methods.md 3.3, 3.4 and 3.6).

The table turns the input axis by θ from the horizontal, up to the largest angle and back, and the output at rest is
U = b + G sin θ: `b` and `G` are the bias and the scale factor of this end. With the misalignment and the cross coupling
of the unit they differ between the ends.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from bench.analysis.fit import Array, LinearFit, NotDetermined, reject_outliers
from bench.analysis.residual_spectrum import SpectralLine, conspicuous_line
from bench.analysis.thermometer import broken_at_rest

LEAST_ANGLES = 3
SAME_ANGLE = 1e-3  # of the range: a table that is sent to one angle twice does not stop at exactly the same
DRIFT_CHANCE = 1e-4  # that noise looks like a drift of the bias
DRIFT_SHARE = 0.8  # of the scatter of forward minus reverse that a drift explains; hysteresis explains the rest better


@dataclass(frozen=True, slots=True)
class SweepRecord:
    """One row per dwell in any order, all arrays (n,); a missing number is NaN, a missing word empty.

    `end` is "up" or "down", `direction` "fwd" or "rev", `sequence` counts the dwells in the order of time. The
    temperature may be unknown.
    """

    end: NDArray[np.str_]
    direction: NDArray[np.str_]
    sequence: Array
    angle_deg: Array
    output_v: Array
    stable: NDArray[np.bool_]
    temperature_c: Array

    def rows(self, which: NDArray[np.int_] | NDArray[np.bool_]) -> SweepRecord:
        """A part of the record, by row numbers or by a mask."""
        return SweepRecord(**{column.name: getattr(self, column.name)[which] for column in fields(self)})

    def __len__(self) -> int:
        return len(self.end)

    @property
    def angle_rad(self) -> Array:
        """Angle of the table."""
        return np.radians(self.angle_deg)

    @property
    def temperature_change_c(self) -> float:
        """Largest minus smallest temperature; 0 where it is not known. A broken thermometer does not count."""
        known_c = self.temperature_c[np.isfinite(self.temperature_c)]
        known_c = known_c[~broken_at_rest(known_c)]
        return float(np.ptp(known_c)) if len(known_c) else 0.0


def usable_rows(record: SweepRecord, output_limit_v: float) -> tuple[SweepRecord, Counter[str]]:
    """The dwells that can be fitted, in the order of time within each end, and how many were left out for which reason.

    Left out are rows with something missing (the temperature may), all but the first of equal ones, unstable dwells,
    and outputs at `output_limit_v` or beyond.
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

    `gain` (2, n) is what one volt more in each reading adds to b and G. `residuals` (n,) are what the line, and the
    drift where there is one, leave. `drift_v` is the change of the bias from one dwell to the next; b is then the bias
    at the first dwell of the record. `loop_v` are forward minus reverse at each angle that was visited both ways.
    """

    dwells: SweepRecord
    bias_v: float
    scale_v_per_g: float
    gain: Array
    residuals: Array
    reading_sd_v: float
    drift_v: float | None
    loop_v: Array
    pattern: SpectralLine | None

    @property
    def covariance(self) -> Array:
        """Covariance (2, 2) of b and G, type A."""
        return self.gain @ self.gain.T * self.reading_sd_v**2

    @property
    def u(self) -> Array:
        """Standard uncertainties (2,) of b and G, type A."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def linearity(self) -> float:
        """Largest residual as a part of the span of the output."""
        sine = np.sin(self.dwells.angle_rad)
        return float(np.max(np.abs(self.residuals)) / np.abs(self.scale_v_per_g * np.ptp(sine)))

    @property
    def hysteresis_v(self) -> float | None:
        """Largest difference between the means of both directions at one angle; None without such an angle."""
        return float(np.max(np.abs(self.loop_v))) if len(self.loop_v) else None

    @property
    def misalignment_factor(self) -> float:
        """What the fit makes of cos θ in b: about 1 over small angles."""
        return float(self.gain[0] @ np.cos(self.dwells.angle_rad))

    @property
    def coupling_factor(self) -> float:
        """What the fit makes of sin θ cos θ in G: about 1 over small angles."""
        angle_rad = self.dwells.angle_rad
        return float(self.gain[1] @ (np.sin(angle_rad) * np.cos(angle_rad)))


@dataclass(frozen=True, slots=True)
class EndSweep:
    """The dwells of one end without outliers, and their line; `fit` is None when they are no calibration: `why`."""

    dwells: SweepRecord
    outliers: int
    fit: EndFit | None
    why: str = ""


def reduce_end(dwells: SweepRecord, *, outlier_k: float, first: float, drifts: bool = False) -> EndSweep:
    """The line through the usable dwells (n,) of one end.

    `first` is the sequence number for which b is given when the fit has a term for the drift: with `drifts`.
    """
    sine, since_mean = np.sin(dwells.angle_rad), dwells.sequence - np.mean(dwells.sequence) if len(dwells) else sine
    columns = [np.ones_like(sine), sine] + ([since_mean] if drifts else [])
    if len(np.unique(_same_angle(dwells.angle_deg))) < LEAST_ANGLES:
        return EndSweep(dwells, 0, None, f"fewer than {LEAST_ANGLES} different angles are left")
    try:
        gated = reject_outliers(np.stack(columns, axis=-1), dwells.output_v, sigmas=outlier_k)
    except NotDetermined:
        return EndSweep(dwells, 0, None, "its angles lie too close together")
    kept = dwells.rows(gated.kept)
    outliers = len(dwells) - len(kept)
    if gated.excessive:
        return EndSweep(kept, outliers, None, f"{outliers} of {len(dwells)} dwells are outliers")
    return EndSweep(kept, outliers, _end_fit(kept, gated.fit, first - float(np.mean(dwells.sequence)), drifts))


def _end_fit(dwells: SweepRecord, fit: LinearFit, back: float, drifts: bool) -> EndFit:
    """`back` is how many dwells after the mean of the time b is wanted."""
    to_first = np.array([[1, 0, back], [0, 1, 0]]) if drifts else np.eye(2)
    bias_v, scale_v_per_g = to_first @ fit.coefficients
    return EndFit(
        dwells=dwells,
        bias_v=float(bias_v),
        scale_v_per_g=float(scale_v_per_g),
        gain=to_first @ fit.gain,
        residuals=fit.residuals,
        reading_sd_v=fit.residual_sd,
        drift_v=float(fit.coefficients[2]) if drifts else None,
        loop_v=_forward_minus_reverse(dwells, fit.residuals)[0],
        pattern=_pattern(dwells, fit.residuals),
    )


def drifts(fit: EndFit) -> bool:
    """Whether forward minus reverse of a fit without a drift changes in proportion to the time between the two."""
    loop_v, dwells_between = _forward_minus_reverse(fit.dwells, fit.residuals)
    if len(loop_v) < LEAST_ANGLES + 1 or np.ptp(dwells_between) == 0 or np.ptp(loop_v) <= _rounding(fit.dwells):
        return False
    line = stats.linregress(dwells_between, loop_v)
    return bool(line.pvalue < DRIFT_CHANCE and line.rvalue**2 > DRIFT_SHARE)


def _forward_minus_reverse(dwells: SweepRecord, value: Array) -> tuple[Array, Array]:
    """Forward minus reverse of the mean `value` (n,) and of the mean time in dwells, at each angle visited both ways."""
    angle = _same_angle(dwells.angle_deg)
    forward, reverse = dwells.direction == "fwd", dwells.direction == "rev"
    both = np.intersect1d(angle[forward], angle[reverse])
    return (
        _means(angle[forward], value[forward])[both] - _means(angle[reverse], value[reverse])[both],
        _means(angle[forward], dwells.sequence[forward])[both] - _means(angle[reverse], dwells.sequence[reverse])[both],
    )


def _means(group: NDArray[np.int_], value: Array) -> Array:
    """Mean of `value` by the number of its group; 0 for a number without a value."""
    return np.asarray(np.bincount(group, value) / np.maximum(np.bincount(group), 1))


def _same_angle(angle_deg: Array) -> NDArray[np.int_]:
    """Numbers (n,) of the angles, from the smallest up; equal for dwells at one angle."""
    order = np.argsort(angle_deg)
    number = np.zeros(len(angle_deg), dtype=np.int_)
    apart = np.diff(angle_deg[order]) > SAME_ANGLE * np.ptp(angle_deg) if len(angle_deg) else []
    number[order[1:]] = np.cumsum(apart)
    return number


def _pattern(dwells: SweepRecord, residuals: Array) -> SpectralLine | None:
    """A regular pattern of the residuals over the angle, beside a cubic, which a sensor may have."""
    mean_v = _means(_same_angle(dwells.angle_deg), residuals)
    place = np.linspace(-1, 1, len(mean_v))
    if len(mean_v) < 2 * LEAST_ANGLES or np.ptp(mean_v) <= _rounding(dwells):
        return None
    cubic = np.polynomial.polynomial.polyfit(place, mean_v, 3)
    return conspicuous_line(mean_v - np.polynomial.polynomial.polyval(place, cubic))


def _rounding(dwells: SweepRecord) -> float:
    """Differences (V) that are nothing but rounding."""
    return 64 * float(np.finfo(np.float64).eps * np.max(np.abs(dwells.output_v)))
