"""Tilt by two accelerometers on a ramp: their legs brought together, one at 0 g while the other is at 1 g (6.4)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bench.methods.ramp.reduction.left import LeftErrors, LeftOnRamp, PartOfRamp
from bench.metrology.bench_uncertainty import TiltPairRecord
from bench.metrology.common_errors import head_harmonics, level_drift, thermometer_errors
from bench.metrology.least_squares import Array
from bench.metrology.run_data import RunData, UnitUnderTest
from bench.metrology.tilt_pair import PairReadings, TiltOfTwo, is_square

NO_ERRORS = LeftErrors()
Matched = list[tuple[PartOfRamp, int, PartOfRamp, int]]  # part and leg of the one, and of the other, at one time


def tilt_on_ramp(
    data: RunData, pair: TiltPairRecord, units: tuple[UnitUnderTest, UnitUnderTest], of: tuple[LeftOnRamp, LeftOnRamp]
) -> TiltOfTwo | None:
    """Readings of a pair on all legs that both have; None if their axes are not at right angles, or none is common."""
    matched = list(_matched(*of))
    if not matched or not all(is_square(part.angle_rad, other.angle_rad) for part, _, other, _ in matched):
        return None
    at_s = np.concatenate([part.legs[index].time_s for part, index, _, _ in matched])
    angle_rad = np.concatenate([np.full(len(part.legs[index].time_s), part.angle_rad) for part, index, _, _ in matched])
    nothing = np.zeros(len(at_s))
    base = PairReadings(*_forces(of, matched, (NO_ERRORS, NO_ERRORS)), nothing)
    changed = []
    for number, unit in enumerate(units):
        for line, error in thermometer_errors(data, unit.temperature):
            errors = (LeftErrors(error), NO_ERRORS) if number == 0 else (NO_ERRORS, LeftErrors(error))
            changed.append((line, PairReadings(*_forces(of, matched, errors), nothing)))
    changed += [(line, base._replace(raised_rad=rad)) for line, rad in head_harmonics(data.bench, angle_rad)]
    line, level_rad = level_drift(data)
    changed.append((line, base._replace(raised_rad=level_rad(at_s))))
    own_u_g = tuple(np.full(len(at_s), each.scatter_g) for each in of)
    steps = tuple(each.step for each in data.acquisitions)
    return TiltOfTwo(data.subject(units[0]), pair, steps, angle_rad, base, changed, (own_u_g[0], own_u_g[1]), nothing)


def _matched(along: LeftOnRamp, across: LeftOnRamp) -> Iterator[tuple[PartOfRamp, int, PartOfRamp, int]]:
    """Legs of both at the same time: their parts have opposite names, as they are at right angles."""
    for part, other in ((along.level, across.upright), (along.upright, across.level)):
        numbers = {(leg.cycle, leg.name): index for index, leg in enumerate(other.legs)}
        for index, leg in enumerate(part.legs):
            if (leg.cycle, leg.name) in numbers:
                yield part, index, other, numbers[leg.cycle, leg.name]


def _forces(
    of: tuple[LeftOnRamp, LeftOnRamp], matched: Matched, errors: tuple[LeftErrors, LeftErrors]
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Forces of both (n,) by way of conversion, those of the second at the times of the first."""
    along: dict[str, list[Array]] = {}
    across: dict[str, list[Array]] = {}
    for part, index, other, number in matched:
        mine, others = of[0].forces_g(part, index, errors[0]), of[1].forces_g(other, number, errors[1])
        at_s, other_s = part.legs[index].time_s, other.legs[number].time_s
        for way, force_g in mine.items():
            along.setdefault(way, []).append(force_g)
            across.setdefault(way, []).append(np.interp(at_s, other_s, others[way]))
    return (
        {way: np.concatenate(each) for way, each in along.items()},
        {way: np.concatenate(each) for way, each in across.items()},
    )
