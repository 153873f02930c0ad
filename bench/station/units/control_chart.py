"""Control chart of individual values: limits from the moving range, and points that are not by chance alone.

Limits as in ISO 7870-2:2013 for individuals; the rules are those of Western Electric (Statistical Quality Control
Handbook, 1956). The limits are those of the first values, so that a later change does not widen them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

LEAST = 20  # values from which limits are computed
D2 = 1.128  # expected range of two values of a normal distribution, in standard deviations
BEYOND = {  # rule: of so many values in a row, so many are beyond so many standard deviations, on one side
    "Western Electric 1": (1, 1, 3.0),
    "Western Electric 2": (3, 2, 2.0),
    "Western Electric 3": (5, 4, 1.0),
    "Western Electric 4": (8, 8, 0.0),
}
RULES = {
    "Western Electric 1": "one value beyond 3 standard deviations",
    "Western Electric 2": "two of three values beyond 2 standard deviations on one side",
    "Western Electric 3": "four of five values beyond 1 standard deviation on one side",
    "Western Electric 4": "eight values in a row on one side of the centre",
}


class Signal(NamedTuple):
    """Rule that a value completes; `number` is that of the value, from 0."""

    number: int
    rule: str


class Chart(NamedTuple):
    """Centre and standard deviation of the first `baseline` values, and the signals of all."""

    centre: float
    sigma: float
    baseline: int
    signals: tuple[Signal, ...]

    @property
    def low(self) -> float:
        """Lower control limit."""
        return self.centre - 3.0 * self.sigma

    @property
    def high(self) -> float:
        """Upper control limit."""
        return self.centre + 3.0 * self.sigma


def control_chart(values: Sequence[float]) -> Chart | None:
    """Chart of values in the order of time; None for fewer than 20, or if the first 20 are all equal.

    Centre x̄ and σ = M̄R / 1.128 are those of the first 20 values; the limits are x̄ ± 3·σ.
    """
    if len(values) < LEAST:
        return None
    first = values[:LEAST]
    centre = sum(first) / LEAST
    ranges = [abs(after - before) for before, after in pairwise(first)]
    sigma = sum(ranges) / len(ranges) / D2
    if not sigma > 0.0:
        return None
    return Chart(centre, sigma, LEAST, tuple(_signals([(each - centre) / sigma for each in values])))


def _signals(scaled: Sequence[float]) -> Iterator[Signal]:
    """Yield the rules that each value completes: it is itself beyond, on the same side as the others."""
    for index, value in enumerate(scaled):
        side = 1.0 if value > 0.0 else -1.0
        for rule, (of, count, distance) in BEYOND.items():
            if index + 1 < of:
                continue
            last = [side * each > distance for each in scaled[index + 1 - of : index + 1]]
            if last[-1] and sum(last) >= count:
                yield Signal(index, rule)
