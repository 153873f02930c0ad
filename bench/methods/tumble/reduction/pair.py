"""Tilt by two accelerometers in a tumble: their readings at each position and dwell brought together (6.4)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from bench.methods.tumble.reduction.dwells import Dwell, axis_rad
from bench.methods.tumble.reduction.unit import TumbleUnit
from bench.metrology.acquisition import Array
from bench.metrology.bench_uncertainty import TiltPairRecord
from bench.metrology.calibration.temperature import Compensation
from bench.metrology.common_errors import OverTemperature, head_harmonics, level_drift, thermometer_errors
from bench.metrology.orientation import by_harmonics
from bench.metrology.results.budget import common
from bench.metrology.results.finding import Finding
from bench.metrology.run_data import RunData, UnitUnderTest
from bench.metrology.tilt_pair import CONSTANT, STATIC, PairReadings, TiltOfTwo, is_square

Verified = tuple[TumbleUnit, Compensation]
SAME_ANGLE_DIGITS = 3


@dataclass(frozen=True)
class _Common:
    """Readings of both units in the same acquisitions at one angle of one dwell; their indices in each dwell."""

    first: int
    second: int
    in_first: Array
    in_second: Array
    angle_rad: float


def tilt_in_tumble(
    data: RunData, pair: TiltPairRecord, _units: tuple[UnitUnderTest, UnitUnderTest], of: tuple[Verified, Verified]
) -> TiltOfTwo | None:
    """Means of the readings at each angle and dwell; None if the axes are not at right angles, or none is common.

    The skew between both axes is that which the tumble finds, if it does.
    """
    (along, _), (across, _) = of
    skew = skew_between(pair, along, across)
    if skew is not None:
        pair = pair._replace(skew_rad=skew.value, skew_u_rad=skew.u)
    along_rad, across_rad = (axis_rad(data.acquisitions, each.unit, data.bench).tolist() for each in (along, across))
    by_step = {each.step: angle_rad for each, angle_rad in zip(data.acquisitions, along_rad, strict=True)}
    found = list(_common(along, across, by_step))
    if not found or not all(is_square(*each) for each in zip(along_rad, across_rad, strict=True)):
        return None
    angle_rad = np.array([each.angle_rad for each in found])
    repeats = np.array([len(each.in_first) for each in found])
    nothing = np.zeros(len(found))
    base = PairReadings(*_forces(of, found), nothing)
    changed = []
    for number, (unit, _) in enumerate(of):
        for line, error in thermometer_errors(data, unit.unit.temperature):
            changed.append((line, PairReadings(*_forces(of, found, number, error), nothing)))
    changed += [(line, base._replace(raised_rad=rad)) for line, rad in head_harmonics(data.bench, angle_rad)]
    line, level_rad = level_drift(data)
    at_s = np.array([along.dwells[each.first].middle_s for each in found])
    changed.append((line, base._replace(raised_rad=level_rad(at_s))))
    own_u_g = tuple(unit.sd / np.abs(np.mean(unit.values("K1"))) / np.sqrt(repeats) for unit, _ in of)
    turned_rad = np.radians(data.bench.head.repeatability_u_deg) / np.sqrt(repeats)
    return TiltOfTwo(
        along.subject, pair, (along.root,), angle_rad, base, changed, (own_u_g[0], own_u_g[1]), turned_rad, skew
    )


def _common(along: TumbleUnit, across: TumbleUnit, angles_rad: dict[str, float]) -> Iterator[_Common]:
    """Angles of the dwells of both at which they were read together."""
    dwells = {dwell.group: number for number, dwell in enumerate(across.dwells)}
    for number, dwell in enumerate(along.dwells):
        if dwell.group not in dwells:
            continue
        second = dwells[dwell.group]
        others = {step: index for index, step in enumerate(across.dwells[second].steps)}
        at: dict[float, list[tuple[int, int]]] = {}
        for index, step in enumerate(dwell.steps):
            if step in others:
                at.setdefault(round(float(np.degrees(angles_rad[step])), SAME_ANGLE_DIGITS), []).append(
                    (index, others[step])
                )
        for angle_deg, indices in at.items():
            mine, theirs = np.array(indices).T
            yield _Common(number, second, mine, theirs, float(np.radians(angle_deg)))


def _forces(
    of: tuple[Verified, Verified], found: list[_Common], erring: int = -1, error: OverTemperature | None = None
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Forces of both (n,) by way of conversion; the thermometer of the `erring` one has an error."""
    of_first = [(each.first, each.in_first) for each in found]
    of_second = [(each.second, each.in_second) for each in found]
    first, second = (
        _of_one(*verified, chosen, error if erring == number else None)
        for number, (verified, chosen) in enumerate(zip(of, (of_first, of_second), strict=True))
    )
    return first, second


def _of_one(
    unit: TumbleUnit, known: Compensation, chosen: list[tuple[int, Array]], error: OverTemperature | None
) -> dict[str, Array]:
    """Forces of one unit (n,) at the temperatures that its thermometer states, which may have an error.

    So the forces by constants are also those of the unit at the stated temperatures.
    """
    readings = np.array([np.mean(unit.dwells[dwell].readings[indices]) for dwell, indices in chosen])
    at_c = np.array([unit.dwells[dwell].temperature_c for dwell, _ in chosen])
    mean_c = np.full(len(at_c), np.mean(unit.temperatures_c))
    constant, static = known.apply(readings, mean_c)[0], known.apply(readings, at_c)[0]
    if error is None:
        return {CONSTANT: constant, STATIC: static}
    read_c = at_c + error(np.array([unit.dwells[dwell].middle_s for dwell, _ in chosen]), at_c)
    moved = known.apply(readings, read_c)[0]
    return {CONSTANT: constant + moved - static, STATIC: moved}


def skew_between(pair: TiltPairRecord, along: TumbleUnit, across: TumbleUnit) -> Finding | None:
    """Skew between both axes: the misalignment of the second less that of the first, a mean over the dwells.

    The zero of the head and the level of the fixture are in both alike.
    """
    both = [
        (dwell, other) for dwell in along.dwells for other in across.dwells
        if dwell.group == other.group and "misalignment" in dwell.values and "misalignment" in other.values
    ]  # fmt: skip
    if not both:
        return None
    skew = np.array([other.values["misalignment"] - dwell.values["misalignment"] for dwell, other in both])
    u_deg = along.bench.head.harmonics_u_deg
    harmonics = np.mean([_turned(other, u_deg) - _turned(dwell, u_deg) for dwell, other in both], axis=0)
    lines = [
        line._replace(source=f"{unit.unit.place}: {line.source}")
        for unit, number in ((along, 0), (across, 1))
        for line in unit.own("misalignment", [(each[number], 1 / len(both)) for each in both])
    ]
    lines = [*lines, common("head: harmonics", float(np.linalg.norm(harmonics)))]
    return along.subject.finding(
        "tilt_of_two/skew", "angle between the input axes of both beyond 90°, a mean over the dwells",
        float(np.mean(skew)), "rad", lines, {"across": pair.across}, (along.root,),
    )  # fmt: skip


def _turned(dwell: Dwell, u_deg: tuple[float, ...]) -> Array:
    """Contributions of the harmonics of the head to the misalignment of one unit in a dwell."""
    return by_harmonics(dwell.gain_of("misalignment") * dwell.turn, dwell.head_rad, u_deg)
