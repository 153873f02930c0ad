"""What a run measured when, by the numbers or names that the tables of its report have for it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby

from bench.analysis.acquired import Acquisition
from bench.analysis.channel_runs import input_level, is_ramp
from bench.analysis.indexing_readings import kind_of
from bench.analysis.ladder import by_position
from bench.analysis.orientation import unit_axes
from bench.analysis.rundata import RunData
from bench.report.languages import tr
from bench.report.words import end_in_words
from bench.sequence.methods import CountsAt, MethodDescription
from bench.sequence.model import ResultEntry


@dataclass(frozen=True)
class Span:
    """A part of the run from `begin_s` to `end_s` of bench time; without a name it is one that no table names."""

    name: str
    begin_s: float
    end_s: float


def spans_of(data: RunData, entry: ResultEntry, method: MethodDescription) -> Iterator[Span]:
    """When a method measured what it has of a result's data, or of what it looks at for closure."""
    if data.label == entry.closure:
        yield from _over_groups(data, lambda _number, _members: tr("closure"))
    elif method.counts_at in NAMED:
        yield from NAMED[method.counts_at](data)
    else:
        yield from _over_groups(data, lambda number, _members: str(method.first_dwell + number))


def _over_groups(data: RunData, name: Callable[[int, list[Acquisition]], str]) -> Iterator[Span]:
    for number, members in enumerate(data.groups().values()):
        yield Span(name(number, members), members[0].begin_s, members[-1].end_s)


def _legs(data: RunData) -> Iterator[Span]:
    """The legs of temperature ramps, an acquisition each, numbered from 1."""
    for number, leg in enumerate(data.acquisitions, start=1):
        yield Span(tr("leg {number}", number=number), leg.begin_s, leg.end_s)


def _ladders(data: RunData) -> Iterator[Span]:
    """The ladders of small steps, by their positions."""
    for position, steps in by_position(data).items():
        yield Span(tr("about {angle}°", angle=f"{position:g}"), steps[0].begin_s, steps[-1].end_s)


def _levels(data: RunData) -> Iterator[Span]:
    """The ramps of input levels, by the names of these; the points at rest around them have none."""
    for each in data.acquisitions:
        names = [input_level(data, unit, each).name for unit in data.units] if is_ramp(each) else []
        yield Span(" / ".join(dict.fromkeys(names)), each.begin_s, each.end_s)


def _visits(data: RunData) -> Iterator[Span]:
    """The visits of set points, by their temperatures."""
    return _over_groups(data, lambda _number, members: _in_unit(members[0].set_c, "°C"))


def _motions(data: RunData) -> Iterator[Span]:
    """The points of a range or of a sweep, by the rate or the frequency; at rest they have no name."""
    for each in data.acquisitions:
        motion, name = each.motion, ""
        if motion is not None and motion.frequency_hz is not None:
            name = _in_unit(motion.frequency_hz, "Hz")
        elif motion is not None and motion.rate_dps is not None:
            name = _in_unit(motion.rate_dps, "°/s")
        yield Span(name, each.begin_s, each.end_s)


def _ends(data: RunData) -> Iterator[Span]:
    """The sweeps of an indexing table, by the end that the units stood on; what was clocked in between has no name."""

    def name(acquisition: Acquisition) -> str:
        match kind_of(acquisition.step):
            case "sweep":
                ups = [unit_axes(acquisition, unit, data.bench)[2, 2] > 0 for unit in data.units]
                return " / ".join(dict.fromkeys(end_in_words("up" if up else "down") for up in ups))
            case "verification":
                return tr("verification")
        return ""

    for called, members in groupby(data.acquisitions, key=name):
        together = list(members)
        yield Span(called, together[0].begin_s, together[-1].end_s)


def _in_unit(value: float, unit: str) -> str:
    return "" if math.isnan(value) else f"{value:.6g} {unit}"


NAMED: Mapping[CountsAt, Callable[[RunData], Iterator[Span]]] = {
    "ramps": _legs, "steps": _ladders, "levels": _levels, "windows": _visits, "table": _motions, "records": _ends,
}  # fmt: skip
