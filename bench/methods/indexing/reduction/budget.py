"""What makes results of an indexing table uncertain, by how each depends on every reading (equations 1.9).

A result is an `Estimate` over the readings of both sweeps and of the clocking. The errors of the head turn the input
axis at every reading, whichever way it then lies: so an error that all positions share leaves what the clocking takes
out of the bias again. How well the head comes back to an angle is one error of all readings between two moves. Where
each reading of the sweeps has a move of its own before it, their scatter holds that; readings repeated while the head
stands scatter without it. Readings to which the head came from above are off by its backlash, all by the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bench.methods.indexing.reduction.readings import IndexingReading
from bench.metrology.bench_uncertainty import BenchRecord
from bench.metrology.instrument import STEPS, instrument_lines, shared_as
from bench.metrology.least_squares import Array
from bench.metrology.orientation import by_harmonics
from bench.metrology.propagation import Estimate
from bench.metrology.results.budget import BudgetLine, combined
from bench.metrology.run_data import UnitUnderTest
from bench.metrology.sampled_codes import by_position
from bench.metrology.thermometer_drift import source_of

SCATTER = "readings: scatter"
BACKLASH = "head: backlash"
LEVEL = "fixture: level"


class Source(NamedTuple):
    """A source of uncertainty by its name in a budget, and what findings share by it: None where each has its own."""

    name: str
    shared: str | None = None
    is_scatter: bool = False

    @classmethod
    def of(cls, name: str) -> Source:
        """An error that all findings have."""
        return cls(name, shared_as(name))


@dataclass(frozen=True)
class IndexingBudget:
    """The budgets of one unit: its `readings` (n,), the scatter of each, and its degrees of freedom.

    `moves_scatter` tells that the scatter of the sweeps holds how well the head comes back.
    """

    unit: UnitUnderTest
    bench: BenchRecord
    readings: Sequence[IndexingReading]
    sd: Array
    dof: int
    scale: float
    moves_scatter: bool

    def sources(self, gain: Array) -> Mapping[Source, Array]:
        """The standard uncertainties that each source gives to what depends on the readings by `gain` (n,).

        Several of one source are independent of each other. They have signs, which tell results that go together.
        """
        head_rad = np.array([each.head_rad for each in self.readings])
        turned = gain * np.array([each.turn for each in self.readings]) * self.scale
        head, values = self.bench.head, np.array([each.output for each in self.readings])
        together = float(turned.sum())
        from_above = np.array([each.came_from != "below" for each in self.readings])
        return {
            Source(SCATTER, is_scatter=True): gain * self.sd,
            Source.of("head: zero"): np.array([together * np.radians(head.zero_u_deg)]),
            Source.of("head: harmonics"): by_harmonics(turned, head_rad, head.harmonics_u_deg),
            Source("head: repeatability"): self._by_stand(turned) * np.radians(head.repeatability_u_deg),
            Source.of(BACKLASH): np.array([float(turned[from_above].sum()) * np.radians(head.backlash_u_deg or 0.0)]),
            Source.of(LEVEL): np.array([together * np.radians(self.bench.level_u_deg)]),
            Source.of(source_of(LEVEL, self.bench.level_drift)): np.array(
                [float(turned @ [each.run_share for each in self.readings]) * np.radians(self.bench.level_drift.u)]
            ),
            **self._instrument(gain, values, head_rad),
        }

    def _by_stand(self, turned: Array) -> Array:
        """Sums over the readings between two moves, of those whose scatter does not hold how the head comes back."""
        stand = np.array([each.stand for each in self.readings], dtype=np.int_)
        scattered = np.array([self.moves_scatter and each.kind == "sweep" for each in self.readings], dtype=np.bool_)
        return np.asarray(np.bincount(stand[~scattered], turned[~scattered], minlength=1), np.float64)

    def _instrument(self, gain: Array, values: Array, head_rad: Array) -> Mapping[Source, Array]:
        if self.unit.telemetry is not None:
            step_u = np.array([each.step_u for each in self.readings])
            return {Source(f"{self.unit.telemetry}{STEPS}"): by_position(gain, step_u, head_rad)}
        lines = instrument_lines(self.unit, self.bench, float(gain @ values), float(gain.sum()))
        return {Source(line.source, line.shared): np.array([line.u]) for line in lines}

    def lines(self, result: Estimate, without: Sequence[str] = ()) -> tuple[BudgetLine, ...]:
        """The budget of a result; `without` the sources that make what it is of, not an error of it."""
        return combined([
            self._line(source, float(np.linalg.norm(parts)))
            for source, parts in self.sources(result.gain).items()
            if source.name not in without
        ])  # fmt: skip

    def _line(self, source: Source, u: float) -> BudgetLine:
        if source.is_scatter:
            return BudgetLine(source.name, "A", u, self.dof or None)
        return BudgetLine(source.name, "B", u, None, source.shared)

    def correlation(self, results: Sequence[Estimate]) -> tuple[tuple[float, ...], ...]:
        """How results go together, by all their sources."""
        rows = np.array([np.concatenate([*self.sources(result.gain).values()]) for result in results])
        sizes = np.linalg.norm(rows, axis=1)
        matrix = rows @ rows.T / np.outer(sizes, sizes) if np.all(sizes) else np.eye(len(rows))
        return tuple(tuple(float(value) for value in row) for row in matrix)
