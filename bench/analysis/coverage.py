"""Coverage factors: by how many standard uncertainties a value is stated, for a coverage of 95.45 %."""

from __future__ import annotations

from functools import lru_cache

COVERAGE = 2.0  # with unlimited degrees of freedom
PROBABILITY = 0.9545


@lru_cache(maxsize=256)
def coverage_factor(dof: int | None) -> float:
    """The factor k by which U = k·u covers 95.45 %, with so many effective degrees of freedom; None for unlimited.

    The quantile of Student's t, as table G.2 of JCGM 100:2008 lists it
    (https://www.bipm.org/documents/20126/2071204/JCGM_100_2008_E.pdf).
    """
    if dof is None:
        return COVERAGE
    from scipy.special import stdtrit

    return max(COVERAGE, float(stdtrit(dof, (1 + PROBABILITY) / 2)))
