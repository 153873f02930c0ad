"""Periodic patterns in residuals: Fisher's test of the largest line of their spectrum."""

from __future__ import annotations

import numpy as np

from bench.metrology.least_squares import Array

LEAST_LINES = 3
CHANCE = 1e-4
"""Maximum probability that noise has such a line."""


def conspicuous_periods(residuals: Array) -> int | None:
    """Periods over the whole record of the largest line in the spectrum of equidistant residuals (n,).

    None if noise may well have a line like it.

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
    return largest + 1
