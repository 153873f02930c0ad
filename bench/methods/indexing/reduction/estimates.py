"""Bias, scale factor and tilts of a unit as functions of every reading on an indexing table (equations 3.4)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from bench.methods.indexing.reduction.budget import IndexingBudget
from bench.methods.indexing.reduction.calibrate import StaticCalibration
from bench.methods.indexing.reduction.readings import IndexingReading
from bench.methods.indexing.reduction.sweep import LEAST_REPEATS
from bench.methods.indexing.reduction.two_ends import BothEnds, Clocking, fit_clocking, separate_coefficients
from bench.metrology.propagation import Estimate, Measured
from bench.metrology.run_data import RunData, UnitUnderTest

LEAST_CLOCKING = 1.0  # minimum range of cos ψ


class IndexingEstimates:
    """Results of one unit as functions of its readings: `rows` are those of both sweeps, then of the clocking.

    `fits` are the lines of the ends that have one, `tilts` the known angles of b3 and b4, in rad, positive if they
    raise the input axis.
    """

    def __init__(
        self,
        data: RunData,
        unit: UnitUnderTest,
        swept: Sequence[IndexingReading],
        found: StaticCalibration,
        clocked: Sequence[IndexingReading],
        platform: Measured | None,
    ) -> None:
        self._data, self._unit, self._clocked = data, unit, clocked
        self.fits = {name: end.fit for name, end in found.ends.items() if end is not None and end.fit is not None}
        by_number = {each.number: each for each in swept}
        self._used = {
            name: [by_number[int(number)] for number in fit.dwells.sequence] for name, fit in self.fits.items()
        }
        self.rows = [*(each for rows in self._used.values() for each in rows), *clocked]
        level = Measured(float(np.radians(data.bench.level_deg)), float(np.radians(data.bench.level_u_deg)))
        self.tilts = {"b3": level} | ({} if platform is None else {"b4": platform})

    def line(self, end: str) -> tuple[Estimate, Estimate]:
        """Bias and scale factor of an end."""
        fit = self.fits[end]
        first = 0 if end == "up" else len(self._used.get("up", ()))
        gain = np.zeros((2, len(self.rows)))
        gain[:, first : first + len(fit.dwells)] = fit.gain
        return Estimate(fit.bias_v, gain[0]), Estimate(fit.scale_v_per_g, gain[1])

    @cached_property
    def both(self) -> BothEnds | None:
        """Results of both ends together; None if one of them has no line."""
        if len(self.fits) < 2:
            return None
        lines = [line for name in ("up", "down") for line in self.line(name)]
        bias, scale, tilted, coupling = separate_coefficients(lines, self.fits["up"], self.fits["down"])
        known = scale * math.fsum(np.sin(tilt.value) for tilt in self.tilts.values())
        return BothEnds(bias, scale, tilted, coupling, self._seat, known)

    @property
    def _seat(self) -> Estimate | None:
        if self.clocking is None:
            return None
        gain = np.zeros(len(self.rows))
        gain[len(self.rows) - len(self._clocked) :] = self.clocking.gain
        return Estimate(self.clocking.p_v, gain)

    @cached_property
    def clocking(self) -> Clocking | None:
        """Fit over the clocking; None if its angles do not determine a tilt."""
        psi_rad = np.array([each.clock_rad for each in self._clocked])
        if len(psi_rad) < 2 or np.ptp(np.cos(psi_rad)) < LEAST_CLOCKING:
            return None
        return fit_clocking(psi_rad, np.array([each.output for each in self._clocked]))

    @cached_property
    def budget(self) -> IndexingBudget:
        """Sources of uncertainty of all results.

        The scatter is that of readings repeated without a move; if these are too few, that of readings at one angle
        from one side, which contains the repeatability of the head, or of the residuals. Both ends are pooled: they are
        read in the same way, and a few repeats determine a standard deviation poorly. The scatter is at least the
        single-reading uncertainty: repeats that agree by chance would otherwise make results more certain than any
        reading.
        """
        fits = list(self.fits.values())
        standing, moved = ([fit.repeats(standing=each) for fit in fits] for each in (True, False))
        residual = [(float(fit.residuals @ fit.residuals), len(fit.dwells) - len(fit.gain)) for fit in fits]
        stands = sum(dof for _, dof in standing) >= LEAST_REPEATS
        repeats = standing if stands else moved if sum(dof for _, dof in moved) >= LEAST_REPEATS else residual
        dof = sum(each for _, each in repeats)
        pooled = float(np.sqrt(sum(squares for squares, _ in repeats) / dof)) if dof else 0.0
        alone = float(np.sqrt(np.mean([each.single_u**2 for each in self.rows]))) if self.rows else 0.0
        swept = sum(len(used) for used in self._used.values())
        scale = float(np.mean([fit.scale_v_per_g for fit in self.fits.values()])) if self.fits else 0.0
        come_back = scale * float(np.radians(self._data.bench.head.repeatability_u_deg))
        still = pooled if stands else float(np.sqrt(max(pooled**2 - come_back**2, 0.0)))
        sd = np.repeat([max(pooled, alone), max(still, alone)], [swept, len(self._clocked)])
        return IndexingBudget(self._unit, self._data.bench, self.rows, sd, dof, scale, moves_scatter=not stands)

    def budget_with(self, end: str, further: Sequence[IndexingReading]) -> IndexingBudget:
        """Sources of uncertainty of results from the sweep of an end and from further readings, in that order."""
        rows = [*self._used[end], *further]
        return replace(self.budget, readings=rows, sd=np.full(len(rows), self.budget.sd[0]))

    @property
    def reading_sd_g(self) -> float:
        """Standard deviation of a reading of the sweeps, including the repeatability of the head, in g."""
        if not self.fits:
            return 0.0
        head_rad = 0.0 if self.budget.moves_scatter else np.radians(self._data.bench.head.repeatability_u_deg)
        return float(np.hypot(self.budget.sd[0] / self.budget.scale, head_rad))
