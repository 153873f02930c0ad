"""Readings of an output on a rotating table, at other times than the latches of its encoder.

There are few per turn, and the unevenness of the table and the attitude of the sensor affect them much more than their
noise. These effects depend on the angle, which is known at each reading; with them removed, only the noise remains.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from bench.metrology.acquisition import Array
from bench.metrology.least_squares import LinearFit, NotDetermined, least_squares

HARMONICS = 4  # harmonics of the angle in the differences of readings
MOTOR = range(HARMONICS + 1, 61)  # orders of possible unevenness of a motor: its pole pairs, or twice as many
OF_THE_MOTOR = 0.5  # maximum share of the scatter left by a fitted order; by chance in at most 1 %
OBSERVABLE = 1e-3  # per reading: minimum square of a wave orthogonal to the other terms; 0.5 if fully separate
BLURS = 1.5  # maximum ratio of the variance of a mean with table-correlated terms to that of a plain mean
LEAST_DOF = 8  # minimum degrees of freedom of the scatter
SUSPECTING_DOF = 4  # minimum degrees of freedom with an order of the motor for that to be suspected


@dataclass(frozen=True, slots=True)
class TurningReadings:
    """Readings (n,) with angle and mean rate of the table over half the time between readings.

    A voltmeter that measures its own zero after each reading integrates its input for half of that time.
    """

    output: Array
    angle_deg: Array
    table_dps: Array

    def at_rate(self, rate_dps: float) -> tuple[float, float, int]:
        """Output over whole turns at a mean rate of the table: mean, standard uncertainty, degrees of freedom.

        Terms proportional to the table's rate and harmonics of the angle are fitted with the mean, as far as the
        readings separate them from it. An order of the motor of which they cover only part of a wave is in the
        uncertainty, with its full effect on the mean.
        """
        waves = [wave for order in range(1, HARMONICS + 1) for wave in self._waves(order)]
        for columns in table_correlated(self.table_dps - rate_dps, waves):
            if (fit := self._fitted(columns)) is not None:
                fit, moved = self._beside_the_motor(columns, fit)
                u = fit.residual_sd * float(np.sqrt(fit.unscaled_covariance[0, 0]))
                return float(fit.coefficients[0]), float(np.hypot(u, moved)), fit.dof
        raise ValueError("no readings")

    def _beside_the_motor(self, columns: Sequence[Array], fit: LinearFit) -> tuple[LinearFit, float]:
        """Fit with the order of the motor that leaves the smallest residuals, if there clearly is one.

        If the readings are too few for it, the fit without it, and the possible effect of that order on the mean.
        """
        known = np.linalg.qr(np.column_stack(columns))[0]
        waves = np.array([self._waves(order) for order in MOTOR])
        waves -= waves @ known @ known.T
        size = waves @ waves.transpose(0, 2, 1)
        observable = np.flatnonzero(np.linalg.eigvalsh(size)[:, 0] > OBSERVABLE * len(self.output))
        share = waves[observable] @ fit.residuals
        explained = np.sum(share * np.linalg.solve(size[observable], share[..., np.newaxis])[..., 0], axis=-1)
        if not len(observable):
            return fit, 0.0
        beside = self._solved([*columns, *self._waves(MOTOR[observable[np.argmax(explained)]])])
        if beside is None or beside.dof < SUSPECTING_DOF or beside.residual_sd >= OF_THE_MOTOR * fit.residual_sd:
            return fit, 0.0
        if self._tells_the_mean(beside):
            return replace(beside, dof=beside.dof - 1), 0.0  # one degree of freedom for the choice of the order
        return fit, float(abs(beside.coefficients[0] - fit.coefficients[0]))

    def _waves(self, order: int) -> tuple[Array, Array]:
        angle = np.radians(order * self.angle_deg)
        return np.cos(angle), np.sin(angle)

    def _fitted(self, columns: Sequence[Array]) -> LinearFit | None:
        """Fit of a design matrix with a well-determined mean; the mean alone always is."""
        fit = self._solved(columns)
        return fit if fit is not None and (len(columns) == 1 or self._tells_the_mean(fit)) else None

    def _tells_the_mean(self, fit: LinearFit) -> bool:
        return fit.dof >= LEAST_DOF and fit.unscaled_covariance[0, 0] * len(self.output) <= BLURS

    def _solved(self, columns: Sequence[Array]) -> LinearFit | None:
        with suppress(NotDetermined):
            return least_squares(np.column_stack(columns), self.output)
        return None


def table_correlated(beside_dps: Array, waves: Sequence[Array]) -> Iterator[list[Array]]:
    """Design matrices of a mean and table-correlated regressors: deviation of the rate, and waves.

    Waves are two for each harmonic of the angle. From all of them to none, and finally the mean alone. For a table
    whose unevenness is harmonic the rate adds nothing to the waves: it is left out first.
    """
    ones = np.ones_like(beside_dps)
    for count in range(len(waves), -1, -2):
        yield [ones, beside_dps, *waves[:count]]
        yield [ones, *waves[:count]]
