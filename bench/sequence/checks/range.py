"""Rule that no step exceeds the range of a unit: at an angle, on the way there, or by rotation."""

from __future__ import annotations

import math
from collections.abc import Iterator

from bench.config.models import BenchFile
from bench.config.places import PlaceEntry
from bench.sequence.checks.remarks import Found
from bench.sequence.plan.motion import corners_deg
from bench.sequence.plan.plan import Plan
from bench.sequence.plan.poses import poses_before
from bench.sequence.steps.orienting import Pose
from bench.sequence.steps.stimulus import Move, Oscillate, Rotate

RATE, ACCELERATION = "°/s", "g"
UPRIGHT = 0.5  # sine of the angle at 0° from which a channel is not the one that is measured
SAME = 1e-9  # relative; a value exactly at the end of a range is within it


def beyond_unit_range(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """Moves (with their approaches), rates and swings that drive a unit beyond the range of its place."""
    ranges = {name: place for name, place in bench.places.items() if place.range is not None}
    for planned, pose in poses_before(plan, bench) if ranges else ():
        for name, place in ranges.items():
            largest, unit = place.largest_input
            match planned.step:
                case Move() as step if unit == ACCELERATION:
                    most, at_target = _by_gravity(step, bench, place, pose)
                    only_on_the_way = step.approach != "direct" and at_target <= largest
                    key = "approach" if only_on_the_way else "to" if step.to_deg is not None else "by"
                case Rotate() as step:
                    key, most = "at", _while_turning(step.rate_dps, bench, place, unit)
                case Oscillate() as step:
                    key, most = "amplitude", _while_swinging(step, bench, place, unit)
                case _:
                    continue
            if most > largest * (1 + SAME):
                yield (
                    (*planned.place, key),
                    f"it drives the unit in place '{name}' to {most:.4g} {unit}, and its range is ±{largest:g} {unit}",
                    _advice(key),
                )


def _advice(key: str) -> str:
    if key == "approach":
        return "Use approach: direct, or a shorter approach_distance of the axis"
    return "Stay within the range, or correct places.*.range of the bench file"


def _input_deg(head_deg: float, bench: BenchFile, place: PlaceEntry, pose: Pose) -> float:
    """Angle of the input axis above the horizontal, before the unit is clocked."""
    axis, mount = bench.fixture.input_axis, bench.fixture.mount(pose.mount)
    if axis is None:
        return math.nan
    return axis.input_deg(head_deg) + place.mount_angle + mount.angle


def _by_gravity(step: Move, bench: BenchFile, place: PlaceEntry, pose: Pose) -> tuple[float, float]:
    """Largest gravity component (g) along the input axis during a move, excluding its start, and at its end.

    0 on tables with several axes, and for a channel that may be overloaded while another one is measured.
    """
    from_deg = pose.angles_deg.get(step.role, 0.0)
    options = bench.devices[bench.members(step.role)[0]].options
    corners = corners_deg(step.approach, from_deg, step.target_deg(from_deg), options)
    begin, *ends = (_input_deg(each, bench, place, pose) for each in corners)
    low, high = min(begin, *ends), max(begin, *ends)
    if math.isnan(low + high):
        return 0.0, 0.0
    if place.overload and abs(math.sin(math.radians(_input_deg(0.0, bench, place, pose)))) > UPRIGHT:
        return 0.0, 0.0
    clock = abs(math.cos(math.radians(bench.fixture.mount(pose.mount).clock + place.clock)))
    *_, at_target = along = [clock * abs(math.sin(math.radians(each))) for each in ends]
    goes_upright = math.floor((high - 90) / 180) > math.floor((low - 90) / 180)  # the way passes ±90°
    return clock if goes_upright else max(along), at_target


def _while_turning(rate_dps: float, bench: BenchFile, place: PlaceEntry, unit: str) -> float:
    """Largest input of a unit on a rotating table: the rate, or the centripetal acceleration of its arm along x."""
    if unit == RATE:
        return abs(rate_dps)
    along_m = abs(place.arm.x) if place.arm is not None else 0.0
    return math.radians(rate_dps) ** 2 * along_m / bench.site.gravity.value


def _while_swinging(step: Oscillate, bench: BenchFile, place: PlaceEntry, unit: str) -> float:
    """Largest input of a unit on an oscillating table: peak rate, or tangential acceleration of its arm along y."""
    turn_hz = 2 * math.pi * step.highest_hz
    peak_dps = step.amplitude_deg * turn_hz
    if unit == RATE:
        return peak_dps
    across_m = abs(place.arm.y) if place.arm is not None else 0.0
    tangential_g = math.radians(peak_dps) * turn_hz * across_m / bench.site.gravity.value
    return max(tangential_g, _while_turning(peak_dps, bench, place, unit))
