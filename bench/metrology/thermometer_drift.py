"""Effect of a thermometer error that changes within a run on differences over time (equations 6.2).

The error is assumed to change linearly from the beginning of the run to its end. At bench time t it is D s(t), with s
from -½ to ½ and one D for the whole run, of which a certificate states the standard uncertainty. A result that depends
on temperatures of several times by c(t) per °C has the uncertainty |Σ c(t) s(t)| u(D). A part that is constant over
these times is an offset, and is in that line.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.metrology.bench_uncertainty import Drift
from bench.metrology.least_squares import Array
from bench.metrology.results.budget import BudgetLine
from bench.metrology.run_data import RunData

DRIFT = "drift within the run"
NOT_STATED = "not stated, a fifth of its offset"


def source_of(what: str, drift: Drift) -> str:
    """Name of the budget line of a drift within the run."""
    return f"{what}: {DRIFT}" if drift.is_stated else f"{what}: {DRIFT}, {NOT_STATED}"


@dataclass(frozen=True, slots=True)
class DriftInRun:
    """The drift of the thermometer behind a reading within a run."""

    data: RunData
    reading: str

    @property
    def _known(self) -> Drift:
        return self.data.bench.thermometer_drift(self.reading)

    def error_c(self, at_s: Array) -> Array:
        """Error (n,) of the temperatures at bench times (n,), for a drift of one standard uncertainty."""
        return self.data.run_share(at_s) * self._known.u

    def line(self, u: float | np.floating) -> BudgetLine:
        """Budget line with the contribution `u` of the drift."""
        return BudgetLine(source_of(self.reading, self._known), "B", abs(float(u)), None, f"{self.reading}.drift")
