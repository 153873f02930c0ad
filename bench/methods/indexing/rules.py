"""Rules on the acquisitions that a calibration on an indexing table needs."""

from __future__ import annotations

import math
from collections.abc import Iterator

from bench.config.fixture import Mount
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
OF_SIDES = {"Kio", "misalignment_y"}
SAME_ANGLE_DIGITS = 4  # decimals of equal angles in °

POINTS = ("up", "down")

Angles = dict[tuple[str, str], set[float]]


def one_end(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A calibration in one orientation only, which cannot separate bias and misalignment."""
    for place, entry in results_by(plan, METHOD):
        ends = _swept(plan, bench, entry.data)
        for end in POINTS:
            angles = len(ends.get(("Z", end), ()))
            if angles < LEAST_ANGLES:
                yield (
                    (*place, "data"),
                    f"'{entry.data}' has {angles} angles with the unit's +Z {end}, so that bias and "
                    "misalignment cannot be separated",
                    f"Acquire at {LEAST_ANGLES} angles or more in both orientations, each after a prompt for its mount",
                )


def one_side(plan: Plan, bench: BenchFile) -> Iterator[Found]:
    """A unit on one of its sides only, or on none although a limit needs both."""
    for place, entry in results_by(plan, METHOD):
        swept = _swept(plan, bench, entry.data)
        wanted = sorted(OF_SIDES & set(entry.limits))
        few = [side for side in POINTS if len(swept.get(("Y", side), ())) < LEAST_ANGLES]
        if few and (wanted or len(few) == 1):
            yield (
                (*place, *(("limits", wanted[0]) if wanted else ("data",))),
                f"'{entry.data}' has {len(swept.get(('Y', few[0]), ()))} angles with the unit's +Y {few[0]}, so that "
                "Kio and misalignment_y are not determined",
                f"Acquire at {LEAST_ANGLES} angles or more on both sides, +Y up and +Y down, each after a prompt for "
                "its mount",
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
    """Angles of the head in the sweeps of each end and side."""
    mount, angle_deg, ends = bench.fixture.mount(), 0.0, Angles()
    for planned, from_deg in angles_before(plan):
        match planned.step:
            case Prompt() if planned.step.expect is not None and planned.step.expect.mount in bench.fixture.mounts:
                mount = bench.fixture.mount(planned.step.expect.mount)
            case Move():
                angle_deg = planned.step.target_deg(from_deg)
            case Acquire() if planned.step.label == label and not NOT_SWEPT & set(planned.id.split("/")):
                ends.setdefault(_face(mount), set()).add(round(angle_deg, SAME_ANGLE_DIGITS))
    return ends


def _face(mount: Mount) -> tuple[str, str]:
    """Axis of the unit that is vertical in a mount, and where it points."""
    upright = math.cos(math.radians(mount.angle))
    by_z, by_y = upright * math.cos(math.radians(mount.roll)), upright * math.sin(math.radians(mount.roll))
    name, value = ("Z", by_z) if abs(by_z) >= abs(by_y) else ("Y", by_y)
    return name, "up" if value > 0 else "down"


RULES = (
    Rule("one-end", "warning", "a calibration on an indexing table has both orientations", one_end),
    Rule("one-lateral", "warning", "a unit on its sides on an indexing table has both of them", one_side),
    Rule("beyond-range", "warning", "an indexing table stays within the unit's output limit", beyond_range),
)
