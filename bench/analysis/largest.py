"""The largest of many values that scatter, with what the scatter gives to its budget and to its interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.analysis.extremes import interval_of_largest, largest_u
from bench.analysis.finding import BudgetLine, Interval
from bench.analysis.fit import Array


@dataclass(frozen=True, slots=True)
class Largest:
    """The largest |value|; `lines` and `interval` are of the scatter alone."""

    value: float
    lines: tuple[BudgetLine, ...]
    interval: Interval

    def times(self, factor: float) -> Largest:
        """The largest of the values, each `factor` times as large."""
        lines = tuple(line.times(abs(factor)) for line in self.lines)
        return Largest(abs(factor) * self.value, lines, self.interval.times(factor))


def largest_of(values: Array, sd: float, of: str, dof: int | None = None) -> Largest:
    """The largest |value| of (n,) that scatter by `sd`, which is known by `dof`; `of` names them: readings, samples."""
    by_scatter, by_selection = largest_u(values, sd)
    lines = (
        BudgetLine(f"{of}: scatter", "A", by_scatter, dof),
        BudgetLine(f"{of}: scatter makes the largest of many larger", "A", by_selection),
    )
    return Largest(float(np.max(np.abs(values))), lines, interval_of_largest(values, sd))
