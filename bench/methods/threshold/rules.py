"""Rules on ladders of small steps for the method `threshold`."""

from __future__ import annotations

import math
from collections.abc import Iterator

from bench.config.models import BenchFile
from bench.sequence.checks.acquired import results_by
from bench.sequence.checks.remarks import Found, Rule
from bench.sequence.plan.dwells import loop_values
from bench.sequence.plan.plan import Plan
from bench.sequence.plan.poses import angles_before, poses_before
from bench.sequence.steps.limits import limits_in
from bench.sequence.steps.measuring import Acquire
from bench.sequence.steps.stimulus import Move

METHOD = "threshold"
ARCSEC_PER_DEG = 3600
SAME_ANGLE_ARCSEC = 0.01

Ladders = dict[float, list[float]]


def no_nominal(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A place without a nominal scale factor: the expected output of a step is unknown."""
    for place, _ in results_by(plan, METHOD):
        for name, entry in bench.places.items():
            if bench.nominal_per_g(name) is None:
                yield (
                    (*place, "method"),
                    f"a step is judged by the nominal scale factor, which place '{name}' of the bench does not state",
                    f"Give {' and '.join(f'nominal.{key}' for key in entry.output_per_g_keys)} of places.{name} in the "
                    "bench file",
                )


def incomplete_ladder(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """A ladder without steps in both directions, or with a step not enclosed by readings at the position."""
    for place, entry in results_by(plan, METHOD):
        for position, offsets in _ladders(plan, entry.data).items():
            if not {-1, 1} <= {math.copysign(1, offset) for offset in offsets if offset}:
                yield (
                    (*place, "data"),
                    f"the ladder at position {position:g} lacks steps in both directions; the loop "
                    "variable 'offset' marks the steps",
                    "Acquire in a loop 'offset' over a step and 0°, with steps in both directions",
                )
            elif offsets[0] or offsets[-1]:
                yield (
                    (*place, "data"),
                    f"the ladder at position {position:g} {'begins' if offsets[0] else 'ends'} with a step; without "
                    "a reading at the position before and after it, a step cannot be separated from drift",
                    "Acquire at the position before the first step and after each",
                )


def ladder_angle(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A reading at another angle of the head than by the loops 'position' and 'offset': it would count as theirs."""
    axes = {planned.step.role for planned in plan if isinstance(planned.step, Move)}
    for place, entry in results_by(plan, METHOD):
        for planned, pose in poses_before(plan, bench):
            if len(axes) != 1 or not isinstance(planned.step, Acquire) or planned.step.label != entry.data:
                continue
            loops, angle_deg = loop_values(planned.id), pose.angles_deg.get(next(iter(axes)), 0.0)
            loops_deg = loops.get("position", 0.0) + loops.get("offset", 0.0)
            if abs(angle_deg - loops_deg) * ARCSEC_PER_DEG > SAME_ANGLE_ARCSEC:
                yield (
                    (*place, "data"),
                    f"{planned.id} is at {angle_deg:.6g}°, and the loop variables 'position' and 'offset' around it "
                    f"come to {loops_deg:.6g}°",
                    "Name the loop over the angles 'position' and that over the steps 'offset'",
                )
                break


def step_below_band(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A step smaller than the settling band: the head may not move and still count as settled."""
    for place, entry in results_by(plan, METHOD):
        steps = [abs(offset) for offsets in _ladders(plan, entry.data).values() for offset in offsets if offset]
        for role in dict.fromkeys(planned.step.role for planned in plan if isinstance(planned.step, Move)):
            settle = getattr(bench.devices[role].options, "settle", None) if role in bench.devices else None
            smallest_arcsec = round(min(steps, default=math.inf) * ARCSEC_PER_DEG, 6)
            if settle is not None and smallest_arcsec < settle.band:
                yield (
                    (*place, "data"),
                    f"the smallest step is {smallest_arcsec:g} arcsec, and '{role}' has settled within "
                    f"{settle.band:g} arcsec of its target: it may not move at all",
                    f"Leave out the smallest steps, or lower options.settle.band of '{role}' in the bench file",
                )


def ladder_below_limit(plan: Plan, _bench: BenchFile) -> Iterator[Found]:
    """A limit above the largest step: a unit that follows no step could be neither passed nor failed."""
    for place, entry in results_by(plan, METHOD):
        for name, written in entry.limits.items():
            limits = limits_in(written, "g")
            largest_g = [
                math.cos(math.radians(position)) * math.sin(math.radians(max(map(abs, offsets))))
                for position, offsets in _ladders(plan, entry.data).items()
            ]
            if largest_g and limits.high is not None and min(largest_g) < limits.high:
                yield (
                    (*place, "limits", name),
                    f"the largest step is {min(largest_g) * 1e6:.3g} µg, below the limit of {limits.high * 1e6:.3g} "
                    "µg: a unit that follows no step could be neither passed nor failed",
                    "Add a larger step to the ladder",
                )


def _ladders(plan: Plan, label: str) -> Ladders:
    """Values of the loop variable `offset` of the acquisitions under a label, in °, by loop variable `position`."""
    ladders: Ladders = {}
    for planned, _ in angles_before(plan):
        if isinstance(planned.step, Acquire) and planned.step.label == label:
            loops = loop_values(planned.id)
            ladders.setdefault(loops.get("position", 0.0), []).append(loops.get("offset", 0.0))
    return ladders


RULES = (
    Rule("no-nominal", "error", "the nominal scale factor is known", no_nominal),
    Rule("incomplete-ladder", "error", "a ladder has steps in both directions, between readings", incomplete_ladder),
    Rule("ladder-angle", "error", "the loops around a reading of a ladder state the angle of the head", ladder_angle),
    Rule("step-below-band", "warning", "the head can resolve the steps of a ladder", step_below_band),
    Rule("ladder-below-limit", "warning", "a ladder reaches beyond its limits", ladder_below_limit),
)
