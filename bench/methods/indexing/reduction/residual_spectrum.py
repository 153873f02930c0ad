"""Periodic patterns in residuals: Fisher's test of the largest line of their spectrum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.metrology.least_squares import Array

LEAST_LINES = 3
CHANCE = 1e-4
"""Maximum probability that noise has such a line."""


@dataclass(frozen=True, slots=True)
class SpectralLine:
    """The largest line of a spectrum: `periods` over the whole record, and its `share` of the power, up to 1."""

    periods: int
    share: float


def conspicuous_line(residuals: Array) -> SpectralLine | None:
    """Largest line in the spectrum of equidistant residuals (n,); None if noise may well have one like it.

    R. A. Fisher, Tests of significance in harmonic analysis, Proc. R. Soc. A 125 (1929) 54. The line at half the
    sampling frequency, with half the degrees of freedom of the others, is not considered.
    """
    power = np.abs(np.fft.rfft(residuals)[1 : (len(residuals) + 1) // 2]) ** 2
    total = float(np.sum(power))
    if len(power) < LEAST_LINES or total == 0:
        return None
    largest = int(np.argmax(power))
    share = float(power[largest]) / total
    if len(power) * (1 - share) ** (len(power) - 1) > CHANCE:
        return None
    return SpectralLine(largest + 1, share)
