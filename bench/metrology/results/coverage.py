"""Coverage factors for a coverage of 95.45 %."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

COVERAGE = 2.0  # with unlimited degrees of freedom
PROBABILITY = 0.9545
UNLIMITED_DOF = 1000  # larger values are reported as unlimited
ROUNDING = 1e-9  # rounding of the quotient of sums that gives degrees of freedom


def effective_dof(parts: Sequence[tuple[float, int | None]]) -> int | None:
    """Effective degrees of freedom of a sum of standard uncertainties with their own; None for unlimited.

    Welch-Satterthwaite, truncated (JCGM 100, G.4.1). Not-finite parts give none.
    """
    limited = math.fsum(u**4 / dof for u, dof in parts if dof)
    whole = math.fsum(u**2 for u, _ in parts) ** 2
    if not limited or not math.isfinite(whole / limited):
        return None
    dof = math.floor(whole / limited * (1 + ROUNDING))
    return dof if dof <= UNLIMITED_DOF else None


@lru_cache(maxsize=256)
def coverage_factor(dof: int | None) -> float:
    """Coverage factor k for which U = k·u covers 95.45 %, for effective degrees of freedom; None for unlimited.

    Quantile of Student's t, as in table G.2 of JCGM 100:2008
    (https://www.bipm.org/documents/20126/2071204/JCGM_100_2008_E.pdf).
    """
    if dof is None:
        return COVERAGE
    from scipy.special import stdtrit

    return max(COVERAGE, float(stdtrit(dof, (1 + PROBABILITY) / 2)))
