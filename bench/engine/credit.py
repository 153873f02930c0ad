"""Credit for a soak that is repeated after an interruption, from the record of a run and of its guardian.

Opens no files. `NoCredit` is raised for anything that is not proved: a condition that failed and one that is unknown
are treated alike. Two clocks are compared: `up_s`, the time since the start of the computer (s), which nobody sets and
which counts on while it sleeps, and `utc_s`, its time of day (s since 1970).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import datetime
from itertools import pairwise
from pathlib import PurePath
from typing import Any, NamedTuple

from bench.clock import SLEWED, SMALLEST_STEP_S
from drivers.kinds.chamber.arrival import SET_POINT_TOLERANCE_C

GAP_S = 60.0  # largest interval between readings of the chamber: two periods of a guardian that has missed none
SAME_C = 0.05  # largest difference of consecutive read-backs of an unchanged set point


class NoCredit(Exception):
    """The reason why no credit is given."""


class Chamber(NamedTuple):
    """A chamber: its role, the names of its readings, the band about its set point and its safe set point (°C)."""

    role: str
    air: str
    set_point: str
    band_c: float
    safe_c: float


class Instant(NamedTuple):
    """An instant on both clocks, after a start of the computer."""

    boot: str
    up_s: float
    utc_s: float


class ChamberReading(NamedTuple):
    """A reading of the chamber, °C; `from_safe_c` is the last command minus the safe set point, 0 if off."""

    at: Instant
    air_c: float
    set_point_c: float
    from_safe_c: float


class Soaked(NamedTuple):
    """Period proved by the record: in band at the set point from `since_s` (bench time) until the last reading."""

    since_s: float
    since_up_s: float
    until_up_s: float
    boot: str
    set_point_c: float
    read_back_c: float


class GuardedPeriod(NamedTuple):
    """Period proved by the guardian: number of readings in band, longest gap `longest_s`, and the last reading."""

    looks: int
    longest_s: float
    last: ChamberReading


def held(lines: Sequence[Mapping[str, Any]], run: str, chamber: Chamber, before: Soaked) -> GuardedPeriod:
    """Return the period in which the guardian held the chamber, from the lines of its record; raise NoCredit."""
    course = _last_course(lines, chamber.role)
    if any(not isinstance(each.get("run"), str) or PurePath(each["run"]).name != run for each in course):
        raise NoCredit("the record of the guardian is of another run")
    instants = [_instant(each) for each in course]
    looks = [_look(each, at) for each, at in zip(course[:-1], instants[:-1], strict=True)]
    gaps_s = [looks[0].at.up_s - before.until_up_s]
    if looks[0].at.boot != before.boot:
        raise NoCredit("the computer was started again")
    check_gap(gaps_s[0])
    gaps_s += [_passed_s(one, following) for one, following in pairwise(instants)]
    for look in looks:
        _expect_in_band(look, chamber, before.set_point_c, before.read_back_c)
    return GuardedPeriod(len(looks), max(gaps_s), looks[-1])


def credit_s(before: Soaked, meanwhile: GuardedPeriod, now: ChamberReading, chamber: Chamber) -> float:
    """Return the credited time (s) until the first reading of the resumed run, `now`; raise NoCredit."""
    _passed_s(meanwhile.last.at, now.at)
    _expect_in_band(now, chamber, before.set_point_c, before.read_back_c)
    return now.at.up_s - before.since_up_s


def _last_course(lines: Sequence[Mapping[str, Any]], role: str) -> Sequence[Mapping[str, Any]]:
    """Return the guardian's last sequence of records on the chamber: held, read, handed over.

    Nothing else proves a hold.
    """
    if not lines:
        raise NoCredit(f"no guardian has recorded that {role} was held")
    if not all(isinstance(each.get("role"), str) and isinstance(each.get("event"), str) for each in lines):
        raise NoCredit("the record of the guardian is damaged")
    mine = [each for each in lines if each["role"] == role]
    begun = [index for index, each in enumerate(mine) if each["event"] == "held"]
    if not begun:
        raise NoCredit(f"{role} was not held")
    course = mine[begun[-1] :]
    events = [each["event"] for each in course]
    if events != ["held", *["reading"] * (len(events) - 2), "handed_over"]:
        raise NoCredit(f"{role} was not held until the run was resumed: {_other(course)}")
    return course


def _other(course: Sequence[Mapping[str, Any]]) -> str:
    """Describe a record of a chamber that is not a reading."""
    other = [each for each in course[1:] if each["event"] not in ("reading", "handed_over")]
    if not other:
        return "its guardian has not handed it over"
    event, why = str(other[0]["event"]).replace("_", " "), other[0].get("why")
    return f"{event}, {why}" if why else event


def _instant(line: Mapping[str, Any]) -> Instant:
    try:
        at = datetime.fromisoformat(line["at"])
    except (KeyError, TypeError, ValueError):
        raise NoCredit("the record of the guardian is damaged") from None
    up_s, boot = number(line.get("up_s")), line.get("boot")
    if at.tzinfo is None or math.isnan(up_s) or not isinstance(boot, str):
        raise NoCredit("the record of the guardian does not state the times of its readings")
    return Instant(boot, up_s, at.timestamp())


def _look(line: Mapping[str, Any], at: Instant) -> ChamberReading:
    return ChamberReading(at, *(number(line.get(key)) for key in ("air_c", "set_point_c", "from_safe_c")))


def number(value: object) -> float:
    """Return a finite number, or NaN for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    try:
        return float(value) if math.isfinite(value) else math.nan
    except OverflowError:
        return math.nan


