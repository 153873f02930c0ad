"""From a block of a recorded case to samples as those of a run: without outliers, on a table that turns evenly."""

from __future__ import annotations

from collections import Counter
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from bench.methods.rate_table.reduction.blocks import Block, coarseness
from bench.methods.rate_table.reduction.samples import TURN_DEG, TableSamples, is_saturated, summed_up
from bench.methods.rate_table.reduction.sampling import instantaneous
from bench.methods.rate_table.reduction.temperatures import MeanTemperature
from bench.metrology.least_squares import Array, GatedFit, NotDetermined, reject_outliers

HARMLESS = 1e-5  # of the angle turned to either side of its middle; what is less moves the rate by less


def recorded_samples(phase: str, block: Block, excluded: Counter[str], clip: float | None) -> TableSamples | None:
    """The samples of `block`, whose table angles are in degrees and cumulative; None when the block is invalid.

    The encoder of a case has any scatter, so that the rate is the slope of its angle, with the uncertainty of that.
    """
    if not block.complete:
        return None
    time_s = block.time_s - np.mean(block.time_s)
    harmless = HARMLESS * np.array([0.0, np.ptp(time_s) / 2])
    angle = reject_outliers(np.column_stack([np.ones_like(time_s), time_s]), block.table, harmless=harmless)
    rate_dps, u_dps = float(angle.fit.coefficients[1]), float(np.sqrt(angle.fit.covariance[1, 1]))
    saturated = clip is not None and is_saturated(block.output, clip)
    # Where most samples sit at the clip level, the good ones look like outliers.
    resolution = np.inf if saturated else coarseness(block.output)
    output = _gated(block.output, rate_dps * (block.time_s - block.time_s[0]), resolution)
    for gated in (angle, output):
        excluded["outlier"] += len(gated.dropped)
        if gated.excessive:
            return None
    return _samples(phase, block, output.kept, (rate_dps, u_dps))


def _gated(output: Array, turned_deg: Array, resolution: float) -> GatedFit:
    """The samples that are no outliers of their mean, and of what changes once a turn, if there is one.

    Samples that see the table always at one angle cannot separate the two.
    """
    if abs(turned_deg[-1]) >= TURN_DEG:
        angle = np.radians(turned_deg)
        with suppress(NotDetermined):
            design = np.column_stack([np.ones_like(angle), np.cos(angle), np.sin(angle)])
            return reject_outliers(design, output, resolution=resolution)
    return reject_outliers(np.ones((len(output), 1)), output, resolution=resolution)


def _samples(phase: str, block: Block, kept: NDArray[np.bool_], rate: tuple[float, float]) -> TableSamples:
    """Each sample stands for the interval before it; that of the first is as long as is usual.

    `rate` is that of the table with its standard uncertainty, in °/s.
    """
    latch, time_s = np.flatnonzero(kept), block.time_s[kept]
    interval_s = float(np.median(np.diff(time_s) / np.diff(latch)))
    latch, time_s = np.append(latch[0] - 1, latch), np.append(time_s[0] - interval_s, time_s)
    return TableSamples(
        step=phase,
        motion=None,
        temperature=MeanTemperature.of(np.empty(0)),
        time_s=time_s - time_s[0],
        total=summed_up(np.append(0.0, block.output[kept]), latch, time_s),
        angle_deg=rate[0] * (time_s - time_s[0]),
        latch=latch,
        interval_s=interval_s,
        resolution_deg=0.0,
        problems=(),
        sampled=instantaneous,
        rate_u_dps=rate[1],
    )
