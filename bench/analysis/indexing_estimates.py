"""Bias, scale factor and tilts of a unit as they depend on every reading on an indexing table (methods.md 3.4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bench.analysis.indexing_budget import IndexingBudget
from bench.analysis.indexing_readings import IndexingReading
from bench.analysis.propagation import Estimate, Measured
from bench.analysis.rundata import RunData, UnitUnderTest
from bench.analysis.static_calibration import StaticCalibration
from bench.analysis.two_ends import Clocking, fit_clocking, taken_apart

LEAST_CLOCKING = 1.0  # by which cos ψ must change


@dataclass(frozen=True, slots=True)
class BothEnds:
    """What both ends tell: `seat` is all that the tilt of the seat adds to the output, None without a clocking.

    `known_seat` is what is known of it without one. `tilted` is K1 times the misalignment; it and the cross coupling
    are None where the angles do not tell them.
    """

    bias: Estimate
    scale: Estimate
    tilted: Estimate | None
    coupling: Estimate | None
    seat: Estimate | None
    known_seat: Estimate

    @property
    def tilt(self) -> Estimate:
        """What is taken for the tilt of the seat."""
        return self.known_seat if self.seat is None else self.seat

    @property
    def corrected(self) -> Estimate:
        """The bias without any tilt."""
        return self.bias - self.tilt


class IndexingEstimates:
    """The results of one unit as they depend on its readings: `rows` are those of both sweeps, then of the clocking.

    `fits` are the lines of the ends that have one, `tilts` what is known of b3 and b4, in rad, positive when they raise
    the input axis.
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
        """What both ends tell; None when one of them has no line."""
        if len(self.fits) < 2:
            return None
        lines = [line for name in ("up", "down") for line in self.line(name)]
        bias, scale, tilted, coupling = taken_apart(lines, self.fits["up"], self.fits["down"])
        known_rad = sum(tilt.value for tilt in self.tilts.values())
        return BothEnds(bias, scale, tilted, coupling, self._seat, scale * float(np.sin(known_rad)))

    @property
    def _seat(self) -> Estimate | None:
        if self.clocking is None:
            return None
        gain = np.zeros(len(self.rows))
        gain[len(self.rows) - len(self._clocked) :] = self.clocking.gain
        return Estimate(self.clocking.p_v, gain)

    @cached_property
    def clocking(self) -> Clocking | None:
        """The fit over the clocking; None when its angles do not tell a tilt."""
        psi_rad = np.array([each.clock_rad for each in self._clocked])
        if len(psi_rad) < 2 or np.ptp(np.cos(psi_rad)) < LEAST_CLOCKING:
            return None
        return fit_clocking(psi_rad, np.array([each.output for each in self._clocked]))

    @cached_property
    def budget(self) -> IndexingBudget:
        """What makes all of it uncertain; during the clocking the head stands still, so that it adds no scatter.

        The scatter is that of both ends together: they are read in the same way, and a few repeats on one of them tell
        a standard deviation badly. Nor is a reading believed to scatter less than what it alone tells: repeats that
        come out near each other by chance would make results more certain than any reading is.
        """
        repeats = [fit.repeats for fit in self.fits.values()]
        dof = sum(each for _, each in repeats)
        pooled = float(np.sqrt(sum(sd**2 * each for sd, each in repeats) / dof)) if dof else 0.0
        alone = float(np.sqrt(np.mean([each.alone_u**2 for each in self.rows]))) if self.rows else 0.0
        swept = sum(len(used) for used in self._used.values())
        scale = float(np.mean([fit.scale_v_per_g for fit in self.fits.values()])) if self.fits else 0.0
        come_back = scale * float(np.radians(self._data.bench.head.repeatability_u_deg))
        still = float(np.sqrt(max(pooled**2 - come_back**2, 0.0)))
        sd = np.repeat([max(pooled, alone), max(still, alone)], [swept, len(self._clocked)])
        return IndexingBudget(self._unit, self._data.bench, self.rows, sd, dof, scale)

    @property
    def reading_sd_g(self) -> float:
        """Standard deviation of a reading of the sweeps, in g."""
        return float(self.budget.sd[0] / abs(self.budget.scale)) if self.fits else 0.0
