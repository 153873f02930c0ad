"""Small drawings of the Station page as SVG without text: the timeline of a plan, and the last hour of a reading."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from bench.store.tail import Bucket

WIDE, HIGH = 1000.0, 44.0
SPARK_WIDE, SPARK_HIGH = 120.0, 24.0
KINDS = {
    "acquire": "measure", "measure": "measure", "tare": "measure", "soak": "soak", "wait": "soak", "wait_until": "soak",
    "ramp": "ramp", "prompt": "ask",
}  # fmt: skip
LEAST_WIDE = 0.6  # parts of one kind closer than this are drawn as one


class Part(NamedTuple):
    """Part of a timeline: kind, begin and width in units of the drawing."""

    kind: str
    x: float
    width: float


class Timeline(NamedTuple):
    """Drawing of a plan: its parts, the course of the set point, and the present in units of the drawing."""

    parts: tuple[Part, ...]
    set_point: str
    low_c: float
    high_c: float
    now: float
    share: float


def timeline(plan: Mapping[str, Any], at_step: int, in_step_s: float) -> Timeline | None:
    """Return the drawing of a plan in which a step has lasted `in_step_s`; None without a plan."""
    steps, total_s = plan.get("steps", ()), float(plan.get("total_s", 0.0))
    if not steps or total_s <= 0:
        return None
    scale = WIDE / total_s
    step = steps[min(at_step, len(steps) - 1)]
    now_s = float(step["begin_s"]) + min(in_step_s, float(step["duration_s"]))
    points = [(0.0, steps[0]["set_point_c"])]
    for each in steps:
        points += [(each["begin_s"], points[-1][1]), (each["begin_s"] + each["duration_s"], each["set_point_c"])]
    low, high = min(c for _, c in points), max(c for _, c in points)
    return Timeline(
        tuple(_parts(steps, scale)), _path([(s * scale, c) for s, c in points], low, high, HIGH - 12, 4), low, high,
        round(now_s * scale, 1), now_s / total_s,
    )  # fmt: skip


def _parts(steps: Sequence[Mapping[str, Any]], scale: float) -> Iterator[Part]:
    open_: Part | None = None
    for step in steps:
        kind = KINDS.get(step["facts"]["verb"], "move")
        x, width = step["begin_s"] * scale, step["duration_s"] * scale
        if kind == "move" and width < LEAST_WIDE:
            continue
        if open_ is not None and open_.kind == kind and x - (open_.x + open_.width) < LEAST_WIDE:
            open_ = Part(kind, open_.x, round(x + width - open_.x, 2))
            continue
        if open_ is not None:
            yield open_
        open_ = Part(kind, round(x, 2), round(width, 2))
    if open_ is not None:
        yield open_


def sparkline(buckets: Sequence[Bucket], until_s: float, over_s: float, least_range: float) -> str:
    """Return the path of the last `over_s` of a reading; "" without enough of it."""
    if len(buckets) < 2:
        return ""
    low, high = min(each.low for each in buckets), max(each.high for each in buckets)
    middle, half = (low + high) / 2, max(high - low, least_range, 1e-12) / 2
    points = [(SPARK_WIDE * (1 - (until_s - each.at_s) / over_s), each.mean) for each in buckets]
    return _path([(max(0.0, x), y) for x, y in points], middle - half, middle + half, SPARK_HIGH - 4, 2)


def _path(points: Sequence[tuple[float, float]], low: float, high: float, height: float, top: float) -> str:
    """Return the path of points, without those that repeat the height of both neighbours."""
    span = (high - low) or 1.0
    drawn = [(round(x, 1), round(top + height * (1 - (y - low) / span), 1)) for x, y in points]
    kept = [
        each for n, each in enumerate(drawn)
        if n in (0, len(drawn) - 1) or not drawn[n - 1][1] == each[1] == drawn[n + 1][1]
    ]  # fmt: skip
    return "M" + "L".join(f"{x:g} {y:g}" for x, y in kept)
