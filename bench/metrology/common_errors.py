"""Errors that many readings of a run have in common, as functions of their times and temperatures.

Each is of the size of one standard uncertainty, with the budget line of its source, whose own u is 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from bench.metrology.bench_uncertainty import BenchRecord
from bench.metrology.least_squares import Array
from bench.metrology.results.budget import BudgetLine, common
from bench.metrology.run_data import RunData
from bench.metrology.thermometer_drift import DriftInRun, source_of

LEVEL = "fixture: level"
OverTemperature = Callable[[Array, Array], Array]  # errors in °C at times and temperatures (n,)
OverTime = Callable[[Array], Array]


def thermometer_errors(data: RunData, reading: str) -> Iterator[tuple[BudgetLine, OverTemperature]]:
    """Offset, gain and drift within the run of the thermometer of a reading."""
    offset_c, gain = data.bench.thermometer_u(reading)
    drift = DriftInRun(data, reading)
    yield BudgetLine(f"{reading}: offset", "B", 0.0, None, reading), lambda at_s, _: np.full(len(at_s), offset_c)
    yield BudgetLine(f"{reading}: gain", "B", 0.0, None, reading), lambda _, at_c: at_c * gain
    yield drift.line(0.0), lambda at_s, _: drift.error_c(at_s)


def level_drift(data: RunData) -> tuple[BudgetLine, OverTime]:
    """Tilt of the base within the run, in rad at times (n,)."""
    known = data.bench.level_drift
    u_rad = math.radians(known.u)
    return common(source_of(LEVEL, known), 0.0), lambda at_s: data.run_share(at_s) * u_rad


def head_harmonics(bench: BenchRecord, angle_rad: Array) -> Iterator[tuple[BudgetLine, Array]]:
    """Cosine and sine part of each harmonic of the head at angles (n,), in rad; counted from any angle."""
    for order, u_deg in enumerate(bench.head.harmonics_u_deg, start=1):
        for shape in (np.cos, np.sin):
            yield common("head: harmonics", 0.0), np.radians(u_deg) * shape(order * angle_rad)
