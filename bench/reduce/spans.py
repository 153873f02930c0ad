"""Spans of a run: times at which a method measured the data that report tables show under one number or name."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from bench.figures.languages import tr
from bench.metrology.acquisition import Acquisition
from bench.metrology.run_data import RunData
from bench.sequence.document.model import ResultEntry
from bench.sequence.method import MethodDescription
from drivers.installed import loaded


@dataclass(frozen=True)
class Span:
    """A part of the run from `begin_s` to `end_s` of bench time; without a name it is in no table."""

    name: str
    begin_s: float
    end_s: float


def spans_of(data: RunData, entry: ResultEntry, method: MethodDescription) -> Iterator[Span]:
    """Times at which a method measured the data of a result, or those of its stability check."""
    if data.label == entry.closure:
        yield from over_groups(data, lambda _number, _members: tr("closure"))
    elif method.spans:
        yield from loaded(method.spans)(data)
    else:
        yield from over_groups(data, lambda number, _members: str(method.first_dwell + number))


def over_groups(data: RunData, name: Callable[[int, list[Acquisition]], str]) -> Iterator[Span]:
    """A span for each group of acquisitions, named by `name` from its number and members."""
    for number, members in enumerate(data.groups().values()):
        yield Span(name(number, members), members[0].begin_s, members[-1].end_s)


def in_unit(value: float, unit: str) -> str:
    """A value with its unit as a name; empty if unknown."""
    return "" if math.isnan(value) else f"{value:.6g} {unit}"
