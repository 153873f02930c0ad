"""Outlook of a run: when it ends and how certain that is, since when it is stable, and who makes the bench safe."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime, timedelta
from typing import Any, NamedTuple
from zoneinfo import ZoneInfo

from bench.figures.languages import tr
from bench.figures.times_and_sizes import duration
from bench.station.runs.live import LiveRun
from bench.store.tail import instant_at
from bench.web.pages.trends import Trend
from bench.web.shown import clock_time


class Guarded(NamedTuple):
    """Who makes the bench safe if the run cannot: in a line, whether it needs a look, and in a sentence."""

    line: str
    is_late: bool
    why: str


def since(live: LiveRun, trend: Trend, zone: str) -> str:
    """Return since when the reading of a soak is within its range, by the clock of the bench; "" if it is not."""
    at = instant_at(live.begun, trend.since_s)
    return f"{at.astimezone(ZoneInfo(zone)):%H:%M}" if at is not None else ""


def ends(live: LiveRun, zone: str, now: datetime) -> tuple[str, str]:
    """Return when the run ends, with its spread, and what both are from; both "" while the plan is not known."""
    found = live.ending()
    if found is None or not (live.timeline or {}).get("steps"):
        return "", ""
    text = tr("ends about {time}", time=clock_time(found.ends, zone, now))
    first, last = clock_time(found.least, zone, now), clock_time(found.most, zone, now)
    if found.runs:
        spread = max(found.most - found.ends, found.ends - found.least, timedelta(minutes=1))
        why = tr(
            "The end is the mean of {count} earlier runs of the same plan; these would end from {first} to {last}.",
            count=found.runs, first=first, last=last,
        )  # fmt: skip
        return tr("{ends}, ± {spread}", ends=text, spread=duration(spread.total_seconds())), why
    if found.most - found.least < timedelta(minutes=1):
        return text, tr("The end is that of the plan; no step of it may take longer or shorter.")
    why = tr(
        "The end is that of the plan. By the limits of its soaks and waits it is from {first} to {last}; two completed "
        "runs of the same plan make it narrower.", first=first, last=last,
    )  # fmt: skip
    if found.ends - found.least < timedelta(minutes=1):
        return text, why
    return tr("{ends}, not before {first}", ends=text, first=first), why


def guard_of(status: Mapping[str, Any], plan: Mapping[str, Any]) -> Guarded:
    """Return who makes the bench safe if the run cannot."""
    devices = plan.get("made_safe", {})
    alone = [tr(role) for role, each in devices.items() if each.get("alone_after_s") is not None]
    leases = tr("leases {count} of {total}", count=len(alone), total=len(devices)) if devices else ""
    match status.get("guardian"):
        case "ok":
            line, why = tr("guardian ok"), tr("The guardian makes the bench safe if the process of the run dies.")
        case "late":
            line, why = tr("guardian does not answer"), tr("The run ends itself unless its guardian answers soon.")
        case "none":
            line, why = tr("no guardian"), tr("This run energises no real instrument and needs no guardian.")
        case _:
            line, why = "", ""
    by_itself = ""
    if alone:
        names = tr(", ").join(alone)
        by_itself = tr("If the computer fails, these go to their safe state by themselves: {devices}.", devices=names)
    elif devices:
        by_itself = tr("If the computer fails, no device goes to its safe state by itself.")
    text = " · ".join(each for each in (line, leases) if each)
    return Guarded(text, status.get("guardian") == "late", f"{why} {by_itself}".strip())
