"""A result that can be signed: value, unit, uncertainty with its budget, limits and verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

from bench.metrology.results.budget import BudgetLine, combined
from bench.metrology.results.coverage import COVERAGE, coverage_factor, effective_dof
from bench.metrology.results.curves import Model
from bench.metrology.results.flag import Flag
from bench.metrology.results.limits import U_UNKNOWN, Limits, judge

if TYPE_CHECKING:  # findings are shown where no arithmetic is loaded
    from bench.metrology.calibration.response import ResponseCompensation
    from bench.metrology.calibration.temperature import Compensation

CONFIDENCE = 0.95  # of an interval
NOT_CLOSED = "not_closed"  # the flag of a finding of a unit or bench that changed over the run
LOWER_BOUND = "more_than"  # the flag of a value of which is only known that it is more
Verdict = Literal["PASS", "FAIL", "INVALID"]


@dataclass(frozen=True, slots=True)
class Interval:
    """The range that holds what is true of a value that is no linear function of the readings.

    That is a largest value, a standard deviation, a time to settle; it holds in 95 of 100 runs at least.
    `from_scatter` is what the scatter of the values would be expected to make of it if nothing else were there.
    """

    low: float
    high: float
    from_scatter: float

    def beside(self, u: float) -> Interval:
        """The range of a value that is uncertain by `u`, too, which scatter does not tell."""
        half = (self.high - self.low) / 2
        more = math.hypot(half, COVERAGE * u) - half
        return replace(self, low=max(self.low - more, 0.0), high=self.high + more)

    def times(self, factor: float) -> Interval:
        """The range of a value that is `factor` times the one it is of, without its sign."""
        return Interval(*(abs(factor) * value for value in (self.low, self.high, self.from_scatter)))


@dataclass(frozen=True, slots=True)
class Finding:
    """One result of one unit. `at` says under which conditions, `steps` from which steps of the run.

    A largest value, a standard deviation and a time to settle are no linear function of the readings, so that they have
    an `interval` beside their budget.
    """

    id: str
    uut: str
    quantity: str
    name: str
    at: Mapping[str, Any]
    value: float
    unit: str
    budget: tuple[BudgetLine, ...]
    steps: tuple[str, ...]
    limits: Limits | None = None
    verdict: Verdict | None = None
    flags: tuple[str, ...] = ()
    interval: Interval | None = None

    @property
    def u(self) -> float:
        """Combined standard uncertainty."""
        return math.sqrt(math.fsum(line.u**2 for line in self.budget))

    @property
    def dof(self) -> int | None:
        """Effective degrees of freedom; None for unlimited."""
        return effective_dof([(line.u, line.dof) for line in self.budget])

    @property
    def k(self) -> float:
        """Coverage factor by the effective degrees of freedom, 2 where they are unlimited."""
        return coverage_factor(self.dof)

    @property
    def expanded(self) -> float:
        """Expanded uncertainty U = k·u."""
        return self.k * self.u

    @property
    def marginal(self) -> bool:
        """Whether a limit is so close that the verdict could be another if the measurement were repeated.

        So it is where the unit was not the same at the end of the run as at its beginning.
        """
        limits = self.limits
        return limits is not None and (NOT_CLOSED in self.flags or limits.is_marginal(self.value, self.expanded))

    @property
    def within_u(self) -> bool:
        """Whether a limit that it was held against is within its expanded uncertainty, whichever side it is on."""
        if self.limits is None or self.verdict not in ("PASS", "FAIL"):
            return False
        return self.limits.is_within(self.expanded, self.value)

    def flagged(self, flag: str) -> Finding:
        """The same finding with one more flag."""
        return replace(self, flags=(*self.flags, flag))

    def judged(self, limits: Limits) -> Finding:
        """The same finding with limits and, unless it is invalid already, a verdict, flagged where that needs a reason.

        A budget of nothing tells no uncertainty. What is only known to be more than its value can exceed a
        limit, not keep below it.
        """
        if self.verdict == "INVALID":
            return replace(self, limits=limits)
        judgement = judge(self.value, self.u or None, limits, self.k)
        if judgement.verdict == "PASS" and limits.high is not None and LOWER_BOUND in self.flags:
            return replace(self, limits=limits, verdict="INVALID")
        flags = self.flags if judgement.flag is None else (*self.flags, judgement.flag)
        return replace(self, limits=limits, verdict=judgement.verdict, flags=flags)


@dataclass(frozen=True, slots=True)
class Subject:
    """Whom findings are of: the unit in a place, and the label under which a run measured it."""

    label: str
    place: str
    uut: str

    def id(self, quantity: str) -> str:
        """The id of a finding; of one of several `tail` comes behind it."""
        return f"{self.label}/{self.place}/{quantity}"

    def part(self, name: str) -> Subject:
        """One axis or direction of the unit."""
        return replace(self, place=f"{self.place}/{name}")

    def finding(
        self,
        quantity: str,
        name: str,
        value: float,
        unit: str,
        lines: Sequence[BudgetLine],
        at: Mapping[str, Any],
        steps: tuple[str, ...],
        tail: str = "",
        flags: tuple[str, ...] = (),
        interval: Interval | None = None,
    ) -> Finding:
        """A finding with what contributes of the lines of its budget, not judged yet.

        INVALID where a line is not a finite number: how far off the value may be is not known.
        """
        known = [line for line in lines if math.isfinite(line.u)]
        is_known = len(known) == len(lines)
        return Finding(
            id=f"{self.id(quantity)}{tail}",
            uut=self.uut,
            quantity=quantity,
            name=name,
            at=at,
            value=float(value),
            unit=unit,
            budget=combined(known),
            steps=steps,
            verdict=None if is_known else "INVALID",
            flags=flags if is_known else (*flags, U_UNKNOWN),
            interval=interval,
        )


@dataclass(frozen=True, slots=True)
class Dropped:
    """That a unit was dropped from a run, and why; `bad` where the unit itself is proved to have failed."""

    at_s: float
    fault: str
    bad: bool
    text: str


@dataclass(frozen=True, slots=True)
class UnitResult:
    """Everything one method found of one unit.

    `left_out` names the parts that could not be reduced, `flags` are those of the unit as a whole. `detail` is what the
    method's own part of the report is drawn from; it is not kept with the results. `compensations` go into
    the calibration file of the unit. `dropped` where it did not take part to the end: what was found before is kept,
    and judges nothing.
    """

    place: str
    uut: str
    findings: tuple[Finding, ...]
    models: tuple[Model, ...]
    left_out: tuple[str, ...]
    flags: tuple[Flag, ...]
    detail: object = None
    compensations: tuple[Compensation | ResponseCompensation, ...] = ()
    dropped: Dropped | None = None

    @property
    def verdict(self) -> Literal["PASS", "FAIL", "INCOMPLETE", "NOT JUDGED"]:
        """INCOMPLETE when something is left out, invalid, or nothing found (equations 1.10); else by the limits.

        NOT JUDGED where no finding has a limit.

        A unit that was dropped is INCOMPLETE, or FAIL where it is proved to be bad.
        """
        if self.dropped is not None:
            return "FAIL" if self.dropped.bad else "INCOMPLETE"
        verdicts = {finding.verdict for finding in self.findings}
        if self.left_out or "INVALID" in verdicts or not self.findings:
            return "INCOMPLETE"
        if verdicts == {None}:
            return "NOT JUDGED"
        return "FAIL" if "FAIL" in verdicts else "PASS"
