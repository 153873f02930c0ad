"""Rules on dynamic temperature tests: the legs at 0 g and at 1 g, in both directions, cycle by cycle."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from bench.config.document import Place
from bench.config.models import BenchFile
from bench.sequence.checks.acquired import ramps_during, results_by
from bench.sequence.checks.parts import unnumbered
from bench.sequence.checks.remarks import Found, Rule
from bench.sequence.document.model import ResultEntry
from bench.sequence.plan.plan import Plan
from bench.sequence.plan.poses import angles_before, first_input_deg
from bench.sequence.steps.orienting import Orient
from bench.sequence.steps.stimulus import Move

METHOD, VERIFICATION = "temperature_ramp", "verify_on_ramp"
LEVEL_BELOW_G = 0.5  # as in the reduction: legs with less gravity along the input axis are the 0 g part
SAME_ANGLE_DIGITS = 3  # decimals of equal angles in °


class _Leg(NamedTuple):
    """An acquisition during a ramp: its id, the angle of the head, its first and last set point."""

    step_id: str
    angle_deg: float
    from_c: float
    to_c: float


def incomplete_ramp(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A dynamic test without legs at 0 g or at 1 g, from which bias and scale factor follow."""
    for place, entry in _tests(plan, METHOD, VERIFICATION):
        at_g = {_along_g(leg.angle_deg, bench) < LEVEL_BELOW_G: leg for leg in _legs(plan, entry.data)}
        missing = [name for name, level in (("0 g", True), ("1 g", False)) if level not in at_g]
        if missing:
            yield (
                (*place, "data"),
                f"'{entry.data}' has no acquisition during a ramp of the chamber at {' and at '.join(missing)}, so "
                "that bias and scale factor cannot be separated",
                "Acquire with a ramp in 'during' at two angles of the head: input axis level, and vertical",
            )


def one_direction(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """A dynamic test whose temperature only rises or only falls: hysteresis is not determined."""
    for place, entry in _tests(plan, METHOD):
        legs = [leg for leg in _legs(plan, entry.data) if not math.isnan(leg.from_c)]
        rising = {leg.to_c > leg.from_c for leg in legs}
        if len(rising) == 1:
            yield (
                (*place, "data"),
                f"the temperature only {'rises' if rising.pop() else 'falls'} in the legs of '{entry.data}': "
                "K0/hysteresis is not found",
                "Acquire while the chamber warms and while it cools",
            )


def unnumbered_cycles(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """A leg repeated outside a loop 'cycle': both count as one cycle, and repeatability is not determined."""
    for place, entry in _tests(plan, METHOD, VERIFICATION):
        legs = _legs(plan, entry.data)
        visits = [(leg.step_id, (round(leg.angle_deg, SAME_ANGLE_DIGITS), leg.from_c, leg.to_c)) for leg in legs]
        if again := list(unnumbered(visits, "cycle")):
            yield (
                (*place, "data"),
                f"{again[0]} repeats a leg of '{entry.data}' outside a loop 'cycle': K0/repeatability is not found"
                if entry.method == METHOD
                else f"{again[0]} repeats a leg of '{entry.data}' outside a loop 'cycle': both would be one leg",
                "Put the cycles in a loop: for_each: cycle, in: {from: 1, to: 2}",
            )


def _tests(plan: Plan, *methods: str) -> Iterator[tuple[Place, ResultEntry]]:
    """Results of these methods; none on a table with several axes, on which no single angle gives the input axis."""
    if not any(isinstance(each.step, Orient) for each in plan):
        yield from results_by(plan, *methods)


def _along_g(angle_deg: float, bench: BenchFile) -> float:
    """Magnitude of gravity along the input axis of the first place, in g."""
    return abs(math.sin(math.radians(first_input_deg(angle_deg, bench))))


def _legs(plan: Plan, label: str) -> list[_Leg]:
    steps, angles_deg, angle_deg = [], {}, 0.0
    for planned, from_deg in angles_before(plan):
        if isinstance(planned.step, Move):
            angle_deg = planned.step.target_deg(from_deg)
        angles_deg[planned.id] = angle_deg
        steps.append(planned)
    return [
        _Leg(planned.id, angles_deg[planned.id], from_c, ramp.temperature_c)
        for planned, ramp, from_c in ramps_during(steps, label)
    ]


RULES = (
    Rule("incomplete-ramp", "error", "a dynamic temperature test has legs at 0 g and at 1 g", incomplete_ramp),
    Rule("one-direction", "warning", "a dynamic temperature test warms and cools", one_direction),
    Rule("unnumbered-legs", "warning", "cycles of a dynamic temperature test are numbered", unnumbered_cycles),
)
