"""What makes a result of an inertial unit uncertain beside the table: scatter, clocks, encoders, steps of codes."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from bench.methods.imu.reduction.windows import Turning
from bench.metrology.acquisition import Acquisition, Array
from bench.metrology.bench_uncertainty import BenchRecord
from bench.metrology.results.budget import BudgetLine
from bench.metrology.run_data import UnitUnderTest
from bench.metrology.sampled_codes import by_level

READINGS = "readings: scatter pooled over the run"
POOLED = "pooled"  # the kind of these lines


@dataclass(frozen=True, slots=True)
class OwnErrors:
    """What one channel of a unit, such as acc_x, and the clock that its scale hangs on give to a budget."""

    unit: UnitUnderTest
    bench: BenchRecord
    channel: str

    @property
    def is_sent(self) -> bool:
        """Whether the unit sends it, as codes or values, and no counter counts its pulses."""
        return self.channel in self.unit.channel_units

    def clock_of_scale(self, scale: float) -> Iterator[BudgetLine]:
        """That of a scale factor.

        Pulses of an accelerometer are counted by the counter's clock; those of a gyro are counted over an angle, which
        takes no clock. Codes are sent without one, but the rate of the table is timed by the host's.
        """
        of_gyro = self.channel.startswith("gyro")
        if of_gyro == self.is_sent:
            yield self.clock(scale)

    def clock(self, size: float) -> BudgetLine:
        """What the clock that times this channel does to something of that size."""
        if self.is_sent:
            return shared_line("computer: clock", abs(size) * self.bench.host_clock_u)
        return shared_line("counter: time base", abs(size) * self.bench.time_base_u)

    def hidden(
        self, windows: Sequence[Acquisition | None], gain: Array, level: Array | None = None
    ) -> Iterator[BudgetLine]:
        """What steps of codes hide from what depends on windows by `gain` (n,), alike from those at one level (n,)."""
        channel = self.unit.channels[self.channel]
        step_u = np.array([0.0 if window is None else window.windows[channel].step_u for window in windows])
        yield from self.stepped(by_level(gain, step_u, np.arange(float(len(gain))) if level is None else level))

    def stepped(self, hidden: Array) -> Iterator[BudgetLine]:
        """The same of what they hide, (m,) and independent."""
        if self.is_sent:
            yield BudgetLine(self.steps, "B", float(np.linalg.norm(hidden)))

    @property
    def steps(self) -> str:
        """What budgets call the steps of its codes."""
        return f"{self.unit.channels[self.channel]}: steps of the codes"


def gyro_scale_unit(unit: UnitUnderTest) -> str:
    """What the scale factors of its gyros are in."""
    return "pulse/°" if unit.gyro_output_unit == "pulse/s" else f"{unit.gyro_output_unit}/(°/s)"


def scatter_line(noise: tuple[float, int], gain: Array) -> BudgetLine:
    """A type A line: what the scatter of readings, with its freedom, does to a result that has them by `gain` (n,)."""
    sd, dof = noise
    return BudgetLine(READINGS, "A", sd * float(np.linalg.norm(gain)), dof, kind=POOLED)


def shared_line(name: str, u: float | np.floating | Array) -> BudgetLine:
    """A type B line of an error that several findings have."""
    return BudgetLine(name, "B", float(u), None, name.replace(": ", "."))


def rate_weights(rates: Sequence[Turning]) -> Array:
    """What a scale factor changes by, relative, for an error of each rate in °/s, (r,)."""
    rate_dps = np.array([each.rate_dps for each in rates])
    away = rate_dps - rate_dps.mean()
    return np.asarray(away / np.sum(away**2))


def harmonics_of_rates(rates: Sequence[Turning], bench: BenchRecord) -> dict[str, float]:
    """What those of encoders leave in the scale factor, relative, by source: nothing over exactly whole turns."""
    weights, found = rate_weights(rates), {}
    for role, axis in bench.axes.items():
        changes = [
            weights @ np.array([_change(each, role, order) for each in rates])
            for order in range(1, len(axis.harmonics_u_deg) + 1)
        ]
        parts = np.array(axis.harmonics_u_deg) * changes
        found[f"{role}: harmonics"] = float(np.linalg.norm(parts))  # of cosines and sines together
    return found


def _change(turning: Turning, role: str, order: int) -> complex:
    """What a harmonic of an axis's error changes the mean rate of a rotation by, for amplitudes of 1° each; °/s.

    The real part is that of its cosine, the imaginary part that of its sine.
    """
    turned = turning.acquisition.turned
    if turned is None or turned.axis != role:
        return 0.0
    ends = (cmath.exp(1j * order * math.radians(angle_deg)) for angle_deg in (turned.from_deg, turned.to_deg))
    begin, end = ends
    return (end - begin) / (turned.to_s - turned.from_s)
