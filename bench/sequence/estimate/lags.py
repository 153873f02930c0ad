"""Exact response of a chain of lags to its input, without time steps.

A lag has a time constant, a control loop a natural period and a damping. Both give poles p in s; the chain is G(s) = Π
-p / (s - p), by partial fractions a sum of exponentials.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable, Iterator
from functools import lru_cache

Poles = tuple[complex, ...]

OVER_AFTER = 40  # longest time constants; earlier changes have decayed
_APART = 1e-4  # relative shift between equal poles, since partial fractions need distinct ones


def loop_poles(natural_period_s: float, damping: float) -> Poles:
    """Poles of a control loop: ω (-ζ ± √(ζ² - 1))."""
    omega, root = 2 * math.pi / natural_period_s, cmath.sqrt(damping**2 - 1)
    return omega * (-damping + root), omega * (-damping - root)


def lag_poles(time_constants_s: Iterable[float]) -> Poles:
    """Poles of lags in series."""
    return tuple(complex(-1 / each) for each in time_constants_s)


def followed(poles: Poles, since_s: float, duration_s: float) -> float:
    """Fraction of an input change that a chain has followed since the change began: 0 none, 1 all.

    The input changes linearly over `duration_s`, or in a step if that is 0.
    """
    if since_s <= 0:
        return 0.0
    if duration_s <= 0:
        return _after_a_step(poles, since_s)
    return (_on_a_slope(poles, since_s) - _on_a_slope(poles, since_s - duration_s)) / duration_s


def after_its_end(poles: Poles, duration_s: float) -> Iterator[tuple[complex, complex]]:
    """Terms (p, c) of the response t seconds after the end of the change: 1 + Re Σ c e^(pt)."""
    for pole, weight in _fractions(poles):
        over = pole * duration_s
        yield pole, -weight * (cmath.exp(over) - 1) / over if duration_s > 0 else -weight


def over_after_s(poles: Poles, duration_s: float) -> float:
    """Time from the beginning of a change after which the remainder is not measurable."""
    return duration_s + OVER_AFTER * max((-1 / pole.real for pole in poles), default=0.0)


def gain(poles: Poles, period_s: float) -> float:
    """Amplitude ratio of a chain for a sinusoidal input with this period."""
    turning = 2j * math.pi / period_s
    return abs(math.prod((-pole / (turning - pole) for pole in poles), start=1 + 0j))


def _after_a_step(poles: Poles, t_s: float) -> float:
    """Response to a unit step at time 0: 1 - Σ w e^(pt)."""
    return 1 - math.fsum((weight * cmath.exp(pole * t_s)).real for pole, weight in _fractions(poles))


def _on_a_slope(poles: Poles, t_s: float) -> float:
    """Response to a unit ramp (1 per second) from time 0: t + Σ 1/p - Σ w/p e^(pt)."""
    if t_s <= 0:
        return 0.0
    return t_s + math.fsum(((1 - weight * cmath.exp(pole * t_s)) / pole).real for pole, weight in _fractions(poles))


@lru_cache(maxsize=64)
def _fractions(poles: Poles) -> tuple[tuple[complex, complex], ...]:
    """Each pole p with the weight of its exponential, w = Π q / (q - p) over the other poles q."""
    distinct = [pole * (1 + _APART * index) for index, pole in enumerate(poles)]
    return tuple(
        (pole, math.prod((other / (other - pole) for other in distinct if other != pole), start=1 + 0j))
        for pole in distinct
    )
