"""Results and states as the pages of runs show them."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from types import MappingProxyType
from typing import Any
from zoneinfo import ZoneInfo

from bench.clock import wall_utc
from bench.figures.languages import tr
from bench.figures.numbers import decimals, scale_shown, with_expanded
from bench.figures.words import CONTENTS, REASONS, quantity_in_words, where
from bench.station.runs.findings import FindingView
from bench.web.shown import clock_time

STATES = {
    "queued": "waits", "held": "on hold", "starting": "starting", "running": "running", "ended": "ended",
    "refused": "refused", "cancelled": "cancelled", "completed": "completed", "failed": "stopped by a limit",
    "error": "ended with an error", "aborted": "aborted", "interrupted": "interrupted", "damaged": "damaged",
}  # fmt: skip
MARKS = {"PASS": "✓", "FAIL": "✗", "ERROR": "✗", "ABORTED": "■", "INCOMPLETE": "◐", "INVALID": "◐"}


def clock(at: datetime | str | None, zone: str) -> str:
    """Return an instant, or its text in ISO 8601, by the clock of the bench; "" for none."""
    if not at:
        return ""
    try:
        instant = at if isinstance(at, datetime) else datetime.fromisoformat(at)
    except ValueError:
        return str(at)  # of a damaged record
    return clock_time(instant, zone, wall_utc())


def day(at: datetime, zone: str) -> str:
    """Return the day of an instant by the clock of the bench."""
    return f"{at.astimezone(ZoneInfo(zone)):%Y-%m-%d}"


def state_in_words(state: str) -> str:
    """Return a state of an item or a run in words."""
    return tr(STATES.get(state, state))


def mark(verdict: str | None) -> str:
    """Return the shape of a verdict, so that its colour is not alone."""
    return MARKS.get(verdict or "", "○")


class ShownFinding:
    """Result in the displayed unit of its quantity, to the digits that its uncertainty justifies."""

    def __init__(self, finding: FindingView, dwells: Mapping[str, int] = MappingProxyType({})) -> None:
        self.finding, self._dwells = finding, dwells
        self.factor, self.unit = scale_shown(finding.quantity, finding.unit)

    @property
    def value(self) -> str:
        """Value ± U."""
        if not self.finding.expanded:
            return f"{self.finding.value * self.factor:.6g}"
        return with_expanded(self.finding.value * self.factor, self.finding.expanded * abs(self.factor))

    @property
    def limits(self) -> str:
        """Limits in words."""
        found = self.finding
        low, high = (None if each is None else f"{each * self.factor:.6g}" for each in (found.low, found.high))
        if low is not None and high is not None:
            sides = tr("{low} to {high}", low=low, high=high)
        elif low is not None:
            sides = tr("at least {low}", low=low)
        else:
            sides = tr("at most {high}", high=high) if high is not None else ""
        allowed_u = "" if found.u_max is None else tr("u at most {u_max}", u_max=f"{found.u_max * self.factor:.6g}")
        return tr(", ").join(filter(None, (sides, allowed_u)))

    @property
    def flags(self) -> str:
        """Flags in words; an unknown one unchanged."""
        known = {**CONTENTS, **REASONS}
        return tr(", ").join(tr(known.get(flag, flag)) for flag in self.finding.flags)

    @property
    def quantity(self) -> str:
        """Quantity in words."""
        return quantity_in_words(self.finding.quantity)

    @property
    def where(self) -> str:
        """Conditions in words; its id if they are not those of a known kind."""
        return conditions(self.finding.at, self._dwells) or self.finding.id


def conditions(at: Mapping[str, Any], dwells: Mapping[str, int] = MappingProxyType({})) -> str:
    """Return conditions of a result in words, with the numbers of `dwells`; "" if they cannot be read."""
    try:
        return where(at, dwells)
    except (ValueError, TypeError, KeyError, AttributeError):  # the file of a run is what somebody wrote
        return ""


def scaled(value: float, expanded: float, quantity: str, unit: str) -> str:
    """Return a value ± U in the displayed unit of its quantity, without the unit."""
    factor, _ = scale_shown(quantity, unit)
    return with_expanded(value * factor, expanded * abs(factor))


def bound(value: float, quantity: str, unit: str) -> str:
    """Return a bound in the displayed unit of its quantity, without the unit."""
    return f"{value * abs(scale_shown(quantity, unit)[0]):.6g}"


def difference(value: float, expanded: float, quantity: str, unit: str) -> str:
    """Return a difference with its sign, to the digits of an expanded uncertainty."""
    factor, _ = scale_shown(quantity, unit)
    digits = decimals(expanded * abs(factor))
    return f"{round(value * factor, digits) + 0.0:+.{digits}f}"  # never -0.0
