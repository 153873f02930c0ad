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

if TYPE_CHECKING:  # imported for types only: findings are shown where numpy is not loaded
    from bench.metrology.calibration.response import ResponseCompensation
    from bench.metrology.calibration.temperature import Compensation

CONFIDENCE = 0.95  # coverage of an interval
NOT_CLOSED = "not_closed"  # flag of a finding of a unit or bench that changed during the run
LOWER_BOUND = "more_than"  # flag of a value that is only a lower bound
Verdict = Literal["PASS", "FAIL", "INVALID"]


@dataclass(frozen=True, slots=True)
class Interval:
    """Range of the true value of a result that is not a linear function of the readings.

    Such as a largest value, a standard deviation or a settling time; its coverage is at least 95 %. `from_scatter` is
    the value expected from scatter alone.
    """

    low: float
    high: float
    from_scatter: float

    def beside(self, u: float) -> Interval:
        """Range with an additional standard uncertainty `u` not contained in the scatter."""
        half = (self.high - self.low) / 2
        more = math.hypot(half, COVERAGE * u) - half
        return replace(self, low=max(self.low - more, 0.0), high=self.high + more)

    def times(self, factor: float) -> Interval:
        """Range of `factor` times the value, without the sign."""
        return Interval(*(abs(factor) * value for value in (self.low, self.high, self.from_scatter)))


@dataclass(frozen=True, slots=True)
class Finding:
    """One result of one unit. `at` are its conditions, `steps` the steps of the run it is from.

    A largest value, a standard deviation and a settling time are not linear functions of the readings; they have an
    `interval` beside their budget. `monthly_drift` is the specified largest change in a month, in its unit; it is no
    part of the uncertainty.
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
    monthly_drift: float | None = None

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
        """Coverage factor by the effective degrees of freedom, 2 if they are unlimited."""
        return coverage_factor(self.dof)

    @property
    def expanded(self) -> float:
        """Expanded uncertainty U = k·u."""
        return self.k * self.u

    @property
    def marginal(self) -> bool:
        """True if a limit is so close that a repeated measurement might give another verdict.

        Also true if the unit changed between the beginning and the end of the run.
        """
        limits = self.limits
        return limits is not None and (NOT_CLOSED in self.flags or limits.is_marginal(self.value, self.expanded))

    @property
    def within_u(self) -> bool:
        """True if a limit is within the expanded uncertainty, on either side."""
        if self.limits is None or self.verdict not in ("PASS", "FAIL"):
            return False
        return self.limits.is_within(self.expanded, self.value)

    def flagged(self, flag: str) -> Finding:
        """The same finding with one more flag."""
        return replace(self, flags=(*self.flags, flag))

    def judged(self, limits: Limits) -> Finding:
        """The same finding with limits and, unless already invalid, a verdict, with a flag for its reason if needed.

        An empty budget gives no uncertainty. A value that is only a lower bound can exceed an upper limit, but cannot
        be shown to keep it.
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
    """Unit and label of findings: the unit in a place, and the label of its measurement."""

    label: str
    place: str
    uut: str

    def id(self, quantity: str) -> str:
        """Id of a finding; `tail` distinguishes several of one quantity."""
        return f"{self.label}/{self.place}/{quantity}"

    def part(self, name: str) -> Subject:
        """Subject for one axis or direction of the unit."""
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
        """A finding with the lines of its budget that contribute, not judged yet.

        INVALID if a line is not a finite number, because the uncertainty is then unknown.
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
    """Record that a unit was dropped from a run, with the reason; `bad` if the unit itself is proved to have failed."""

    at_s: float
    fault: str
    bad: bool
    text: str


@dataclass(frozen=True, slots=True)
class UnitResult:
    """Everything one method found of one unit.

    `left_out` names the parts that could not be reduced, `flags` are those of the unit as a whole. `detail` is the data
    for the method's own part of the report; it is not stored with the results. `compensations` go into the calibration
    file of the unit. `dropped` is set if it did not take part to the end: earlier findings are kept, but do not count
    for the verdict.
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
        """INCOMPLETE if something is left out, invalid, or nothing found (equations 1.10); else by the limits.

        NOT JUDGED if no finding has a limit.

        A unit that was dropped is INCOMPLETE, or FAIL if it is proved to be bad.
        """
        if self.dropped is not None:
            return "FAIL" if self.dropped.bad else "INCOMPLETE"
        verdicts = {finding.verdict for finding in self.findings}
        if self.left_out or "INVALID" in verdicts or not self.findings:
            return "INCOMPLETE"
        if verdicts == {None}:
            return "NOT JUDGED"
        return "FAIL" if "FAIL" in verdicts else "PASS"
