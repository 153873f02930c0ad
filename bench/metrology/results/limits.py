"""Limits of a result, and the decision whether a value is accepted.

A value is held against the limits as it is (simple acceptance), or, where they have a guard band, against an acceptance
interval that is narrower by the band on each side (guarded acceptance; JCGM 106, 8.2 and 8.3.2). Both rules are binary:
what is not accepted is rejected.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

from bench.metrology.results.coverage import COVERAGE

# Why a value between its limits has another verdict than PASS.
IN_GUARD_BAND = "guard_band"
GUARD_BANDS_MEET = "guard_bands_meet"
U_UNKNOWN = "u_unknown"


class Limits(NamedTuple):
    """What a value may be, in its unit: from `low` to `high`, both included; None leaves a side open.

    `target` is the value meant, where the limits are a tolerance about one. The guard band is `guard_k` standard
    uncertainties wide, by degrees of freedom without limit; None for simple acceptance. A value is marginal closer to a
    limit than `marginal`; None for its expanded uncertainty.
    """

    low: float | None = None
    high: float | None = None
    target: float | None = None
    guard_k: float | None = None
    marginal: float | None = None

    def room(self, value: float) -> float:
        """How far inside a value is: its distance to the nearer limit, negative outside, infinite without a limit."""
        below = math.inf if self.low is None else value - self.low
        above = math.inf if self.high is None else self.high - value
        return min(below, above)

    def is_marginal(self, value: float, expanded: float | None) -> bool:
        """Whether a limit is that close, on either side of it; never when neither a width nor U is known."""
        width = expanded if self.marginal is None else self.marginal
        return width is not None and self.is_within(width, value)

    def is_within(self, width: float, value: float) -> bool:
        """Whether a limit is closer to a value than `width`, on either side of it."""
        return any(abs(value - side) < width for side in (self.low, self.high) if side is not None)


class Judgement(NamedTuple):
    """A verdict, whether the value is marginal, and why a value between its limits was not accepted, if it was not."""

    verdict: Literal["PASS", "FAIL", "INVALID"]
    marginal: bool
    flag: str | None = None


def judge(value: float, u: float | None, limits: Limits, k: float = COVERAGE) -> Judgement:
    """The decision on a value with the standard uncertainty `u`, None where that is not known, and coverage factor `k`.

    With few degrees of freedom `k` is more than 2, and the guard band is wider in the same proportion.

    FAIL for a value outside its limits, with `guard_band` for one inside the guard band. INVALID where the guard band
    lets nothing be decided: u is not known (`u_unknown`), or so large that no value could be accepted
    (`guard_bands_meet`), which is the bench's fault and not the unit's.
    """
    marginal, room = limits.is_marginal(value, None if u is None else k * u), limits.room(value)
    if not room >= 0:  # not a number is outside, too
        return Judgement("FAIL", marginal)
    if limits.guard_k is None:
        return Judgement("PASS", marginal)
    if u is None:
        return Judgement("INVALID", marginal, U_UNKNOWN)
    guard = limits.guard_k * u * k / COVERAGE
    if room >= guard:
        return Judgement("PASS", marginal)
    if limits.low is not None and limits.high is not None and limits.high - limits.low < 2 * guard:
        return Judgement("INVALID", marginal, GUARD_BANDS_MEET)
    return Judgement("FAIL", marginal, IN_GUARD_BAND)
