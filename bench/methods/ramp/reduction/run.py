"""Method M4b: bias on temperature ramps without soaks (equations 6.3).

The output at 0 g differs from K0 by the misalignment of the input axis, a constant; its changes are those of K0. The
scale factor is from the same run, from its 0 g and 1 g parts. The temperature is that of the unit's thermometer.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.methods.ramp.reduction.budget import RampBudget
from bench.methods.ramp.reduction.characteristic import UG_PER_G, DynamicCharacteristic, RampLimits
from bench.methods.ramp.reduction.findings import RampFindings
from bench.methods.ramp.reduction.reduced import ReducedRamp
from bench.methods.ramp.reduction.samples import RampLeg, cut_into_samples
from bench.metrology.least_squares import Array, NotDetermined
from bench.metrology.orientation import elevation_rad
from bench.metrology.results.coverage import COVERAGE
from bench.metrology.results.finding import UnitResult
from bench.metrology.results.flag import Flag, samples_left_out
from bench.metrology.run_data import RunData, UnitUnderTest
from bench.metrology.unlike_nominal import flags_of_scale

LEVEL_BELOW_G = 0.5  # gravity along the input axis, below which a leg is of the 0 g part, else of the 1 g part
SAME_ANGLE_RAD = 1e-4


@dataclass(frozen=True, slots=True)
class LegCurve:
    """A leg of a temperature ramp for the report, (n,) in time order; jumps by their temperatures."""

    cycle: int
    rising: bool
    temperature_c: Array
    output_g: Array
    residual_g: Array
    jumps_c: tuple[float, ...]


def reduce(data: RunData, settings: Mapping[str, Any]) -> list[UnitResult]:
    """Reduce a run to the findings and models of every unit.

    `settings` has the duration of a sample, the minimum size of a jump, the number of samples on either side for its
    fit, and the standard uncertainty of the misalignment.
    """
    return [_reduced(data, unit, settings) for unit in data.units]


def _reduced(data: RunData, unit: UnitUnderTest, settings: Mapping[str, Any]) -> UnitResult:
    level, upright, left_out, flags = parts_of(data, unit, settings["sample_s"])
    limits = RampLimits(settings["jump_threshold_g"] * UG_PER_G, settings["jump_window"])
    try:
        ramp = ReducedRamp.of(level, upright, limits) if level and upright else None
    except NotDetermined:
        flags.append(Flag("ill_conditioned", of="K0"))
        ramp = None
    if ramp is None:
        return UnitResult(unit.place, unit.serial, (), (), left_out, tuple(flags))
    found = ramp.found
    if found.excluded["thermometer"]:
        flags.append(samples_left_out("thermometer", found.excluded["thermometer"]))
    incomplete = {(leg.cycle, leg.name) for leg in found.legs if not leg.complete}
    lost = [leg.path for leg in level if (leg.cycle, leg.name) in incomplete]
    flags += [Flag("leg_incomplete", at=path) for path in lost]
    left_out = (*left_out, *lost)
    k1 = float(ramp.scale.line.coefficients[0])
    flags += flags_of_scale(k1, COVERAGE * abs(k1) * settings["misalignment_u_rad"], unit)
    findings = RampFindings(RampBudget(data, unit, ramp, settings["misalignment_u_rad"]))
    return UnitResult(
        place=unit.place,
        uut=unit.serial,
        findings=tuple(findings.findings()),
        models=tuple(findings.models(left_out)),
        left_out=left_out,
        flags=tuple(flags),
        detail=tuple(_curves(found)),
        compensations=(findings.compensation(),),
    )


def parts_of(
    data: RunData, unit: UnitUnderTest, sample_s: float
) -> tuple[list[RampLeg], list[RampLeg], tuple[str, ...], list[Flag]]:
    """Legs of a unit at 0 g and at 1 g, each at one angle, the paths of those left out, and the reasons."""
    legs, left_out, flags = _legs(data, unit, sample_s)
    level = _at_first_angle([leg for leg in legs if _is_level(leg)])
    upright = _at_first_angle([leg for leg in legs if not _is_level(leg)])
    flags += [Flag("another_angle", at=leg.path) for leg in legs if not any(leg is used for used in (*level, *upright))]
    flags += [Flag("part_missing", at=name) for name, part in (("0 g", level), ("1 g", upright)) if not part]
    return level, upright, left_out, flags


def _legs(data: RunData, unit: UnitUnderTest, sample_s: float) -> tuple[list[RampLeg], tuple[str, ...], list[Flag]]:
    """Legs of a unit, and the number left out for each reason."""
    legs, left_out, flags = [], [], []
    for acquisition in data.acquisitions:
        leg = cut_into_samples(acquisition, unit, elevation_rad(acquisition, unit, data.bench), sample_s)
        flags += [samples_left_out(problem, count, leg.step) for problem, count in leg.problems.items()]
        if leg.direction and len(leg.without_turns().time_s):
            legs.append(leg)
        else:
            left_out.append(leg.path)
            flags.append(Flag("leg_incomplete" if leg.direction else "not_one_leg", at=leg.path))
    return legs, tuple(left_out), flags


def _is_level(leg: RampLeg) -> bool:
    return bool(abs(np.sin(leg.angle_rad)) < LEVEL_BELOW_G)


def _at_first_angle(legs: Sequence[RampLeg]) -> list[RampLeg]:
    """Legs at the angle of the first: the method uses one position (equations 6.3)."""
    return [leg for leg in legs if np.isclose(leg.angle_rad, legs[0].angle_rad, rtol=0, atol=SAME_ANGLE_RAD)]


def _curves(found: DynamicCharacteristic) -> Iterator[LegCurve]:
    for leg, residuals_ug in zip(found.legs, found.residuals_ug, strict=True):
        jumps_c = [jump.temperature_c for jump in found.jumps if (jump.cycle, jump.leg) == (leg.cycle, leg.name)]
        yield LegCurve(
            leg.cycle, leg.name == "up", leg.temperature_c, leg.output_g, residuals_ug / UG_PER_G, tuple(jumps_c)
        )
