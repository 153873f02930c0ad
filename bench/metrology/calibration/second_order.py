"""Response of a second-order low pass with a delay."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.metrology.least_squares import Array

FORM = "H(f) = K · exp(-2πi f delay) / (1 - (f/f0)² + 2i damping f/f0)"
NAMES = ("K", "f0", "damping", "delay")


def second_order(
    frequency_hz: Array, gain: float, natural_hz: float, damping: float, delay_s: float
) -> NDArray[np.complex128]:
    """H(f) at each frequency (n,)."""
    part = frequency_hz / natural_hz
    return np.asarray(gain * np.exp(-2j * np.pi * frequency_hz * delay_s) / (1 - part**2 + 2j * damping * part))
