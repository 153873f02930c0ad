"""Limits of a result, and the decision on conformity.

A value is compared with the limits themselves (simple acceptance) or, if they have a guard band, with an acceptance
interval that is narrower by the band on each side (guarded acceptance; JCGM 106, 8.2 and 8.3.2). Both rules are binary:
a value is accepted or rejected. A limit of the standard uncertainty is a condition for both.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

from bench.metrology.results.coverage import COVERAGE

# Reasons why a value between its limits has another verdict than PASS.
IN_GUARD_BAND = "guard_band"
GUARD_BANDS_MEET = "guard_bands_meet"
U_UNKNOWN = "u_unknown"
U_TOO_LARGE = "u_too_large"


class Limits(NamedTuple):
    """Limits of a value, in its unit: from `low` to `high`, both included; None leaves a side open.

    `target` is the nominal value if the limits are a tolerance about it. The guard band is `guard_k` standard
    uncertainties wide, by unlimited degrees of freedom; None for simple acceptance. A value is marginal closer to a
    limit than `marginal`; None for its expanded uncertainty. `u_max` is the largest standard uncertainty of the value,
    in its unit, `u_max_relative` the same as a ratio of the value; None without such a limit.
    """

    low: float | None = None
    high: float | None = None
    target: float | None = None
    guard_k: float | None = None
    marginal: float | None = None
    u_max: float | None = None
    u_max_relative: float | None = None

    def u_allowed(self, value: float) -> float | None:
        """Largest standard uncertainty of a value, in its unit; None without a limit."""
        return self.u_max if self.u_max_relative is None else self.u_max_relative * abs(value)

    def room(self, value: float) -> float:
        """Distance from a value to the nearer limit, negative outside, infinite without a limit."""
        below = math.inf if self.low is None else value - self.low
        above = math.inf if self.high is None else self.high - value
        return min(below, above)

    def is_marginal(self, value: float, expanded: float | None) -> bool:
        """True if the value is marginal, on either side of a limit; false if neither a width nor U is known."""
        width = expanded if self.marginal is None else self.marginal
        return width is not None and self.is_within(width, value)

    def is_within(self, width: float, value: float) -> bool:
        """True if a limit is closer to a value than `width`, on either side of it."""
        return any(abs(value - side) < width for side in (self.low, self.high) if side is not None)


class Judgement(NamedTuple):
    """A verdict, `marginal`, and the reason if a value between its limits was not accepted or its u is too large."""

    verdict: Literal["PASS", "FAIL", "INVALID"]
    marginal: bool
    flag: str | None = None


def judge(value: float, u: float | None, limits: Limits, k: float = COVERAGE) -> Judgement:
    """Decide on a value with the standard uncertainty `u`, None if unknown, and coverage factor `k`.

    With few degrees of freedom `k` is more than 2, and the guard band is wider in the same proportion.

    FAIL for a value outside its limits, with `guard_band` for one inside the guard band. INVALID if the guard band
    permits no decision: u is unknown (`u_unknown`), or so large that no value could be accepted (`guard_bands_meet`),
    which is a problem of the bench and not of the unit. For the same reason INVALID if u is above its own limit
    (`u_too_large`) or unknown; a value outside its limits is FAIL nevertheless, with that flag.
    """
    marginal, room = limits.is_marginal(value, None if u is None else k * u), limits.room(value)
    too_large = _reason_of_u(u, limits.u_allowed(value))
    if not room >= 0:  # not-a-number is outside, too
        return Judgement("FAIL", marginal, too_large)
    if too_large is not None:
        return Judgement("INVALID", marginal, too_large)
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


def _reason_of_u(u: float | None, allowed: float | None) -> str | None:
    """Reason why a standard uncertainty is not accepted; None if it is."""
    if allowed is None:
        return None
    if u is None:
        return U_UNKNOWN
    return None if u <= allowed else U_TOO_LARGE
