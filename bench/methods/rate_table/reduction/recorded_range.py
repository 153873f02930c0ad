"""Range tests of recorded cases: their blocks become those of a run, and each point is judged (equations 5.2, 5.4, 9).

An error is judged against a fraction of the reading or of the full scale. A point at which the table did not
turn as commanded is not judged. A test with such a point, or with a missing block, has no verdict.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.methods.rate_table.reduction.bias_at_rest import RestReading
from bench.methods.rate_table.reduction.blocks import Block, TableRecord, coarseness, cut_into_blocks
from bench.methods.rate_table.reduction.radius import LEAST_LOW_RATES, Arm, RangeError, gyro_error
from bench.methods.rate_table.reduction.range_points import RangeBlocks, Turning
from bench.methods.rate_table.reduction.samples import TURN_DEG, TableSamples, is_saturated, steady, summed_up
from bench.methods.rate_table.reduction.sampling import instantaneous
from bench.methods.rate_table.reduction.temperatures import MeanTemperature
from bench.metrology.least_squares import Array, GatedFit, NotDetermined, reject_outliers
from bench.metrology.results.coverage import coverage_factor
from bench.metrology.results.flag import INVALID, Flag

BIAS = "bias"
HARMLESS = 1e-5  # of the angle turned to either side of its middle; what is less moves the rate by less
BLOCK_INVALID = "{block} invalid"
TOO_FEW_LOW_RATES, RADIUS_NOT_DETERMINED = "too_few_low_rates", "radius_not_determined"


@dataclass(frozen=True, slots=True)
class LinearityLimit:
    """The largest error: a fraction of the true value, or of `full_scale` where that is given."""

    fraction: float
    full_scale: float | None = None


@dataclass(frozen=True, slots=True)
class RangePoint:
    """One rate. `error` is None where the bias or the radius is not known.

    `relative_error` is the error over what the limit is a fraction of, with its sign; None over 0. `passed` is None
    where the point is not judged.
    """

    turning: Turning
    error: RangeError | None
    stable: bool = True
    relative_error: float | None = None
    passed: bool | None = None
    marginal: bool = False


@dataclass(frozen=True, slots=True)
class RangeTest:
    """Points by number. `passed` is None in a test that is invalid; `excluded` counts samples by reason.

    Flags: `<phase> invalid` for a block that cannot be used, `too_few_low_rates`, `radius_not_determined`, `invalid`.
    `notes` name the points whose limit is within the expanded uncertainty of the error: those are marginal.
    """

    bias: float | None
    points: tuple[RangePoint, ...]
    passed: bool | None
    flags: tuple[Flag, ...]
    notes: tuple[str, ...]
    excluded: dict[str, int]
    radius_m: float | None = None
    u_radius_m: float | None = None


def gyro_range(
    record: TableRecord,
    commands_dps: Mapping[str, float],
    linearity: LinearityLimit,
    *,
    clip_dps: float | None = None,
    rate_tolerance: float = 0.01,
) -> RangeTest:
    """Errors of a gyro, in deg/s, at each of `commands_dps`, which are named as the blocks of the record.

    `record.block` is "bias" (table at rest) or one of the commands, `record.table` the cumulative angle in degrees,
    `record.output` in deg/s. A table rate that differs from the command by more than `rate_tolerance` of it is not
    stable, and the point not judged.
    """
    blocks, excluded = recorded_blocks(record, {BIAS, *commands_dps}, clip_dps, commands_dps)
    points = []
    for turning in _of_kind(blocks, "run"):
        error = gyro_error(turning.steady, blocks.bias) if blocks.rest else None
        points.append(_judged(RangePoint(turning, error, turning.on_rate(rate_tolerance)), linearity))
    return _test(blocks, points, excluded)


def accelerometer_range(
    record: TableRecord, local_g_mps2: float, linearity: LinearityLimit, *, clip_g: float | None = None
) -> RangeTest:
    """Errors of an accelerometer on an arm, in g, against ω²r with the r that it found itself at low rates.

    `record.block` is "bias" (table at rest), "low1", "low2", ... (rates up to 1 g) or "run1", ...; `record.table` is
    the cumulative angle in degrees, `record.output` in g. The radius needs two low rates.
    """
    blocks, excluded = recorded_blocks(record, {BIAS, *np.unique(record.block).tolist()} - {""}, clip_g)
    low = [turning.steady for turning in _of_kind(blocks, "low") if turning.steady.rate_dps]
    arm = Arm(blocks.bias, low, local_g_mps2) if blocks.rest and low else None
    if len(low) < LEAST_LOW_RATES:
        blocks.flags.append(Flag(TOO_FEW_LOW_RATES))
    elif arm and arm.is_uncertain:
        blocks.flags.append(Flag(RADIUS_NOT_DETERMINED))
    points = [RangePoint(each, arm.error(each.steady) if arm else None) for each in _of_kind(blocks, "run")]
    test = _test(blocks, [_judged(point, linearity) for point in points], excluded)
    return replace(test, radius_m=arm.radius_m, u_radius_m=arm.u_radius_m) if arm else test


def recorded_blocks(
    record: TableRecord, wanted: Collection[str], clip: float | None, commands_dps: Mapping[str, float] | None = None
) -> tuple[RangeBlocks, dict[str, int]]:
    """The blocks of a record as those of a run, by number, and how many samples were left out, by reason.

    Those of `wanted` that are not usable are flagged. A rate that nothing commanded is its own command. The only block
    at rest tells the bias, whatever its encoder says.
    """
    at_rest = replace(record, table=np.where(record.block == BIAS, 0.0, record.table))
    excluded: Counter[str] = Counter()
    found, resting, turning = RangeBlocks(), [], []
    blocks = cut_into_blocks(at_rest, excluded)
    for phase in sorted(blocks, key=_order):
        samples = recorded_samples(phase, blocks[phase], excluded, clip)
        if samples is None:
            continue
        read = steady(samples, 1.0, clip)
        if phase == BIAS:
            resting.append(RestReading(0.0, 0.0, read.output, read.u_output, read.dof))
        else:
            command_dps = (commands_dps or {}).get(phase, read.rate_dps)
            turning.append((0.0, Turning(phase, command_dps, read, 0.0, samples.temperature_c)))
    found.settle(resting, turning)
    usable = {each.step for each in found.turning} | ({BIAS} if resting else set())
    lost = [phase for phase in sorted(wanted, key=_order) if phase not in usable]
    found.flags += [Flag(BLOCK_INVALID, values={"block": phase}) for phase in lost]
    return found, dict(excluded)


def _of_kind(blocks: RangeBlocks, kind: str) -> list[Turning]:
    return [turning for turning in blocks.turning if _order(turning.step)[0] == kind]


def _judged(point: RangePoint, linearity: LinearityLimit) -> RangePoint:
    error = point.error
    if error is None:
        return point
    basis = error.true if linearity.full_scale is None else linearity.full_scale
    point = replace(point, relative_error=error.value / basis if basis else None)
    if not point.stable:
        return point
    room = linearity.fraction * abs(basis) - abs(error.value)
    passed = room >= 0 and not point.turning.steady.saturated
    return replace(point, passed=passed, marginal=abs(room) < coverage_factor(error.dof) * error.u)


def _test(blocks: RangeBlocks, points: list[RangePoint], excluded: dict[str, int]) -> RangeTest:
    invalid = bool(blocks.flags) or not points or any(point.passed is None for point in points)
    return RangeTest(
        bias=blocks.rest.value if blocks.rest else None,
        points=tuple(points),
        passed=None if invalid else all(point.passed for point in points),
        flags=(*blocks.flags, Flag(INVALID)) if invalid else (),
        notes=tuple(
            f"{point.turning.step} is marginal: its limit is within the expanded uncertainty of its error"
            for point in points
            if point.marginal
        ),
        excluded=excluded,
    )


def _order(phase: str) -> tuple[str, int]:
    """Of phases: by kind, then by number."""
    kind = phase.rstrip("0123456789")
    return kind, int(phase[len(kind) :] or 0)


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
