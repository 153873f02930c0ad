"""Display of numbers: units and digits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache

from bench.figures.languages import tr
from bench.metrology.results.finding import LOWER_BOUND, Finding, Interval
from bench.sequence.method import shipped_first
from drivers.quantity.units import parse_unit


@lru_cache(maxsize=1024)
def scale_shown(quantity: str, unit: str) -> tuple[float, str]:
    """Factor from `unit` to the displayed unit of a quantity, and that unit.

    Methods state them (`MethodDescription.shown`): the first of the same dimension is used, else `unit` itself.
    """
    for symbol in _units_shown().get(quantity, ()):
        own, other = parse_unit(unit), parse_unit(symbol or "1")
        if own.dimension == other.dimension:
            return float(own.factor / other.factor), symbol
    return 1.0, unit


@lru_cache(maxsize=1)
def _units_shown() -> Mapping[str, list[str]]:
    """Displayed units of each quantity by the methods."""
    found: dict[str, list[str]] = {}
    for method in shipped_first():
        for quantity, symbol in method.displayed.items():
            found.setdefault(quantity, []).append(symbol)
    return found


def shown(finding: Finding, *, marked: bool = True) -> str:
    """Value ± expanded uncertainty in the displayed unit, to the digits that the uncertainty justifies.

    A failed or invalid value has a mark, if `marked`. A count has no budget and is exact. A settling time is shown with
    its range, because it cannot be negative.
    """
    factor, _ = scale_shown(finding.quantity, finding.unit)
    mark = " !" if marked and finding.verdict in ("FAIL", "INVALID") else ""
    if not finding.budget:
        return f"{finding.value * factor:.9g}{mark}"
    if finding.interval is not None and is_shown_by_range(finding):
        return f"{_with_range(finding, finding.interval)}{mark}"
    return f"{with_expanded(finding.value * factor, finding.expanded * factor)}{mark}"


def with_expanded(value: float, expanded: float) -> str:
    """A value ± its expanded uncertainty, to the digits that this justifies."""
    digits = decimals(expanded)
    return f"{round(value, digits) + 0.0:.{digits}f} ± {expanded:.{digits}f}"  # never -0.0


def is_shown_by_range(finding: Finding) -> bool:
    """True if a range replaces the expanded uncertainty: for a settling time."""
    return finding.interval is not None and finding.quantity.endswith("/settling")


def _with_range(finding: Finding, interval: Interval) -> str:
    """A time with its range, "14 (0 to 35)"; a lower bound as "> 52"."""
    value, low, high = range_shown(finding, interval, finding.value, interval.low, interval.high)
    return f"> {value}" if LOWER_BOUND in finding.flags else f"{value} ({tr('{low} to {high}', low=low, high=high)})"


def range_shown(finding: Finding, interval: Interval, *values: float) -> list[str]:
    """Values in the displayed unit, to the digits that the width of the finding's interval justifies.

    Settling times have at most tenths of a minute.
    """
    factor, _ = scale_shown(finding.quantity, finding.unit)
    digits = decimals((interval.high - interval.low) * factor)
    if not is_shown_by_range(finding):
        return [f"{value * factor:.{digits}f}" for value in values]
    digits = min(digits, 1)
    return [f"{value * factor:.{digits}f}" if round(value * factor, digits) else "0" for value in values]


def decimals(u: float) -> int:
    """Decimals for an uncertainty with two significant digits."""
    if u <= 0:
        return 3
    return max(0, min(9, 1 - math.floor(math.log10(u))))
