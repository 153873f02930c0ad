"""Errors of a sensor at a steady rate: of a gyro against the table, of one on an arm against ω²r (equations 5.2, 5.4).

The arithmetic of runs and of recorded cases; uncertainties are those of the readings alone.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from bench.methods.rate_table.reduction.samples import Steady
from bench.metrology.results.coverage import effective_dof

LEAST_LOW_RATES = 2
LARGEST_U_RADIUS = 0.1  # of the radius; a less certain radius counts as undetermined


@dataclass(frozen=True, slots=True)
class RangeError:
    """The output at a rate less its bias less what is `true`, in the unit of the sensor.

    Its standard uncertainty has parts by the reading, the bias, the low readings by way of the radius, and the rate.
    `per_bias` is its change with an error of the bias.
    """

    true: float
    value: float
    by_reading: float
    per_bias: float
    by_bias: float
    by_radius: float
    by_rate: float
    reading_dof: int
    bias_dof: int

    @property
    def u(self) -> float:
        """Standard uncertainty, from the readings alone."""
        return _root_sum(self.by_reading, self.by_bias, self.by_radius, self.by_rate)

    @property
    def dof(self) -> int | None:
        """Effective degrees of freedom of `u`; None for unlimited."""
        limited = [(self.by_reading, self.reading_dof), (self.by_bias, self.bias_dof)]
        return effective_dof([*limited, (self.by_radius, None), (self.by_rate, None)])


def gyro_error(turning: Steady, bias: Steady) -> RangeError:
    """The error of a gyro, in deg/s, against the rate of the table."""
    error_dps = turning.output - bias.output - turning.rate_dps
    return RangeError(
        turning.rate_dps, error_dps, turning.u_output, 1.0, bias.u_output, 0.0, turning.u_rate_dps, turning.dof,
        bias.dof,
    )  # fmt: skip


class Arm:
    """Radius fitted to a = ω²r/g at low rates, weighted by ω⁴; the bias of the sensor is common to all readings.

    All figures are linear in the readings a_i and the bias: r = Σ c_i (a_i - bias). An input axis that points at the
    spin axis reads + and has a positive radius. What is wrong with the scale of the accelerometer is in the radius.
    """

    def __init__(self, bias: Steady, low: Iterable[Steady], local_g_mps2: float) -> None:
        """Fit the radius from the reading at rest and those at low rates, which are not 0."""
        self._bias, self._g = bias, local_g_mps2
        self._low = list(low)
        squares = np.array([np.radians(turning.rate_dps) ** 2 for turning in self._low])
        self._weights = squares * local_g_mps2 / np.sum(squares**2)
        readings_g = np.array([turning.output - bias.output for turning in self._low])
        self.radius_m = float(self._weights @ readings_g)
        # A relative error e of ω_i changes the term i of the sum by 2e, and the denominator by twice that.
        shares = squares**2 / np.sum(squares**2)
        rates = np.array([turning.u_rate_dps / turning.rate_dps for turning in self._low])
        outputs = np.array([turning.u_output for turning in self._low])
        self.u_own_m = _root_sum(*(self._weights * outputs), *(2 * self.radius_m * shares * rates))

    @property
    def per_bias_m(self) -> float:
        """Change of the radius with an error of the bias, in m/g."""
        return abs(float(np.sum(self._weights)))

    @property
    def u_bias_m(self) -> float:
        """Standard uncertainty of the radius from the bias."""
        return self.per_bias_m * self._bias.u_output

    @property
    def u_radius_m(self) -> float:
        """Standard uncertainty of the radius, from the readings alone."""
        return _root_sum(self.u_own_m, self.u_bias_m)

    @property
    def is_uncertain(self) -> bool:
        """True if the radius is too uncertain to compare anything with it, as that of a dead output."""
        return self.u_radius_m >= LARGEST_U_RADIUS * abs(self.radius_m)

    def error(self, turning: Steady) -> RangeError:
        """Excess of the reading over ω²r at a rate, in g.

        An error of the bias changes the reading and, through the radius, the true value.
        """
        per_radius = float(np.radians(turning.rate_dps) ** 2 / self._g)
        true_g = per_radius * self.radius_m
        per_bias = abs(1 - per_radius * float(np.sum(self._weights)))
        return RangeError(
            true=true_g,
            value=turning.output - self._bias.output - true_g,
            by_reading=turning.u_output,
            per_bias=per_bias,
            by_bias=per_bias * self._bias.u_output,
            by_radius=per_radius * self.u_own_m,
            by_rate=abs(2 * true_g / turning.rate_dps if turning.rate_dps else 0.0) * turning.u_rate_dps,
            reading_dof=turning.dof,
            bias_dof=self._bias.dof,
        )


def _root_sum(*terms: float) -> float:
    return float(np.sqrt(np.sum(np.square(terms))))
