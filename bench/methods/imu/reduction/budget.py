"""Contributions to the budgets of an inertial unit other than the table: scatter, clocks, encoders, quantisation."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from bench.methods.imu.reduction.windows import Turning
from bench.metrology.acquisition import Acquisition, Array
from bench.metrology.bench_uncertainty import BenchRecord
from bench.metrology.results.budget import BudgetLine, common
from bench.metrology.results.finding import Finding
from bench.metrology.run_data import UnitUnderTest
from bench.metrology.sampled_codes import quantisation_by_level

READINGS = "readings: scatter pooled over the run"
POOLED = "pooled"  # the kind of these lines


@dataclass(frozen=True, slots=True)
class OwnErrors:
    """Errors of one channel of a unit, such as acc_x, and of the clock of its scale factor."""

    unit: UnitUnderTest
    bench: BenchRecord
    channel: str

    @property
    def is_sent(self) -> bool:
        """True if the unit sends the channel, as codes or values, so that no counter counts its pulses."""
        return self.channel in self.unit.channel_units

    def clock_of_scale(self, scale: float) -> Iterator[BudgetLine]:
        """Line for the clock of a scale factor.

        Pulses of an accelerometer are counted by the counter's clock; those of a gyro are counted over an angle, which
        needs no clock. Codes need none either, but the rate of the table is timed by the host's.
        """
        of_gyro = self.channel.startswith("gyro")
        if of_gyro == self.is_sent:
            yield self.clock(scale)

    def clock(self, size: float) -> BudgetLine:
        """Line for the effect of the clock of this channel on a quantity of this size."""
        if self.is_sent:
            return common("computer: clock", size * self.bench.host_clock_u)
        return BudgetLine("counter: time base", "B", float(size * self.bench.time_base_u), None, "counter.time base")

    def hidden(
        self, windows: Sequence[Acquisition | None], gain: Array, level: Array | None = None
    ) -> Iterator[BudgetLine]:
        """Quantisation uncertainty of a result with sensitivities `gain` (n,) to windows, one error at each level."""
        channel = self.unit.channels[self.channel]
        quantisation_u = np.array(
            [0.0 if window is None else window.windows[channel].quantisation_u for window in windows]
        )
        yield from self.stepped(
            quantisation_by_level(gain, quantisation_u, np.arange(float(len(gain))) if level is None else level)
        )

    def stepped(self, hidden: Array) -> Iterator[BudgetLine]:
        """Line for independent quantisation uncertainties (m,)."""
        if self.is_sent:
            yield BudgetLine(self.steps, "B", float(np.linalg.norm(hidden)))

    @property
    def steps(self) -> str:
        """Name in budgets of the quantisation of its codes."""
        return f"{self.unit.channels[self.channel]}: steps of the codes"


def gyro_scale_unit(unit: UnitUnderTest) -> str:
    """Unit of the scale factors of its gyros."""
    return "pulse/°" if unit.gyro_output_unit == "pulse/s" else f"{unit.gyro_output_unit}/(°/s)"


def scatter_line(noise: tuple[float, int], gain: Array) -> BudgetLine:
    """Type A line: effect of the scatter of readings on a result with sensitivities `gain` (n,)."""
    sd, dof = noise
    return BudgetLine(READINGS, "A", sd * float(np.linalg.norm(gain)), dof, kind=POOLED)


def own_u(finding: Finding) -> float:
    """Part of an uncertainty that is due to the readings."""
    return math.sqrt(math.fsum(line.u**2 for line in finding.budget if line.type == "A"))


def pooled_dof(found: Sequence[Finding]) -> int | None:
    """Least degrees of freedom of the scatter of findings; None if unlimited."""
    scattered = [line for each in found for line in each.budget if line.kind == POOLED]
    return min((line.dof for line in scattered if line.dof), default=None)


def rate_weights(rates: Sequence[Turning]) -> Array:
    """Relative sensitivity of a scale factor to an error of each rate in °/s, (r,)."""
    rate_dps = np.array([each.rate_dps for each in rates])
    away = rate_dps - rate_dps.mean()
    return np.asarray(away / np.sum(away**2))


def harmonics_of_rates(rates: Sequence[Turning], bench: BenchRecord) -> Iterator[BudgetLine]:
    """Lines of encoder harmonics, relative to the scale factor: zero over exactly whole turns."""
    weights = rate_weights(rates)
    for role, axis in bench.axes.items():
        changes = [
            weights @ np.array([_change(each, role, order) for each in rates])
            for order in range(1, len(axis.harmonics_u_deg) + 1)
        ]
        parts = np.array(axis.harmonics_u_deg) * changes
        yield common(f"{role}: harmonics", float(np.linalg.norm(parts)))  # cosine and sine together


def _change(turning: Turning, role: str, order: int) -> complex:
    """Change of the mean rate of a rotation by a harmonic of an axis's error, for amplitudes of 1° each; °/s.

    The real part is that of its cosine, the imaginary part that of its sine.
    """
    turned = turning.acquisition.turned
    if turned is None or turned.axis != role:
        return 0.0
    ends = (cmath.exp(1j * order * math.radians(angle_deg)) for angle_deg in (turned.from_deg, turned.to_deg))
    begin, end = ends
    return (end - begin) / (turned.to_s - turned.from_s)
