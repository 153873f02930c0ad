"""Limits of the bench file for a rate table: angles, rates, accelerations and sines, checked before any motion."""

from __future__ import annotations

import math

from drivers.errors import BeyondLimit
from drivers.kinds.table.description import TableLimits

LARGEST_SINE_DEG = 170.0  # less than half a turn in either direction, so that turns can be counted


class Bounds:
    """Limits of one table. All checks raise BeyondLimit with the excessive value and the limit."""

    def __init__(self, device: str, limits: TableLimits) -> None:
        self._device, self._limits = device, limits

    @property
    def endless(self) -> bool:
        """True if the axis may rotate continuously."""
        return self._limits.angle is None

    def check_angle(self, what: str, angle_deg: float) -> None:
        """Check an angle."""
        allowed = self._limits.angle
        if allowed is not None and not allowed.min <= angle_deg <= allowed.max:
            raise self._beyond(f"{what} {angle_deg:g}° is outside {allowed.min:g}° to {allowed.max:g}°")

    def check_turning(self, rate_dps: float, acceleration_dps2: float) -> None:
        """Check a rate, and the acceleration to it."""
        if rate_dps != 0:
            self._check_maximum("the rate", abs(rate_dps), self._limits.rate.max, "°/s")
        self._check_maximum("the acceleration", acceleration_dps2, self._limits.acceleration.max, "°/s²")
        if not self.endless:
            raise self._beyond("an axis with limits.angle cannot rotate continuously")

    def check_sine(self, amplitude_deg: float, frequency_hz: float) -> None:
        """Check a sine: A·2πf is its peak rate, A·(2πf)² its peak acceleration."""
        self._check_maximum("the amplitude", amplitude_deg, LARGEST_SINE_DEG, "°")
        limits, omega_per_s = self._limits, 2 * math.pi * frequency_hz
        self._check_maximum("the frequency", frequency_hz, limits.frequency.max, "Hz")
        self._check_maximum("the sine's peak rate", amplitude_deg * omega_per_s, limits.rate.max, "°/s")
        peak_dps2 = amplitude_deg * omega_per_s**2
        self._check_maximum("the sine's peak acceleration", peak_dps2, limits.acceleration.max, "°/s²")

    def _check_maximum(self, what: str, value: float, maximum: float, unit: str) -> None:
        if not 0 < value <= maximum:
            raise self._beyond(f"{what} of {value:g} {unit} is not between 0 and {maximum:g} {unit}")

    def _beyond(self, problem: str) -> BeyondLimit:
        return BeyondLimit(
            self._device, problem, remedy="Nothing was moved. Correct the sequence, or the limits in the bench file."
        )  # fmt: skip
