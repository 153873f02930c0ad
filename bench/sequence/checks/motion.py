"""Rules on angles of the head and on counting times."""

from __future__ import annotations

import math
from collections.abc import Iterator

from bench.config.document import Place
from bench.config.models import BenchFile
from bench.sequence.checks.remarks import Found
from bench.sequence.plan.plan import Plan
from bench.sequence.plan.poses import poses_before
from bench.sequence.steps.measuring import Acquire
from bench.sequence.steps.orienting import Orient, Pose, Turning, Unreachable
from bench.sequence.steps.stimulus import TURN_DEG, Move
from drivers.quantity.quantities import parse
from drivers.quantity.units import NO_DIMENSION

G = parse("1 g")


def forbidden_angle(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A move that ends in, or passes through, angles at which the fixture would collide."""
    turning = Turning(bench)
    for planned, pose in poses_before(plan, bench) if bench.fixture.forbidden else ():
        step = planned.step
        if isinstance(step, Move):
            from_deg = pose.angles_deg.get(step.role, 0.0)
            target_deg = step.target_deg(from_deg)
        elif isinstance(step, Orient):
            from_deg, target_deg = _outermost(step, bench, turning, pose)
        else:
            continue
        for allowed in bench.fixture.forbidden:
            if _meet(from_deg, target_deg, allowed.min, allowed.max):
                yield (
                    (*planned.place, _target_key(step)),
                    f"the move from {from_deg:g}° to {target_deg:g}° meets {allowed.min:g}° to {allowed.max:g}°, which "
                    "the fixture forbids",
                    "Move in the other direction with 'way', or choose another angle",
                )


def _target_key(step: Move | Orient) -> str:
    return "orient" if isinstance(step, Orient) else "to" if step.to_deg is not None else "by"


def _outermost(step: Orient, bench: BenchFile, turning: Turning, pose: Pose) -> tuple[float, float]:
    """Start and end angle of the outermost axis; None if the attitude is not reached."""
    role = next(iter(bench.axes))
    from_deg = pose.angles_deg.get(role, 0.0)
    try:
        return from_deg, turning.targets_deg(step.attitude, pose)[role]
    except Unreachable:
        return from_deg, math.nan


def _meet(from_deg: float, to_deg: float, low_deg: float, high_deg: float) -> bool:
    """True if a movement and a range of angles, which repeats every turn, have a point in common."""
    begin, end = min(from_deg, to_deg), max(from_deg, to_deg)
    if math.isnan(end):
        return False
    turns = math.ceil((begin - high_deg) / TURN_DEG)
    return low_deg + turns * TURN_DEG <= end


def unreachable_attitude(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """Attitudes that the table cannot reach in the present mount of the units; one message per step."""
    turning, why = Turning(bench), dict[Place, dict[str, str]]()
    for planned, pose in poses_before(plan, bench):
        if isinstance(planned.step, Orient) and planned.waiting is None:
            try:
                turning.targets_deg(planned.step.attitude, pose)
            except Unreachable as problem:
                name = planned.step.attitude.name
                text = str(problem).removeprefix(f"{name} ")
                why.setdefault(planned.place, {}).setdefault(name, text)
    for place, problems in why.items():
        same = [name for name, text in problems.items() if text == next(iter(problems.values()))]
        yield (
            (*place, "orient"),
            f"{', '.join(same)} {next(iter(problems.values()))}",
            "Leave them out, or add a prompt that changes the mount first: expect: {mount: …}",
        )


def short_acquisition(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A counting time below T = 1/(S q), with scale factor S and requested resolution q."""
    for planned in plan:
        step = planned.step
        if not isinstance(step, Acquire) or step.resolution is None or step.duration_s is None:
            continue
        is_ratio = step.resolution.dimension == NO_DIMENSION
        resolution_g = step.resolution.base_value if is_ratio else step.resolution.to("g")
        for name, place in bench.places.items():
            if place.nominal is None or place.nominal.S is None:
                continue
            needed_s = 1 / (abs(place.nominal.S * place.nominal.amperes_per_g) * resolution_g)
            if step.duration_s < needed_s:
                yield (
                    (*planned.place, "for"),
                    f"in {step.duration_s:g} s one count of the unit in place '{name}' is "
                    f"{resolution_g * needed_s / step.duration_s * 1e6:.3g} µg, the resolution asked for is "
                    f"{resolution_g * 1e6:.3g} "
                    "µg",
                    f"Count for at least {math.ceil(needed_s)} s",
                )
                break  # the other places are likely to have the same problem


def resolution_problems(step: Acquire) -> Iterator[tuple[str, str]]:
    """A resolution that is not in a unit of acceleration."""
    if step.resolution is not None and step.resolution.dimension not in (NO_DIMENSION, G.dimension):
        yield "resolution", f"is {step.resolution}, expected a quantity in g, or a ratio to 1 g such as 1 ppm"
    elif step.resolution is not None and step.resolution.base_value <= 0:
        yield "resolution", "is not above 0"
