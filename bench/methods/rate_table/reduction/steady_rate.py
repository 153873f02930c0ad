"""A sensor on a table that turns at a constant rate: mean output and table rate of one block (equations 5.2, 5.4)."""

from __future__ import annotations

from collections import Counter
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from bench.methods.rate_table.reduction.blocks import Block, coarseness
from bench.metrology.least_squares import Array, GatedFit, NotDetermined, reject_outliers

PARTS = 40  # parts of a block, whose means give the uncertainty of the mean of the block
AT_CLIP = (1 - 1e-4, 1 + 1e-2)  # of the clip level: rounding, or a level known inaccurately; beyond is a glitch
SATURATED = 0.01  # share of the samples
HARMLESS = 1e-5  # of the angle turned to either side of its middle; smaller changes affect the rate by less


@dataclass(frozen=True, slots=True)
class Steady:
    """Mean output in its unit and mean table rate in deg/s, with standard uncertainties, type A.

    `dof` are the degrees of freedom of that of the output.
    """

    output: float
    u_output: float
    rate_dps: float
    u_rate_dps: float
    saturated: bool
    dof: int


def steady(block: Block, excluded: Counter[str], *, clip: float | None = None) -> Steady | None:
    """Means over `block`, whose table angles are in degrees and cumulative; None when the block is invalid.

    The rate is the slope of the angle. If the table made a turn or more the output is averaged over whole turns, so
    that effects of the attitude cancel. `saturated`: more than 1 % of the samples are at ±`clip`.
    """
    if not block.complete:
        return None
    time_s = block.time_s - np.mean(block.time_s)
    saturated = clip is not None and _share_at(clip, block.output) > SATURATED
    harmless = HARMLESS * np.array([0.0, np.ptp(time_s) / 2])
    angle = reject_outliers(np.column_stack([np.ones_like(time_s), time_s]), block.table, harmless=harmless)
    rate_dps = float(angle.fit.coefficients[1])
    # If most samples are at the clip level, the good ones look like outliers.
    resolution = np.inf if saturated else coarseness(block.output)
    mean = _mean(block.output, rate_dps * (block.time_s - block.time_s[0]), resolution)
    for gated in (angle, mean):
        excluded["outlier"] += len(gated.dropped)
        if gated.excessive:
            return None
    return Steady(
        output=float(mean.fit.coefficients[0]),
        u_output=_u_mean(mean.fit.residuals),
        rate_dps=rate_dps,
        u_rate_dps=float(np.sqrt(angle.fit.covariance[1, 1])),
        saturated=saturated,
        dof=_parts(mean.fit.residuals) - 1,
    )


def _share_at(clip: float, output: Array) -> float:
    low, high = AT_CLIP
    return float(np.mean((np.abs(output) >= low * clip) & (np.abs(output) <= high * clip)))


def _mean(output: Array, turned_deg: Array, resolution: float) -> GatedFit:
    """Fit with the mean as first coefficient, over whole turns with a first harmonic, if there is a turn.

    Samples at only one angle of the table cannot separate the two: then it is the plain mean.
    """
    whole = np.abs(turned_deg) < 360 * np.floor(np.abs(turned_deg[-1]) / 360)
    angle = np.radians(turned_deg[whole])
    if whole.any():
        with suppress(NotDetermined):
            design = np.column_stack([np.ones_like(angle), np.cos(angle), np.sin(angle)])
            return reject_outliers(design, output[whole], resolution=resolution)
    return reject_outliers(np.ones((len(output), 1)), output, resolution=resolution)


def _u_mean(readings: Array) -> float:
    """Standard uncertainty of the mean of `readings` (n,) in time order, whose noise need not be white."""
    parts = _parts(readings)
    means = [float(np.mean(part)) for part in np.array_split(readings, parts)]
    return float(np.std(means, ddof=1) / np.sqrt(parts))


def _parts(readings: Array) -> int:
    """Number of parts for the scatter: each reading by itself if there are few."""
    return PARTS if len(readings) >= 2 * PARTS else len(readings)
