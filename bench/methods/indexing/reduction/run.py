"""Method M1: scale factor, bias, misalignment and cross coupling from small angles on both ends (equations 3).

Quantities named V are in the unit of the output, V or pulse/s. The clocking measures the whole tilt of the seat,
including those of the head's zero, of the fixture and of the platform: b5 is the part beyond b3 and b4, and b - b3 - b4
- b5 is the bias without any tilt.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.methods.indexing.reduction.calibrate import CalibrationSettings, StaticCalibration, calibrate
from bench.methods.indexing.reduction.estimates import IndexingEstimates
from bench.methods.indexing.reduction.findings import IndexingFindings
from bench.methods.indexing.reduction.readings import (
    Face,
    IndexingReading,
    clocking_arrays,
    readings_of,
    sweep_record,
    usable_clocking,
)
from bench.methods.indexing.reduction.sides import SideFindings
from bench.methods.indexing.reduction.two_ends import Agreement, BothEnds
from bench.methods.indexing.reduction.verification import Verification
from bench.metrology.calibration.temperature import Compensation
from bench.metrology.propagation import Measured
from bench.metrology.results.curves import Constant
from bench.metrology.results.finding import UnitResult
from bench.metrology.results.flag import Flag
from bench.metrology.run_data import RunData, UnitUnderTest

LEAST_FOR_K2_RAD = np.radians(30.0) * 0.999  # smaller angles do not determine K2 and K3: equations 3.4
SMALL_TERMS = ("c0", "c1", "cxz", "delta")
ALL_TERMS = ("c0", "c1", "c2", "c3", "cxz", "delta")


@dataclass(frozen=True, slots=True)
class Attempt:
    """One measurement of both ends; `agrees` is true if their scale factors count as equal."""

    readings: tuple[IndexingReading, ...]
    found: StaticCalibration

    @property
    def agrees(self) -> bool:
        """True if no further attempt is required."""
        return self.found.decision in ("accept", "marginal")


@dataclass(frozen=True, slots=True)
class IndexingDetail:
    """Data for the report: every attempt, and the readings of the verification with their residuals."""

    unit: str
    attempts: tuple[Attempt, ...]
    verification: tuple[IndexingReading, ...]
    residuals_g: tuple[float, ...]


def reduce(data: RunData, settings: Mapping[str, Any]) -> list[UnitResult]:
    """Reduce a run to the findings and equations of every unit, by the settings of the method."""
    return [_reduced(data, unit, settings) for unit in data.units]


def attempts_of(data: RunData, unit: UnitUnderTest, settings: Mapping[str, Any]) -> list[Attempt]:
    """All measurements of both ends; the last one counts."""
    readings, _ = readings_of(data, unit)
    return _attempts(readings, unit, settings)


def _attempts(
    every: Sequence[IndexingReading], unit: UnitUnderTest, settings: Mapping[str, Any], face: Face = "Z"
) -> list[Attempt]:
    """Measurements of both ends, or with the face Y of both sides, which are reduced in the same way."""
    readings = [each for each in every if each.face == face]
    numbers = sorted({each.attempt for each in readings if each.kind == "sweep"})
    clocked = usable_clocking(
        [each for each in every if each.kind == "clocking" and each.face == "Z"], _limit(unit, settings)
    )
    attempts = []
    for number in numbers:
        swept = [each for each in readings if each.kind == "sweep" and each.attempt == number]
        found = calibrate(sweep_record(swept), _settings(swept, unit, settings), clocking_arrays(clocked))
        attempts.append(Attempt(tuple(swept), found))
    return attempts


def _settings(
    swept: Sequence[IndexingReading], unit: UnitUnderTest, settings: Mapping[str, Any]
) -> CalibrationSettings:
    widest_rad = max((abs(each.angle_rad) for each in swept), default=0.0)
    return CalibrationSettings(
        terms=ALL_TERMS if widest_rad >= LEAST_FOR_K2_RAD else SMALL_TERMS,
        agreement=Agreement(settings["scale_tolerance"], settings["k"]),
        outlier_k=settings["outlier_k"],
        output_limit_v=_limit(unit, settings),
    )


def _limit(unit: UnitUnderTest, settings: Mapping[str, Any]) -> float:
    limit_g, per_g = settings["output_limit_g"], unit.nominal_per_g
    return np.inf if limit_g is None or per_g is None else float(limit_g * abs(per_g))


def _reduced(data: RunData, unit: UnitUnderTest, settings: Mapping[str, Any]) -> UnitResult:
    readings, flags = readings_of(data, unit)
    attempts = _attempts(readings, unit, settings)
    if not attempts:
        return UnitResult(unit.place, unit.serial, (), (), ("both ends",), (*flags, Flag("no_sweep")))
    last = attempts[-1]
    limit = _limit(unit, settings)
    clocked = usable_clocking([each for each in readings if each.kind == "clocking" and each.face == "Z"], limit)
    verified = usable_clocking([each for each in readings if each.kind == "verification" and each.face == "Z"], limit)
    platform = settings["platform_rad"]
    known = None if platform is None else Measured(platform, settings["platform_u_rad"])
    estimates = IndexingEstimates(data, unit, last.readings, last.found, clocked, known)
    verification = Verification(data.subject(unit), estimates, verified)
    findings = IndexingFindings(
        data, unit, last.found, estimates, verification, settings["bias_per_c_u"], settings["scale_per_c_u"]
    )
    sides = _sides(data, unit, _attempts(readings, unit, settings, "Y"))
    residuals_g = tuple(verification.residuals_g.tolist())
    detail = IndexingDetail(unit.output_unit, tuple(attempts), tuple(verified), residuals_g)
    left_out = [f"+Z {name}" for name, end in last.found.ends.items() if end is None or end.fit is None]
    return UnitResult(
        place=unit.place,
        uut=unit.serial,
        findings=(*findings.findings(), *(sides.findings() if sides else ())),
        models=tuple(findings.models()),
        left_out=tuple(left_out),
        flags=(
            *flags,
            *_flags(attempts, clocked),
            *(sides.flags() if sides else ()),
            *([Flag("verification:corrected")] if any(each.differs for each in verification.regressions) else []),
        ),
        detail=detail,
        compensations=_compensations(estimates.both, unit),
    )


def _sides(data: RunData, unit: UnitUnderTest, attempts: Sequence[Attempt]) -> SideFindings | None:
    """Results with the unit on its sides, by the last attempt; None if it was not measured there."""
    if not attempts:
        return None
    last = attempts[-1]
    return SideFindings(
        data.subject(unit), last.found, IndexingEstimates(data, unit, last.readings, last.found, (), None)
    )


def _flags(attempts: Sequence[Attempt], clocked: Sequence[IndexingReading]) -> list[Flag]:
    """Flags of the calibration as a whole."""
    found = attempts[-1].found
    both = None not in found.ends.values()
    flags = [Flag(code) for code in found.flags if code != "ill_conditioned" or both]
    flags += [
        Flag(f"{{count}} readings: {why}", values={"count": count})
        for why, count in found.excluded.items()
        if count and why != "unstable"
    ]
    if found.decision == "repeat":
        flags.append(Flag("ends_differ_after:{count}", values={"count": len(attempts)}))
    if not clocked:
        flags.append(Flag("no_clocking"))
    if found.both is not None and "c2" not in found.model.terms:
        flags.append(Flag("K2_K3:range_too_small"))
    return [*flags, *found.notes]


def _compensations(both: BothEnds | None, unit: UnitUnderTest) -> tuple[Compensation, ...]:
    if both is None:
        return ()
    scale = Constant(both.scale.value, f"{unit.output_unit}/g")
    offset = Constant(both.corrected.value, unit.output_unit)
    return (Compensation(unit.measured_by, unit.output_unit, "g", scale=scale, offset=offset),)
