"""Readings of an output on a table that turns, taken at other times than those at which its encoder is latched.

They are few to a turn, and what the unevenness of the table and the attitude of the sensor put into them is much more
than their noise. It goes with the angle, though, which is known at each of them: taken out, the noise alone is left.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from bench.metrology.acquisition import Array
from bench.metrology.least_squares import LinearFit, NotDetermined, least_squares

HARMONICS = 4  # of the angle, that readings differ by
MOTOR = range(HARMONICS + 1, 61)  # the orders at which a motor may turn unevenly: its poles, or twice as many
OF_THE_MOTOR = 0.5  # of their scatter is what readings keep without an order of it, at most; by chance in 1 % at most
TOLD = 1e-3  # of a reading, the least square of a wave beside what else is fitted; half of one where it stands apart
BLURS = 1.5  # at most: the variance of a mean beside what goes with the table, over that of a plain mean
LEAST_DOF = 8  # that the scatter is told by
SUSPECTING_DOF = 4  # that an order of the motor must leave to be suspected where it cannot be told


@dataclass(frozen=True, slots=True)
class TurningReadings:
    """Readings (n,) and what the table did at each: its angle, and its mean rate over half the time between readings.

    A voltmeter that measures its own zero after each reading looks at its input for half of that time.
    """

    output: Array
    angle_deg: Array
    table_dps: Array

    def at_rate(self, rate_dps: float) -> tuple[float, float, int]:
        """The output over whole turns at a mean rate of the table: mean, standard uncertainty, degrees of freedom.

        What goes with the table's rate and with the angle is fitted beside; not what so few readings, or so little of a
        turn, do not tell from the mean. An order of the motor of which they see but a part of a wave is in the
        uncertainty, with all by which it would move the mean.
        """
        waves = [wave for order in range(1, HARMONICS + 1) for wave in self._waves(order)]
        for columns in owed_to_the_table(self.table_dps - rate_dps, waves):
            if (fit := self._fitted(columns)) is not None:
                fit, moved = self._beside_the_motor(columns, fit)
                u = fit.residual_sd * float(np.sqrt(fit.unscaled_covariance[0, 0]))
                return float(fit.coefficients[0]), float(np.hypot(u, moved)), fit.dof
        raise ValueError("no readings")

    def _beside_the_motor(self, columns: Sequence[Array], fit: LinearFit) -> tuple[LinearFit, float]:
        """The fit beside that order of the motor which leaves the least, where there plainly is one.

        Where readings are too few for it, the fit as it is, and by how much that order would move the mean.
        """
        known = np.linalg.qr(np.column_stack(columns))[0]
        waves = np.array([self._waves(order) for order in MOTOR])
        waves -= waves @ known @ known.T
        size = waves @ waves.transpose(0, 2, 1)
        told = np.flatnonzero(np.linalg.eigvalsh(size)[:, 0] > TOLD * len(self.output))
        share = waves[told] @ fit.residuals
        explained = np.sum(share * np.linalg.solve(size[told], share[..., np.newaxis])[..., 0], axis=-1)
        if not len(told):
            return fit, 0.0
        beside = self._solved([*columns, *self._waves(MOTOR[told[np.argmax(explained)]])])
        if beside is None or beside.dof < SUSPECTING_DOF or beside.residual_sd >= OF_THE_MOTOR * fit.residual_sd:
            return fit, 0.0
        if self._tells_the_mean(beside):
            return replace(beside, dof=beside.dof - 1), 0.0  # which order it is was fitted too
        return fit, float(abs(beside.coefficients[0] - fit.coefficients[0]))

    def _waves(self, order: int) -> tuple[Array, Array]:
        angle = np.radians(order * self.angle_deg)
        return np.cos(angle), np.sin(angle)

    def _fitted(self, columns: Sequence[Array]) -> LinearFit | None:
        """The fit of a design that leaves the mean well told; the mean alone always does."""
        fit = self._solved(columns)
        return fit if fit is not None and (len(columns) == 1 or self._tells_the_mean(fit)) else None

    def _tells_the_mean(self, fit: LinearFit) -> bool:
        return fit.dof >= LEAST_DOF and fit.unscaled_covariance[0, 0] * len(self.output) <= BLURS

    def _solved(self, columns: Sequence[Array]) -> LinearFit | None:
        with suppress(NotDetermined):
            return least_squares(np.column_stack(columns), self.output)
        return None


def owed_to_the_table(beside_dps: Array, waves: Sequence[Array]) -> Iterator[list[Array]]:
    """Designs (columns) of a mean and what goes with the table: how much faster than usual it was, and waves.

    Waves are two to a harmonic of the angle. From all of them to none, and the mean alone at last. A table that is
    uneven by harmonics alone adds nothing to them: its rate is left out before they are.
    """
    ones = np.ones_like(beside_dps)
    for count in range(len(waves), -1, -2):
        yield [ones, beside_dps, *waves[:count]]
        yield [ones, *waves[:count]]
