"""Current of a channel's input, from an ammeter in the cable of the source."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bench.methods.channel.reduction.line import ChannelRun
from bench.metrology.acquisition import Acquisition
from bench.metrology.gates import Gates
from bench.metrology.least_squares import Array
from bench.metrology.results.flag import INVALID
from bench.metrology.run_data import UnitUnderTest

FEWEST_READINGS = 3  # with fewer readings their scatter about a line is unknown


def believes_meter(unit: UnitUnderTest, settings: Mapping[str, Any]) -> bool:
    """True if the ammeter, and not the source, is the standard of the current."""
    return bool(unit.ammeter) and settings.get("current_from", "source") == "meter"


def standard_of(unit: UnitUnderTest, settings: Mapping[str, Any]) -> str:
    """Role of the instrument whose certificate applies to the current: the ammeter, or the source."""
    return unit.ammeter if believes_meter(unit, settings) else unit.source


@dataclass(frozen=True, slots=True)
class Metered:
    """Readings of an ammeter while a level was on, corrected by its certificate: `values_a` at `at_s`, (n,)."""

    at_s: Array
    values_a: Array

    @property
    def is_enough(self) -> bool:
        """True if the readings are enough for a mean and its scatter."""
        return len(self.values_a) >= FEWEST_READINGS

    @property
    def mean_a(self) -> float:
        """Mean current; NaN without readings."""
        return float(np.mean(self.values_a)) if self.is_enough else float("nan")

    @property
    def mean_u_a(self) -> float:
        """Standard uncertainty of the mean from the scatter of enough readings, including drift."""
        return float(np.std(self.values_a, ddof=1) / np.sqrt(len(self.values_a)))

    def change_per_c(self, gates: Gates) -> tuple[float, float]:
        """Relative change of the current with the temperature of the converter, and its uncertainty from scatter.

        It is the drift of the source during the ramp, which the output of the channel contains.
        """
        within = (self.at_s >= gates.time_s[0]) & (self.at_s <= gates.time_s[-1])
        if np.count_nonzero(within) < FEWEST_READINGS:
            return float("nan"), float("nan")
        converter_c = np.interp(self.at_s[within], gates.time_s, gates.converter_c)
        relative = self.values_a[within] / self.mean_a - 1
        away_c = converter_c - converter_c.mean()
        spread_c2 = float(away_c @ away_c)
        if not spread_c2:
            return float("nan"), float("nan")
        per_c = float(away_c @ relative) / spread_c2
        left = relative - relative.mean() - per_c * away_c
        return per_c, float(np.sqrt(left @ left / (len(left) - 2) / spread_c2))

    def without_drift(self, run: ChannelRun, reference_c: float) -> ChannelRun:
        """Line of a channel corrected to a constant input at the mean current; invalid if that is unknown."""
        per_c = self.change_per_c(run.gates)[0] if run.gates_used else float("nan")
        if not np.isfinite(per_c):
            lost = float("nan")
            flags = tuple(dict.fromkeys((*run.flags, INVALID)))
            return replace(run, rate=lost, slope_per_c=lost, flags=flags)
        followed_per_c = run.rate * per_c
        away_c = reference_c - float(np.mean(run.gates.converter_c))
        return replace(
            run,
            rate=run.rate - followed_per_c * away_c,
            slope_per_c=run.slope_per_c - followed_per_c,
        )


def metered(acquisitions: Iterable[Acquisition], unit: UnitUnderTest) -> Metered:
    """Readings of the ammeter of a unit during acquisitions."""
    read = [acquisition.currents[unit.ammeter] for acquisition in acquisitions if unit.ammeter in acquisition.currents]
    at_s, values_a = (
        np.concatenate([np.zeros(0), *(getattr(each, name) for each in read)]) for name in ("at_s", "values_a")
    )
    return Metered(at_s, values_a)
