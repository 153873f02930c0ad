"""Response of sampling to a sine, as a factor on its phasor by frequency (equations 1.8)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from bench.metrology.least_squares import Array

Factors = NDArray[np.complex128]
Kept = Callable[[Array], Factors]


def instantaneous(frequency_hz: Array) -> Factors:
    """Response of instantaneous samples at each frequency (m,): 1."""
    return np.ones(len(frequency_hz), np.complex128)


def integration(frequency_hz: Array) -> Factors:
    """Response of an integral at each frequency (m,)."""
    return np.asarray(1 / (2j * np.pi * frequency_hz))


def averaging(frequency_hz: Array, interval_s: float) -> Factors:
    """Response of the mean over the preceding interval at each frequency (m,): delayed by half of it."""
    turns = frequency_hz * interval_s
    return np.asarray(np.sinc(turns) * np.exp(-1j * np.pi * turns))


def averaged_over(interval_s: float) -> Kept:
    """`averaging` over a fixed interval."""
    return partial(averaging, interval_s=interval_s)
