"""Readings of accelerometers whose converters may have lost pulses in their dead band (equations 4.7).

A converter that counts pulses gives none while its input is in its dead band. A level accelerometer is there where its
bias and a misalignment nearly cancel. Noise of the input lets single pulses through: the mean is then between zero and
the true one, at any length of the window. The four headings of an attitude have the same input. Those that gave a
pulse by chance are as wrong as those that gave none, so that all four are left out together.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import numpy as np
from numpy.typing import NDArray

from bench.methods.imu.reduction.attitudes import HEADINGS, NAMES
from bench.methods.imu.reduction.windows import ACCELEROMETERS, Visit
from bench.metrology.acquisition import Array, Window
from bench.metrology.results.flag import Flag
from bench.metrology.run_data import AXES, UnitUnderTest


def dead_band_of(unit: UnitUnderTest, axis: int, dead_band_g: float) -> float:
    """Dead band of one accelerometer: `dead_band_g` if its pulses are counted, 0 if the unit sends its output."""
    return 0.0 if ACCELEROMETERS[axis] in unit.channel_units else dead_band_g


def is_near_zero(window: Window, per_g: float, dead_band_g: float) -> bool:
    """True if the input was in the dead band, or so near that noise reaches it."""
    return "dead_band" in window.problems or abs(window.mean) < dead_band_g * abs(per_g)


def near_zero(visit: Visit, unit: UnitUnderTest, per_g: Array, dead_band_g: float) -> NDArray[np.bool_]:
    """Mask of the readings (24, 3) near zero, with the others at the same input.

    `per_g` (3,) are the scale factors, NaN if unknown.
    """
    silent = np.zeros((len(NAMES), len(AXES)), dtype=np.bool_)
    for attitude, axis in product(visit.attitudes, range(len(AXES))):
        acquisition, own_g = visit.window_of(attitude), dead_band_of(unit, axis, dead_band_g)
        if acquisition is not None:
            window = acquisition.windows[unit.channels[ACCELEROMETERS[axis]]]
            silent[attitude, axis] = is_near_zero(window, per_g[axis], own_g)
    by_input = silent.reshape(-1, HEADINGS, len(AXES)).any(axis=1)
    return np.asarray(np.repeat(by_input, HEADINGS, axis=0))


def near_zero_flags(set_c: float, silent: NDArray[np.bool_]) -> Iterator[Flag]:
    """One flag for each accelerometer and input at which its readings are left out."""
    for number, axis in np.argwhere(silent[::HEADINGS]):
        first, last = NAMES[HEADINGS * number], NAMES[HEADINGS * number + HEADINGS - 1]
        what = f"{ACCELEROMETERS[axis]} {first}..{last}"
        yield Flag("T={set_c}:near_zero:{what}", values={"set_c": f"{set_c:.10g}", "what": what})
