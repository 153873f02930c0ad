"""Propagation of uncertainty through short formulas, to first order and with correlations (JCGM 100, 5.1 and 5.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.metrology.least_squares import Array


@dataclass(frozen=True, slots=True)
class Measured:
    """A value and its standard uncertainty."""

    value: float
    u: float


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value computed from inputs, and its derivative with respect to each of them (n,)."""

    value: float
    gain: Array

    def __add__(self, other: Estimate) -> Estimate:
        return Estimate(self.value + other.value, self.gain + other.gain)

    def __sub__(self, other: Estimate) -> Estimate:
        return self + other * -1.0

    def __mul__(self, other: Estimate | float) -> Estimate:
        if isinstance(other, Estimate):
            return Estimate(self.value * other.value, self.gain * other.value + other.gain * self.value)
        return Estimate(self.value * other, self.gain * other)

    def __truediv__(self, other: Estimate) -> Estimate:
        ratio = self.value / other.value
        return Estimate(ratio, (self.gain - ratio * other.gain) / other.value)

    def sine(self) -> Estimate:
        """Sine of an angle in rad."""
        return Estimate(float(np.sin(self.value)), self.gain * np.cos(self.value))

    def measured(self, covariance: Array) -> Measured:
        """The value with its standard uncertainty, from the covariance (n, n) of the inputs."""
        return Measured(self.value, float(np.sqrt(np.maximum(self.gain @ covariance @ self.gain, 0))))


def inputs(values: Array) -> list[Estimate]:
    """Inputs (n,) as estimates, the start of a formula."""
    return [Estimate(float(value), gain) for value, gain in zip(values, np.eye(len(values)), strict=True)]


def weighted(weights: Array, estimates: Sequence[Estimate]) -> Estimate:
    """Weighted sum of estimates (n,)."""
    value = weights @ np.array([estimate.value for estimate in estimates])
    return Estimate(float(value), np.asarray(weights @ np.array([estimate.gain for estimate in estimates])))
