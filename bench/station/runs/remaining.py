"""When a run ends: by earlier runs of the same plan, or by the plan and the limits of its soaks."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

from bench.errors import StoreError
from bench.station.runs.catalogue import Catalogue
from bench.store.runs import RunSummary
from bench.store.tail import Tail

LOOKED_AT, EARLIER_MOST, EARLIER_LEAST = 200, 8, 2
SAME = ("sequence", "bench", "preset", "parameters", "simulated")  # facts of runs with the same plan
EVENTS_MOST = 50_000
Facts = Mapping[str, Any]


class Course(NamedTuple):
    """Course of an earlier run: bench times in s of begin and end of each step, by its id, and of its end."""

    steps: Mapping[str, tuple[float, float]]
    end_s: float


class Left(NamedTuple):
    """Time that a run still takes in s of bench time, with its bounds; `runs` are the earlier runs that it is from.

    Without earlier runs the bounds are those of the plan: soaks and waits may end at their least time, and at the
    latest when they give up.
    """

    left_s: float
    least_s: float
    most_s: float
    runs: int = 0


def earlier_courses(catalogue: Catalogue, run: RunSummary) -> list[Course]:
    """Return the courses of completed runs of the same plan, newest first, without those that somebody has held."""
    found: list[Course] = []
    for name in catalogue.names()[:LOOKED_AT]:
        if name == run.id or len(found) >= EARLIER_MOST:
            continue
        with suppress(StoreError):
            other = catalogue.run(name)
            if other.state == "completed" and all(other.manifest.get(key) == run.manifest.get(key) for key in SAME):
                found += _course(other)
    return found


def _course(run: RunSummary) -> list[Course]:
    with Tail(run.path) as tail:
        events = tail.events(0, EVENTS_MOST)
    if not events or any(each.kind in ("held", "run_resumed") for each in events):
        return []
    begins = {each.step: each.at_s for each in reversed(events) if each.kind == "step_begins"}
    ends = {each.step: each.at_s for each in events if each.kind == "step_ended"}
    return [Course({step: (at_s, ends[step]) for step, at_s in begins.items() if step in ends}, events[-1].at_s)]


def left_by_courses(courses: Iterable[Course], step: str, in_step_s: float) -> Left | None:
    """Return what is left of a run in a step, by earlier ones; None unless two of them had this step."""
    lefts = [
        course.end_s - course.steps[step][1] + max(0.0, course.steps[step][1] - course.steps[step][0] - in_step_s)
        for course in courses
        if step in course.steps
    ]
    if len(lefts) < EARLIER_LEAST:
        return None
    return Left(sum(lefts) / len(lefts), min(lefts), max(lefts), len(lefts))


def left_by_plan(steps: Sequence[Facts], total_s: float, at: int, in_step_s: float) -> Left:
    """Return what is left of a run in the step at a place of its plan, by the plan."""
    now_s = min(in_step_s, float(steps[at]["duration_s"]))
    left_s = max(0.0, total_s - float(steps[at]["begin_s"]) - now_s)
    sooner_s = later_s = 0.0
    for place, each in enumerate(steps[at:], at):
        passed_s = in_step_s if place == at else 0.0
        least_s, most_s = _bounds(each)
        usual_s = float(each["duration_s"])
        sooner_s += max(0.0, usual_s - max(least_s, passed_s))
        later_s += max(0.0, most_s - max(usual_s, passed_s))
    return Left(left_s, max(0.0, left_s - sooner_s), left_s + later_s)


def _bounds(step: Facts) -> tuple[float, float]:
    """Return the least and the greatest duration of a step in s; that of the plan for what takes a known time."""
    usual_s, facts = float(step["duration_s"]), step.get("facts", {})
    most_s = max(float(facts.get("give_up_after_s") or usual_s), usual_s)
    if facts.get("verb") == "soak" and facts.get("until_stable"):
        return float(facts["at_least_s"]), most_s
    return (0.0, most_s) if facts.get("verb") == "wait_until" else (usual_s, usual_s)
