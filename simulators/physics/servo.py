"""Response of a rate table to commands: a control loop that lags behind a sine, and rate ripple of the motor."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Loop:
    """A second-order control loop, and the maximum acceleration of table and load.

    It affects only sines. At a constant rate a loop lags by a constant angle, which has no effect, because the encoder
    reports the true angle, not the commanded one.
    """

    natural_hz: float
    damping: float
    most_dps2: float = math.inf

    def follows(self, amplitude_deg: Array, frequency_hz: Array) -> tuple[Array, Array]:
        """Gain and phase in rad of the table relative to the commanded sine, at these amplitudes and frequencies."""
        x = frequency_hz / self.natural_hz
        response = 1 / (1 - x**2 + 2j * self.damping * x)
        asked_dps2 = amplitude_deg * np.abs(response) * (2 * np.pi * frequency_hz) ** 2
        held = 1.0 if math.isinf(self.most_dps2) else self.most_dps2 / np.maximum(asked_dps2, self.most_dps2)
        return np.abs(response) * held, np.angle(response)

    def slopes(self, amplitude_deg: Array, frequency_hz: Array) -> tuple[Array, Array]:
        """Derivatives over frequency of the logarithm of the gain, and of the phase in rad/Hz."""
        x = frequency_hz / self.natural_hz
        relative = (2 * x - 2j * self.damping) / (1 - x**2 + 2j * self.damping * x) / self.natural_hz
        asked_dps2 = amplitude_deg * np.abs(1 / (1 - x**2 + 2j * self.damping * x)) * (2 * np.pi * frequency_hz) ** 2
        limited = asked_dps2 > self.most_dps2  # where the acceleration is the limit, the angle falls as 1/f²
        return np.where(limited, -2 / np.maximum(frequency_hz, 1e-9), np.real(relative)), np.imag(relative)


@dataclass(frozen=True, slots=True)
class Ripple:
    """Relative rate ripple over a turn: `relative` amplitude at each of the orders, with its phase in rad."""

    relative: float
    orders: tuple[int, ...]
    phases: tuple[float, ...]

    def angle_deg(self, even_deg: Array, origin_deg: float) -> Array:
        """Angles with ripple for ideal angles (n,) from an origin on."""
        return even_deg + self._ahead_deg(even_deg) - self._ahead_deg(np.array(origin_deg))

    def slope(self, even_deg: Array) -> Array:
        """Relative rate error at an angle."""
        return sum((np.cos(at) for _, at in self._waves(even_deg)), np.zeros_like(even_deg)) * self.relative

    def bend_per_deg(self, even_deg: Array) -> Array:
        """Derivative of the slope, per °."""
        bends = (-order * math.pi / 180 * np.sin(at) for order, at in self._waves(even_deg))
        return sum(bends, np.zeros_like(even_deg)) * self.relative

    def _ahead_deg(self, even_deg: Array) -> Array:
        parts = (180 / math.pi / order * np.sin(at) for order, at in self._waves(even_deg))
        return sum(parts, np.zeros_like(even_deg)) * self.relative

    def _waves(self, even_deg: Array) -> list[tuple[int, Array]]:
        """Each order and its angle in rad."""
        turn = np.radians(even_deg)
        return [(order, order * turn + phase) for order, phase in zip(self.orders, self.phases, strict=True)]
