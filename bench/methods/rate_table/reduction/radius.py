"""Range tests on a table: a gyro against the table's rate, an accelerometer against ω²r (equations 5.2 and 5.4).

The limit of an error is a fraction of the reading or of the full scale. A point whose table did not reach its command
is not judged, and a test with such a point, or with a missing block, has no verdict.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from bench.methods.rate_table.reduction.blocks import TableRecord, cut_into_blocks
from bench.methods.rate_table.reduction.steady_rate import Steady, steady
from bench.metrology.results.coverage import coverage_factor, effective_dof

BIAS = "bias"
LEAST_LOW_RATES = 2
LARGEST_U_RADIUS = 0.1  # of the radius; a less certain radius counts as undetermined


@dataclass(frozen=True, slots=True)
class LinearityLimit:
    """Largest permitted error: a fraction of the reading, or of `full_scale` if that is given."""

    fraction: float
    full_scale: float | None = None

    def limit(self, reading: float) -> float:
        """Largest permitted error of a `reading`, in its unit."""
        return self.fraction * abs(self._basis(reading))

    def relative(self, error: float, reading: float) -> float | None:
        """Error of a `reading` relative to the reference of the fraction, with its sign; None for a reading of 0."""
        basis = self._basis(reading)
        return error / basis if basis else None

    def _basis(self, reading: float) -> float:
        return reading if self.full_scale is None else self.full_scale


@dataclass(frozen=True, slots=True)
class RangePoint:
    """One rate. `error` = measured - bias - true, in the unit of the sensor, as are `mean` (with bias) and `true`.

    `relative_error` is relative to the true value or to the full scale, like the limit. `dof` are the effective degrees
    of freedom of `u_error`, None for unlimited. Values that depend on an unknown bias or radius are None. `passed` is
    None if the point is not judged.
    """

    phase: str
    mean: float
    true: float | None
    rate_dps: float
    error: float | None
    u_error: float | None
    passed: bool | None
    marginal: bool
    saturated: bool
    stable: bool
    dof: int | None
    relative_error: float | None = None


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
    blocks = _Blocks(record, {BIAS, *commands_dps}, clip_dps)
    bias = blocks.steady.get(BIAS)
    points = []
    for phase, turning in blocks.numbered("run"):
        point = RangePoint(
            phase=phase, mean=turning.output, true=turning.rate_dps, rate_dps=turning.rate_dps,
            error=turning.output - bias.output - turning.rate_dps if bias else None,
            u_error=_root_sum(turning.u_output, bias.u_output, turning.u_rate_dps) if bias else None,
            passed=None, marginal=False, saturated=turning.saturated, dof=_dof_of_gyro(turning, bias) if bias else None,
            stable=abs(turning.rate_dps - commands_dps[phase]) <= rate_tolerance * abs(commands_dps[phase]),
        )  # fmt: skip
        points.append(_judged(point, linearity))
    return _test(bias, points, blocks)


def accelerometer_range(
    record: TableRecord, local_g_mps2: float, linearity: LinearityLimit, *, clip_g: float | None = None
) -> RangeTest:
    """Errors of an accelerometer on an arm, in g, against ω²r with the r that it determines itself at low rates.

    `record.block` is "bias" (table at rest), "low1", "low2", ... (rates up to 1 g) or "run1", ...; `record.table` is
    the cumulative angle in degrees, `record.output` in g. An input axis that points at the spin axis reads + and has a
    positive radius. The radius needs two low rates. An error of the scale factor is contained in the radius: the errors
    are those of linearity.
    """
    phases = np.unique(record.block).tolist()
    blocks = _Blocks(record, {BIAS, *_matching(phases, "low"), *_matching(phases, "run")}, clip_g)
    bias, low = blocks.steady.get(BIAS), [turning for _, turning in blocks.numbered("low") if turning.rate_dps]
    arm = Arm(bias, low, local_g_mps2) if bias and low else None
    if len(low) < LEAST_LOW_RATES:
        blocks.flags.append("too_few_low_rates")
    elif arm and arm.u_radius_m >= LARGEST_U_RADIUS * abs(arm.radius_m):
        blocks.flags.append("radius_not_determined")
    points = []
    for phase, turning in blocks.numbered("run"):
        point = RangePoint(
            phase=phase, mean=turning.output, true=arm.acceleration_g(turning) if arm else None,
            rate_dps=turning.rate_dps, error=arm.error_g(turning) if arm else None,
            u_error=arm.u_error_g(turning) if arm else None,
            passed=None, marginal=False, saturated=turning.saturated, stable=True,
            dof=arm.dof_error(turning) if arm else None,
        )  # fmt: skip
        points.append(_judged(point, linearity))
    test = _test(bias, points, blocks)
    return replace(test, radius_m=arm.radius_m, u_radius_m=arm.u_radius_m) if arm else test


class _Blocks:
    """Means of all usable blocks; unusable blocks of `wanted` are flagged."""

    def __init__(self, record: TableRecord, wanted: Collection[str], clip: float | None) -> None:
        at_rest = replace(record, table=np.where(record.block == BIAS, 0.0, record.table))  # whatever its encoder reads
        self.excluded: Counter[str] = Counter()
        self.steady: dict[str, Steady] = {}
        for phase, block in cut_into_blocks(at_rest, self.excluded).items():
            turning = steady(block, self.excluded, clip=clip)
            if turning:
                self.steady[phase] = turning
        self.flags = [f"{phase} invalid" for phase in sorted(wanted, key=_order) if phase not in self.steady]

    def numbered(self, kind: str) -> list[tuple[str, Steady]]:
        """Usable blocks of a kind, by number."""
        return [(phase, self.steady[phase]) for phase in sorted(_matching(self.steady, kind), key=_order)]


class Arm:
    """Radius fitted to a = ω²r/g at low rates, weighted by ω⁴; the bias of the sensor is common to all readings.

    All results are linear in the readings a_i and the bias: r = Σ c_i (a_i - bias).
    """

    def __init__(self, bias: Steady, low: Iterable[Steady], local_g_mps2: float) -> None:
        """Fit the radius from the reading at rest and those at low rates, which are not 0."""
        self._bias, self._g = bias, local_g_mps2
        self._low = list(low)
        squares = np.array([np.radians(turning.rate_dps) ** 2 for turning in self._low])
        self._weights = squares * local_g_mps2 / np.sum(squares**2)
        readings_g = np.array([turning.output - bias.output for turning in self._low])
        self.radius_m = float(self._weights @ readings_g)
        # A relative error e of ω_i changes the term i of the sum by 2e, and the denominator by twice that.
        shares = squares**2 / np.sum(squares**2)
        rates = np.array([turning.u_rate_dps / turning.rate_dps for turning in self._low])
        outputs = np.array([turning.u_output for turning in self._low])
        self.u_own_m = _root_sum(*(self._weights * outputs), *(2 * self.radius_m * shares * rates))

    @property
    def u_bias_m(self) -> float:
        """Standard uncertainty of the radius from the bias."""
        return abs(float(np.sum(self._weights))) * self._bias.u_output

    @property
    def u_radius_m(self) -> float:
        """Standard uncertainty of the radius, from the readings alone."""
        return _root_sum(self.u_own_m, self.u_bias_m)

    def acceleration_g(self, turning: Steady) -> float:
        """Expected acceleration at a rate, without bias."""
        return self._per_radius(turning) * self.radius_m

    def error_g(self, turning: Steady) -> float:
        """Difference of the reading from it."""
        return turning.output - self._bias.output - self.acceleration_g(turning)

    def u_error_g(self, turning: Steady) -> float:
        """Standard uncertainty of the error, from the readings alone."""
        return _root_sum(*self.u_parts_g(turning))

    def dof_error(self, turning: Steady) -> int | None:
        """Effective degrees of freedom of the uncertainty of the error; None for unlimited."""
        reading, bias, *others = self.u_parts_g(turning)
        return effective_dof([(reading, turning.dof), (bias, self._bias.dof), *((u, None) for u in others)])

    def u_parts_g(self, turning: Steady) -> tuple[float, float, float, float]:
        """Contributions to the uncertainty of the error: reading, bias, low rates through the radius, table rate.

        An error of the bias changes the reading and, through the radius, the true value.
        """
        by_bias = 1 - self._per_radius(turning) * float(np.sum(self._weights))
        by_rate = 2 * self.acceleration_g(turning) / turning.rate_dps if turning.rate_dps else 0.0
        return (
            turning.u_output, abs(by_bias) * self._bias.u_output, self._per_radius(turning) * self.u_own_m,
            abs(by_rate) * turning.u_rate_dps,
        )  # fmt: skip

    def _per_radius(self, turning: Steady) -> float:
        return float(np.radians(turning.rate_dps) ** 2 / self._g)


def _dof_of_gyro(turning: Steady, bias: Steady) -> int | None:
    return effective_dof([(turning.u_output, turning.dof), (bias.u_output, bias.dof), (turning.u_rate_dps, None)])


def _judged(point: RangePoint, linearity: LinearityLimit) -> RangePoint:
    if point.error is None or point.u_error is None or point.true is None:
        return point
    relative = linearity.relative(point.error, point.true)
    if not point.stable:
        return replace(point, relative_error=relative)
    room = linearity.limit(point.true) - abs(point.error)
    passed, marginal = room >= 0 and not point.saturated, abs(room) < coverage_factor(point.dof) * point.u_error
    return replace(point, relative_error=relative, passed=passed, marginal=marginal)


def _test(bias: Steady | None, points: list[RangePoint], blocks: _Blocks) -> RangeTest:
    invalid = bool(blocks.flags) or not points or any(point.passed is None for point in points)
    return RangeTest(
        bias=bias.output if bias else None,
        points=tuple(points),
        passed=None if invalid else all(point.passed for point in points),
        flags=(*blocks.flags, "invalid") if invalid else (),
        notes=tuple(
            f"{point.phase} is marginal: its limit is within the expanded uncertainty of its error"
            for point in points
            if point.marginal
        ),
        excluded=dict(blocks.excluded),
    )


def _matching(phases: Iterable[str], kind: str) -> set[str]:
    return {phase for phase in phases if re.fullmatch(rf"{kind}[0-9]+", phase)}


def _order(phase: str) -> tuple[str, int]:
    """Sort key of phases: by kind, then by number."""
    kind = phase.rstrip("0123456789")
    return kind, int(phase[len(kind) :] or 0)


def _root_sum(*terms: float) -> float:
    return float(np.sqrt(np.sum(np.square(terms))))