def _passed_s(before: Instant, after: Instant) -> float:
    """Return the time between two readings (s), checked on both clocks."""
    if not before.boot or before.boot != after.boot:
        raise NoCredit("the computer was started again")
    passed_s, by_day_s = after.up_s - before.up_s, after.utc_s - before.utc_s
    if not abs(by_day_s - passed_s) <= SMALLEST_STEP_S + SLEWED * abs(passed_s):
        raise NoCredit(f"the computer's clock was set by {by_day_s - passed_s:+.1f} s, or its record was changed")
    check_gap(passed_s)
    return passed_s


def check_gap(gap_s: float) -> None:
    """Raise NoCredit for a gap (s) between readings that is too long."""
    if not gap_s <= GAP_S:
        raise NoCredit(f"nobody read the chamber for {gap_s:.0f} s; at most {GAP_S:g} s are allowed")
    if gap_s < 0:
        raise NoCredit("the times of the readings of the chamber contradict each other")


def check_set_point(found_c: float, set_point_c: float) -> None:
    """Raise NoCredit for a set point (°C) other than that of the soak."""
    if not abs(found_c - set_point_c) <= SET_POINT_TOLERANCE_C:
        raise NoCredit(f"the set point was {found_c:g} °C and not the {set_point_c:g} °C of the soak")


def _expect_in_band(look: ChamberReading, chamber: Chamber, set_point_c: float, read_back_c: float) -> None:
    """Raise NoCredit unless the controller keeps the chamber in the band at the set point of the soak."""
    check_set_point(look.set_point_c, set_point_c)
    if not abs(look.set_point_c - read_back_c) <= SAME_C:
        raise NoCredit(f"the set point changed from {read_back_c:g} to {look.set_point_c:g} °C")
    if not abs(look.from_safe_c - abs(look.set_point_c - chamber.safe_c)) <= SET_POINT_TOLERANCE_C:
        raise NoCredit(f"the controller of {chamber.role} was switched off, or its state is unknown")
    if not abs(look.air_c - set_point_c) <= chamber.band_c:
        raise NoCredit(f"the air was at {look.air_c:.1f} °C, outside {set_point_c:g} ± {chamber.band_c:g} °C")
