"""Evidence on a soak in the record of a run: nothing else was energised, and the air was in band."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bench.engine.credit import Chamber, NoCredit, Soaked, check_gap, check_set_point, number
from bench.sequence.plan.dwells import first_visit
from bench.store.reader import Event, Series

# Keys in the intent of a step that moves an axis.
MOTION = frozenset({"rate_dps", "amplitude_deg", "target_deg", "attitude"})
BEGINNINGS = ("run_begins", "run_resumed")


class Record(NamedTuple):
    """The record of a run: its journal, and the readings of the chamber, of the air and of the set point (°C).

    `unknown` are ids of steps with unknown effect on power, `members` the devices of a name.
    """

    entries: Sequence[Event]
    air: Series
    set_point: Series
    unknown: Collection[str]
    members: Callable[[str], Sequence[str]]


def soaked(record: Record, step: str, chamber: Chamber) -> Soaked:
    """Return the proved period of the soak `step` until its run was interrupted; raise NoCredit.

    It counts from the first reading within the band; the approach before that proves nothing.
    """
    entries, begun = _of_its_process(record.entries, step)
    _expect_nothing_energised(entries, begun, record)
    _expect_undisturbed(entries, begun, chamber)
    if any(each.kind == "clock_step" and each.data.get("slept_s") for each in entries):  # bench time stood still
        raise NoCredit("the computer slept during the run")
    set_point_c = _set_point_c(entries, begun, chamber)
    begun_s, first = entries[begun].at_s, entries[0]
    air_s, air_c = _readings(record.air, begun_s)
    _, read_back_c = _readings(record.set_point, begun_s)
    check_set_point(float(read_back_c[np.abs(read_back_c - set_point_c).argmax()]), set_point_c)
    inside = np.abs(air_c - set_point_c) <= chamber.band_c
    arrived = int(inside.argmax())
    if not inside[arrived]:
        raise NoCredit(f"the air of {chamber.role} had not come within {chamber.band_c:g} °C of {set_point_c:g} °C")
    if not inside[arrived:].all():
        raise NoCredit(f"the air of {chamber.role} left the band of {chamber.band_c:g} °C during the run")
    boot, offset_s = first.data.get("boot"), number(first.data.get("up_s")) - first.at_s
    if not isinstance(boot, str) or not boot or math.isnan(offset_s):
        raise NoCredit("the record does not say after which start of the computer the run began")
    since_s, until_s = float(air_s[arrived]), float(air_s[-1])
    return Soaked(since_s, since_s + offset_s, until_s + offset_s, boot, set_point_c, float(read_back_c[-1]))


def _of_its_process(entries: Sequence[Event], step: str) -> tuple[Sequence[Event], int]:
    """Entries of the process that began the soak last, and the index of that beginning among them."""
    begun = [i for i, each in enumerate(entries) if each.kind == "step_begins" and first_visit(each.step) == step]
    beginnings = [i for i, each in enumerate(entries) if each.kind in BEGINNINGS]
    if not begun or not beginnings or begun[-1] < beginnings[-1]:
        raise NoCredit("the run was interrupted twice since the soak began")
    return entries[beginnings[-1] :], begun[-1] - beginnings[-1]


def _expect_nothing_energised(entries: Sequence[Event], begun: int, record: Record) -> None:
    """Raise NoCredit if an output was on.

    A run that has just begun or resumed has nothing energised; an intended output counts as energised at once.
    """
    on: set[str] = set()
    moving: set[str] = set()
    for index, entry in enumerate(entries):
        data = entry.data
        if entry.kind == "step_begins":
            if re.sub(r"/pass=\d+", "/pass=1", first_visit(entry.step)) in record.unknown:
                raise NoCredit(f"what the step of a plug-in {entry.step} energises is not known")
            if data.get("output") == "on":
                on.update(record.members(str(data.get("device"))))
            if not MOTION.isdisjoint(data):
                moving.add(entry.step)
        elif entry.kind == "step_ended":
            on -= _read_back_off(data)
            moving.discard(entry.step)
        if index >= begun and on:
            raise NoCredit(f"{', '.join(sorted(on))} was on since the soak began: the unit lost its power")
        if index >= begun and moving:
            raise NoCredit(f"{', '.join(sorted(moving))} moved an axis since the soak began")


def _read_back_off(data: Mapping[str, Any]) -> set[str]:
    """Supplies and sources whose output a step has read back as off."""
    outputs = data.get("outputs", {"": data})
    return {str(each.get("role")) for each in outputs.values() if each.get("output") is False}


def _expect_undisturbed(entries: Sequence[Event], begun: int, chamber: Chamber) -> None:
    on_line = "line"
    for index, entry in enumerate(entries):
        data, why = entry.data, ""
        if entry.kind == "power":
            on_line = str(data.get("state"))
        if index < begun:
            continue
        match entry.kind:
            case "clock_step" | "stalled":
                why = "the computer's clock was set, or the run stood still"
            case "fault" | "device_left_out" if data.get("device") == chamber.role:
                why = f"{chamber.role} failed"
            case "doubted" if data.get("reading") in (chamber.air, chamber.set_point):
                why = f"a reading of {data['reading']} was not valid"
            case "problem":
                why = f"the run had failed ({data.get('text')})"
            case _ if on_line != "line":
                why = "the computer was not on line power"
        if why:
            raise NoCredit(f"since the soak began {why}")


def _set_point_c(entries: Sequence[Event], begun: int, chamber: Chamber) -> float:
    """Target (°C) of the ramp of this process that led to the soak."""
    ramps = [
        (index, entry)
        for index, entry in enumerate(entries)
        if entry.kind == "step_begins" and entry.data.get("device") == chamber.role and "target_c" in entry.data
    ]
    if not ramps:
        raise NoCredit(f"no ramp of {chamber.role} led to the soak")
    index, ramp = ramps[-1]
    if index > begun:
        raise NoCredit(f"the set point of {chamber.role} was changed since the soak began")
    if not any(each.kind == "step_ended" and each.step == ramp.step for each in entries[index:begun]):
        raise NoCredit(f"the ramp of {chamber.role} had not ended")
    return number(ramp.data["target_c"])


def _readings(series: Series, since_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times and values since the soak began."""
    since = series.at_s >= since_s
    at_s, values = series.at_s[since], series.values[since]
    if not len(at_s):
        raise NoCredit("the chamber was not read since the soak began")
    for gap_s in np.diff(at_s, prepend=since_s):
        check_gap(float(gap_s))
    if not np.isfinite(values).all():
        raise NoCredit(f"a reading of {series.name} is no number")
    return at_s, values
