"""Rules on where the head goes, and on how long is counted there."""

from __future__ import annotations

import math
from collections.abc import Iterator

from bench.config.models import BenchFile
from bench.sequence.measuring import Acquire
from bench.sequence.plan import Plan
from bench.sequence.remarks import Found
from bench.sequence.stimulus import TURN_DEG, Move
from bench.sequence.travel import angles_before
from drivers.quantities import parse
from drivers.units import NO_DIMENSION

G = parse("1 g")


def forbidden_angle(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A move that ends in, or goes through, angles at which the fixture would touch something."""
    for planned, from_deg in angles_before(plan) if bench.fixture.forbidden else ():
        step = planned.step
        if not isinstance(step, Move):
            continue
        target_deg = step.target_deg(from_deg)
        for allowed in bench.fixture.forbidden:
            if _meet(from_deg, target_deg, allowed.min, allowed.max):
                yield (
                    (*planned.place, "to" if step.to_deg is not None else "by"),
                    f"the move from {from_deg:g}° to {target_deg:g}° meets {allowed.min:g}° to {allowed.max:g}°, which "
                    "the fixture forbids",
                    "Go there the other way round with 'way', or choose another angle",
                )


def _meet(from_deg: float, to_deg: float, low_deg: float, high_deg: float) -> bool:
    """Whether a way has a point in common with a range of angles, which comes back every turn."""
    begin, end = min(from_deg, to_deg), max(from_deg, to_deg)
    if math.isnan(end):
        return False
    turns = math.ceil((begin - high_deg) / TURN_DEG)
    return low_deg + turns * TURN_DEG <= end


def short_acquisition(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A counting time in which one count is more than the resolution asked for (methods.md 1.7: T = 1/(S q))."""
    for planned in plan:
        step = planned.step
        if not isinstance(step, Acquire) or step.resolution is None or step.duration_s is None:
            continue
        is_ratio = step.resolution.dimension == NO_DIMENSION
        resolution_g = step.resolution.base_value if is_ratio else step.resolution.to("g")
        for name, place in bench.places.items():
            if place.nominal is None or place.nominal.S is None:
                continue
            needed_s = 1 / (place.nominal.S * place.nominal.K1 * resolution_g)
            if step.duration_s < needed_s:
                yield (
                    (*planned.place, "for"),
                    f"in {step.duration_s:g} s one count of the unit in place '{name}' is "
                    f"{resolution_g * needed_s / step.duration_s * 1e6:.3g} µg, asked for are {resolution_g * 1e6:.3g} "
                    "µg",
                    f"Count for at least {math.ceil(needed_s)} s",
                )
                break  # the other places are likely alike


def resolution_problems(step: Acquire) -> Iterator[tuple[str, str]]:
    """A resolution in a unit that is none of acceleration."""
    if step.resolution is not None and step.resolution.dimension not in (NO_DIMENSION, G.dimension):
        yield "resolution", f"is {step.resolution}, expected a quantity in g, or a ratio to 1 g such as 1 ppm"
    elif step.resolution is not None and step.resolution.base_value <= 0:
        yield "resolution", "is not above 0"
