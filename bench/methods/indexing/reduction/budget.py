"""Uncertainty of results of an indexing table, from their sensitivity to every reading (equations 1.9).

A result is an `Estimate` over the readings of both sweeps and of the clocking. The errors of the head turn the input
axis at every reading, whatever the end: so an error common to all positions is removed from the bias by the clocking.
The repeatability of the head is one error of all readings between two moves. If each reading of the sweeps has its own
move before it, their scatter contains the repeatability; readings repeated without a move scatter without it. Readings
approached from above have a common error, the backlash.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bench.methods.indexing.reduction.readings import IndexingReading
from bench.metrology.bench_uncertainty import BenchRecord
from bench.metrology.instrument import STEPS, instrument_lines
from bench.metrology.least_squares import Array
from bench.metrology.orientation import by_harmonics
from bench.metrology.propagation import Estimate
from bench.metrology.results.budget import BudgetLine, combined, common
from bench.metrology.run_data import UnitUnderTest
from bench.metrology.sampled_codes import quantisation_by_angle
from bench.metrology.thermometer_drift import source_of

SCATTER = "readings: scatter"
BACKLASH = "head: backlash"
LEVEL = "fixture: level"
TILT = "tilt"  # the kind of the lines of the tilt of the seat


@dataclass(frozen=True)
class IndexingBudget:
    """Budgets of one unit: its `readings` (n,), the scatter of each, and its degrees of freedom.

    `moves_scatter` is true if the scatter of the sweeps contains the repeatability of the head.
    """

    unit: UnitUnderTest
    bench: BenchRecord
    readings: Sequence[IndexingReading]
    sd: Array
    dof: int
    scale: float
    moves_scatter: bool

    def sources(self, gain: Array) -> Mapping[BudgetLine, Array]:
        """Gains, by source, of a result with sensitivities `gain` (n,) to the readings.

        Several of one source are those to independent errors of it. Their signs determine correlations between results.
        """
        head_rad = np.array([each.head_rad for each in self.readings])
        turned = gain * np.array([each.turn for each in self.readings]) * self.scale
        head, values = self.bench.head, np.array([each.output for each in self.readings])
        together, level_drift = np.array([turned.sum()]), self.bench.level_drift
        from_above = np.array([each.came_from != "below" for each in self.readings])
        return {
            BudgetLine(SCATTER, "A", 1.0, self.dof or None): gain * self.sd,
            common("head: zero", np.radians(head.zero_u_deg), TILT): together,
            common("head: harmonics", 1.0, TILT): by_harmonics(turned, head_rad, head.harmonics_u_deg),
            BudgetLine("head: repeatability", "B", float(np.radians(head.repeatability_u_deg))): self._by_stand(turned),
            common(BACKLASH, np.radians(head.backlash_u_deg or 0.0)): np.array([turned[from_above].sum()]),
            self.bench.level._replace(kind=TILT): together,
            common(source_of(LEVEL, level_drift), np.radians(level_drift.u)): np.array(
                [turned @ [each.run_share for each in self.readings]]
            ),
            **self._instrument(gain, values, head_rad),
        }

    def _by_stand(self, turned: Array) -> Array:
        """Sums over the readings between two moves, if the scatter does not contain the repeatability of the head."""
        stand = np.array([each.stand for each in self.readings], dtype=np.int_)
        scattered = np.array([self.moves_scatter and each.kind == "sweep" for each in self.readings], dtype=np.bool_)
        return np.asarray(np.bincount(stand[~scattered], turned[~scattered], minlength=1), np.float64)

    def _instrument(self, gain: Array, values: Array, head_rad: Array) -> Mapping[BudgetLine, Array]:
        if self.unit.telemetry is not None:
            quantisation_u = np.array([each.quantisation_u for each in self.readings])
            steps = BudgetLine(f"{self.unit.telemetry}{STEPS}", "B", 1.0)
            return {steps: quantisation_by_angle(gain, quantisation_u, head_rad)}
        lines = instrument_lines(self.unit, self.bench, float(gain @ values), float(gain.sum()))
        return {line: np.ones(1) for line in lines}

    def lines(self, result: Estimate, without: str = "") -> tuple[BudgetLine, ...]:
        """Budget of a result; sources of the kind `without` are part of the quantity, not errors of it."""
        return combined([
            source._replace(u=float(np.linalg.norm(source.u * gains)))
            for source, gains in self.sources(result.gain).items()
            if not without or source.kind != without
        ])  # fmt: skip

    def rows(self, results: Sequence[Estimate]) -> Array:
        """Contributions of all sources to results, a row (m,) for each; rows @ rows.T is their covariance."""
        return np.array([
            np.concatenate([source.u * gains for source, gains in self.sources(result.gain).items()])
            for result in results
        ])  # fmt: skip

    def correlation(self, results: Sequence[Estimate]) -> tuple[tuple[float, ...], ...]:
        """Correlation matrix of results, from all their sources."""
        rows = self.rows(results)
        sizes = np.linalg.norm(rows, axis=1)
        matrix = rows @ rows.T / np.outer(sizes, sizes) if np.all(sizes) else np.eye(len(rows))
        return tuple(tuple(float(value) for value in row) for row in matrix)
