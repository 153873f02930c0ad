"""How a chain of lags follows its input, exactly and without steps of time.

A lag follows with a time constant, a control loop with a natural period and a damping. Both are poles p in s; the chain
is G(s) = Π -p / (s - p), which partial fractions make a sum of exponentials.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable, Iterator
from functools import lru_cache

Poles = tuple[complex, ...]

OVER_AFTER = 40  # longest time constants; nothing is left of what happened before
_APART = 1e-4  # equal poles are moved apart by this part, since partial fractions need them distinct


def loop_poles(natural_period_s: float, damping: float) -> Poles:
    """Those of a control loop: ω (-ζ ± √(ζ² - 1))."""
    omega, root = 2 * math.pi / natural_period_s, cmath.sqrt(damping**2 - 1)
    return omega * (-damping + root), omega * (-damping - root)


def lag_poles(time_constants_s: Iterable[float]) -> Poles:
    """Those of lags one behind the other."""
    return tuple(complex(-1 / each) for each in time_constants_s)


def followed(poles: Poles, since_s: float, duration_s: float) -> float:
    """How much of a change of its input a chain has followed since the change began: 0 is nothing, 1 all of it.

    The input changes evenly over `duration_s`, or at once when that is 0.
    """
    if since_s <= 0:
        return 0.0
    if duration_s <= 0:
        return _after_a_step(poles, since_s)
    return (_on_a_slope(poles, since_s) - _on_a_slope(poles, since_s - duration_s)) / duration_s


def after_its_end(poles: Poles, duration_s: float) -> Iterator[tuple[complex, complex]]:
    """The terms (p, c) of what has been followed t seconds after the change has ended: 1 + Re Σ c e^(pt)."""
    for pole, weight in _fractions(poles):
        over = pole * duration_s
        yield pole, -weight * (cmath.exp(over) - 1) / over if duration_s > 0 else -weight


def over_after_s(poles: Poles, duration_s: float) -> float:
    """Time after its beginning at which a change has been followed completely, within what is measurable."""
    return duration_s + OVER_AFTER * max((-1 / pole.real for pole in poles), default=0.0)


def gain(poles: Poles, period_s: float) -> float:
    """How much of a swing of its input with this period comes out of a chain."""
    turning = 2j * math.pi / period_s
    return abs(math.prod((-pole / (turning - pole) for pole in poles), start=1 + 0j))


def _after_a_step(poles: Poles, t_s: float) -> float:
    """The answer to an input that steps from 0 to 1 at time 0: 1 - Σ w e^(pt)."""
    return 1 - math.fsum((weight * cmath.exp(pole * t_s)).real for pole, weight in _fractions(poles))


def _on_a_slope(poles: Poles, t_s: float) -> float:
    """The answer to an input that rises by 1 a second from time 0 on: t + Σ 1/p - Σ w/p e^(pt)."""
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
