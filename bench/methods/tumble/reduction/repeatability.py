"""Repeatability: scatter of coefficients when a tumble is repeated after a remounting or a power cycle.

The head, gravity and certificates are common to all repetitions and cancel in differences; the unit, its seat, and the
scatter of the readings remain, and the standard deviations contain all three.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import chdtri

from bench.methods.tumble.reduction.dwells import solve_dwells
from bench.methods.tumble.reduction.unit import TumbleUnit
from bench.metrology.acquisition import Array
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import CONFIDENCE, Finding, Interval, UnitResult
from bench.metrology.results.flag import Flag
from bench.metrology.run_data import RunData, UnitUnderTest
from bench.metrology.unlike_nominal import flags_of_scale

UNITS = {"K0": "g", "K1": "1", "misalignment": "rad"}
NAMES = {"K0": "bias", "K1": "scale factor, relative", "misalignment": "misalignment of the input axis"}
LEAST = 3  # minimum number of repetitions for a meaningful standard deviation


@dataclass(frozen=True, slots=True)
class Repeated:
    """Values of one coefficient over the repetitions (n,), for the report; `own` is the u of each from its readings."""

    quantity: str
    repetition: tuple[int, ...]
    values: Array
    own: Array
    sd: float
    interval: tuple[float, float]


def reduce(data: RunData, settings: Mapping[str, Any]) -> list[UnitResult]:
    """Reduce a run to the standard deviations of every unit over its repetitions, and the change of its bias."""
    return [_reduced(data, unit, settings["bias_per_c_u"]) for unit in data.units]


def interval_of(sd: float, dof: int) -> tuple[float, float]:
    """Range of the standard deviation of infinitely many repetitions, by chi-square, at 95 %."""
    tail = (1 - CONFIDENCE) / 2
    return sd * math.sqrt(dof / chdtri(dof, tail)), sd * math.sqrt(dof / chdtri(dof, 1 - tail))


def _reduced(data: RunData, unit: UnitUnderTest, bias_per_c_u: float) -> UnitResult:
    solved = solve_dwells(data, unit)
    flags = list(solved.flags)
    if len(solved.dwells) < LEAST:
        flags.append(Flag("too_few_repetitions"))
        return UnitResult(unit.place, unit.serial, (), (), solved.left_out, tuple(flags))
    of = _alike_left_out(TumbleUnit.of(data, unit, solved.dwells))
    flags += flags_of_scale(float(np.mean([dwell.values["K1"] for dwell in of.dwells])), 0.0, unit)
    repeated = [_over(name, of) for name in UNITS if all(name in dwell.values for dwell in of.dwells)]
    findings = [*(_deviation(each, of) for each in repeated), _closure(of, bias_per_c_u)]
    return UnitResult(
        place=unit.place,
        uut=unit.serial,
        findings=tuple(findings),
        models=(),
        left_out=solved.left_out,
        flags=tuple(flags),
        detail=tuple(repeated),
    )


def _alike_left_out(of: TumbleUnit) -> TumbleUnit:
    """The same with residuals common to every repetition removed from the scatter, if all use the same positions.

    A remaining warm-up bends the readings of each tumble in the same way, and cancels in differences of repetitions.
    """
    residuals = [dwell.tumble.fit.residuals for dwell in of.dwells]
    angles_rad = [dwell.head_rad for dwell in of.dwells]
    dof = round(of.dof * (1 - 1 / len(of.dwells)))
    if not dof or any(not np.array_equal(each, angles_rad[0]) for each in angles_rad):
        return of
    own = np.array(residuals) - np.mean(residuals, axis=0)
    return replace(of, sd=float(np.sqrt(np.sum(own**2) / dof)), dof=dof)


def _over(quantity: str, of: TumbleUnit) -> Repeated:
    """A coefficient over the repetitions; the scale factor relative to its mean, less 1."""
    values = np.array([dwell.values[quantity] for dwell in of.dwells])
    relative = 1 / float(values.mean()) if quantity == "K1" else 1.0
    values = values * relative - (1.0 if quantity == "K1" else 0.0)
    own = of.own_u(quantity) * abs(relative)
    sd, numbers = float(values.std(ddof=1)), tuple(dwell.number + 1 for dwell in of.dwells)
    return Repeated(quantity, numbers, values, own, sd, interval_of(sd, len(values) - 1))


def _deviation(found: Repeated, of: TumbleUnit) -> Finding:
    """Standard deviation with its relative uncertainty 1 / √(2 (n - 1)) from n values (JCGM 100, E.4.3)."""
    count, dof = len(found.values), len(found.values) - 1
    own = float(np.sqrt(np.mean(found.own**2)))
    lines = [
        BudgetLine(f"{count} repetitions are few", "A", found.sd / math.sqrt(2 * dof), dof),
        BudgetLine("scatter of the readings of a tumble: contained, not taken out", "alias", 0),
    ]
    name = f"{NAMES[found.quantity]}: standard deviation over the repetitions"
    steps = tuple(dwell.group for dwell in of.dwells)
    return of.subject.finding(
        f"{found.quantity}/sd", name, found.sd, UNITS[found.quantity], lines, {"repetitions": count}, steps,
        interval=Interval(*found.interval, own),
    )  # fmt: skip


def _closure(of: TumbleUnit, bias_per_c_u: float) -> Finding:
    """Bias of the last repetition minus that of the first, each at its indicated temperature.

    All errors cancel except those independent between readings, and the drift of the thermometer in between.
    """
    first, last = of.dwells[0], of.dwells[-1]
    first_c, last_c = of.drift.error_c(np.array([first.middle_s, last.middle_s]))
    lines = [*of.own("K0", [(first, 1.0), (last, 1.0)]), of.drift.line(bias_per_c_u * (last_c - first_c))]
    value = last.values["K0"] - first.values["K0"]
    at = {
        "temperature_c": (first.temperature_c + last.temperature_c) / 2,
        "ratio": value / math.hypot(*(line.u for line in lines)),
    }
    name = "closure: last repetition less first"
    return of.subject.finding("K0/closure", name, value, "g", lines, at, (first.group, last.group))


def rows(detail: object) -> Iterator[Repeated]:
    """Repeated values that a result carries for a report; none if nothing was determined."""
    if isinstance(detail, tuple):
        yield from (each for each in detail if isinstance(each, Repeated))
