"""Range tests of recorded cases: their blocks become those of a run, and each point is judged (equations 5.2, 5.4, 9).

An error is judged against a fraction of the reading or of the full scale. A point whose table did not do what it was
told is not judged, and a test with such a point, or with a block that is missing, has no verdict.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from bench.methods.rate_table.reduction.bias_at_rest import RestReading
from bench.methods.rate_table.reduction.blocks import TableRecord, cut_into_blocks
from bench.methods.rate_table.reduction.radius import LEAST_LOW_RATES, Arm, RangeError, gyro_error
from bench.methods.rate_table.reduction.range_points import RangeBlocks, Turning
from bench.methods.rate_table.reduction.recorded_samples import recorded_samples
from bench.methods.rate_table.reduction.samples import steady
from bench.metrology.results.coverage import coverage_factor

BIAS = "bias"


@dataclass(frozen=True, slots=True)
class LinearityLimit:
    """The largest error: a fraction of the reading, or of `full_scale` where that is given."""

    fraction: float
    full_scale: float | None = None

    def limit(self, reading: float) -> float:
        """The largest error of a `reading`, in its unit."""
        return self.fraction * abs(self._basis(reading))

    def relative(self, error: float, reading: float) -> float | None:
        """The error of a `reading` over what the fraction is of, with its sign; None of a reading of 0."""
        basis = self._basis(reading)
        return error / basis if basis else None

    def _basis(self, reading: float) -> float:
        return reading if self.full_scale is None else self.full_scale


@dataclass(frozen=True, slots=True)
class RangePoint:
    """One rate. `error` = measured - bias - true, in the unit of the sensor, as are `mean` (with bias) and `true`.

    `relative_error` is the error over what the limit is a fraction of: the true value, or the full scale.
    `dof` are the effective degrees of freedom of `u_error`, None for unlimited. What depends on a bias or a radius that
    is not known is None. `passed` is None where the point is not judged.
    """

    phase: str
    mean: float
    rate_dps: float
    saturated: bool
    stable: bool = True
    true: float | None = None
    error: float | None = None
    u_error: float | None = None
    dof: int | None = None
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
    flags: tuple[str, ...]
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
        point = replace(_point(turning, error), true=turning.steady.rate_dps, stable=turning.on_rate(rate_tolerance))
        points.append(_judged(point, linearity))
    return _test(blocks, points, excluded)


def accelerometer_range(
    record: TableRecord, local_g_mps2: float, linearity: LinearityLimit, *, clip_g: float | None = None
) -> RangeTest:
    """Errors of an accelerometer on an arm, in g, against ω²r with the r that it found itself at low rates.

    `record.block` is "bias" (table at rest), "low1", "low2", ... (rates up to 1 g) or "run1", ...; `record.table` is
    the cumulative angle in degrees, `record.output` in g. The radius needs two low rates.
    """
    phases = np.unique(record.block).tolist()
    blocks, excluded = recorded_blocks(record, {BIAS, *_matching(phases, "low"), *_matching(phases, "run")}, clip_g)
    low = [turning.steady for turning in _of_kind(blocks, "low") if turning.steady.rate_dps]
    arm = Arm(blocks.bias, low, local_g_mps2) if blocks.rest and low else None
    if len(low) < LEAST_LOW_RATES:
        blocks.flags.append("too_few_low_rates")
    elif arm and arm.is_uncertain:
        blocks.flags.append("radius_not_determined")
    points = [_point(turning, arm.error(turning.steady) if arm else None) for turning in _of_kind(blocks, "run")]
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
    usable = set()
    blocks = cut_into_blocks(at_rest, excluded)
    for phase in sorted(blocks, key=_order):
        samples = recorded_samples(phase, blocks[phase], excluded, clip)
        if samples is None:
            continue
        usable.add(phase)
        read = steady(samples, 1.0, clip)
        if phase == BIAS:
            resting.append(RestReading(0.0, 0.0, read.output, read.u_output, read.dof))
        else:
            command_dps = (commands_dps or {}).get(phase, read.rate_dps)
            turning.append((0.0, Turning(phase, command_dps, read, 0.0, samples.temperature_c)))
    found.settle(resting, turning)
    found.flags += [f"{phase} invalid" for phase in sorted(wanted, key=_order) if phase not in usable]
    return found, dict(excluded)


def _of_kind(blocks: RangeBlocks, kind: str) -> list[Turning]:
    return [turning for turning in blocks.turning if _order(turning.step)[0] == kind]


def _point(turning: Turning, error: RangeError | None) -> RangePoint:
    """A point before it is judged."""
    point = RangePoint(turning.step, turning.steady.output, turning.steady.rate_dps, turning.steady.saturated)
    if error is None:
        return point
    return replace(point, true=error.true, error=error.value, u_error=error.u, dof=error.dof)


def _judged(point: RangePoint, linearity: LinearityLimit) -> RangePoint:
    if point.error is None or point.u_error is None or point.true is None:
        return point
    relative = linearity.relative(point.error, point.true)
    if not point.stable:
        return replace(point, relative_error=relative)
    room = linearity.limit(point.true) - abs(point.error)
    passed, marginal = room >= 0 and not point.saturated, abs(room) < coverage_factor(point.dof) * point.u_error
    return replace(point, relative_error=relative, passed=passed, marginal=marginal)


def _test(blocks: RangeBlocks, points: list[RangePoint], excluded: dict[str, int]) -> RangeTest:
    invalid = bool(blocks.flags) or not points or any(point.passed is None for point in points)
    return RangeTest(
        bias=blocks.rest.value if blocks.rest else None,
        points=tuple(points),
        passed=None if invalid else all(point.passed for point in points),
        flags=(*blocks.flags, "invalid") if invalid else (),
        notes=tuple(
            f"{point.phase} is marginal: its limit is within the expanded uncertainty of its error"
            for point in points
            if point.marginal
        ),
        excluded=excluded,
    )


def _matching(phases: Iterable[str], kind: str) -> set[str]:
    return {phase for phase in phases if re.fullmatch(rf"{kind}[0-9]+", phase)}


def _order(phase: str) -> tuple[str, int]:
    """Of phases: by kind, then by number."""
    kind = phase.rstrip("0123456789")
    return kind, int(phase[len(kind) :] or 0)
