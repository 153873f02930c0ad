"""Rules on the acquisitions that a calibration on an indexing table needs."""

from __future__ import annotations

import math
from collections.abc import Iterator

from bench.config.models import BenchFile
from bench.methods.indexing.names import CLOCKING, VERIFICATION
from bench.sequence.checks.acquired import results_by
from bench.sequence.checks.remarks import Found, Rule
from bench.sequence.plan.plan import Plan
from bench.sequence.plan.poses import angles_before
from bench.sequence.steps.measuring import Acquire
from bench.sequence.steps.stimulus import Move
from bench.sequence.steps.talk import Prompt

METHOD = "indexing_static"
LEAST_ANGLES = 3  # minimum number of angles for a line with residuals
NOT_SWEPT = {CLOCKING, VERIFICATION}
SAME_ANGLE_DIGITS = 4  # decimals of equal angles in °

Angles = dict[str, set[float]]


def one_end(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A calibration in one orientation only, which cannot separate bias and misalignment."""
    for place, entry in results_by(plan, METHOD):
        ends = _swept(plan, bench, entry.data)
        for end in ("up", "down"):
            angles = len(ends.get(end, ()))
            if angles < LEAST_ANGLES:
                yield (
                    (*place, "data"),
                    f"'{entry.data}' has {angles} angles with the unit's +Z {end}, so that bias and "
                    "misalignment cannot be separated",
                    f"Acquire at {LEAST_ANGLES} angles or more in both orientations, each after a prompt for its mount",
                )


def beyond_range(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """Angles at which the output exceeds the limit up to which it is fitted."""
    for place, entry in results_by(plan, METHOD):
        from bench.methods.indexing.method import IndexingStaticSettings  # imported only if a sequence uses the method

        limit_g = IndexingStaticSettings.model_validate(entry.settings).output_limit_g
        widest_deg = max((abs(each) for ends in _swept(plan, bench, entry.data).values() for each in ends), default=0.0)
        if limit_g is not None and math.sin(math.radians(min(widest_deg, 90.0))) >= limit_g:
            most_deg = math.degrees(math.asin(min(limit_g, 1.0)))
            yield (
                (*place, "settings", "output_limit"),
                f"{widest_deg:g}° is {math.sin(math.radians(widest_deg)) * 1e3:.3g} mg, and an output beyond "
                f"{limit_g * 1e3:g} mg is never fitted",
                f"Stay within {most_deg:.3g}°, or raise output_limit if the unit goes so far",
            )


def _swept(plan: Plan, bench: BenchFile, label: str) -> Angles:
    """Angles of the head in the sweeps of each end."""
    mount, angle_deg, ends = bench.fixture.mount(), 0.0, Angles()
    for planned, from_deg in angles_before(plan):
        match planned.step:
            case Prompt() if planned.step.expect is not None and planned.step.expect.mount in bench.fixture.mounts:
                mount = bench.fixture.mount(planned.step.expect.mount)
            case Move():
                angle_deg = planned.step.target_deg(from_deg)
            case Acquire() if planned.step.label == label and not NOT_SWEPT & set(planned.id.split("/")):
                upright = math.cos(math.radians(mount.angle)) * math.cos(math.radians(mount.roll))
                ends.setdefault("up" if upright > 0 else "down", set()).add(round(angle_deg, SAME_ANGLE_DIGITS))
    return ends


RULES = (
    Rule("one-end", "warning", "a calibration on an indexing table has both orientations", one_end),
    Rule("beyond-range", "warning", "an indexing table stays within the unit's output limit", beyond_range),
)
