"""Doubts about a case of method M0: implausible data of a channel (equations 1.10)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from bench.metrology import plausibility
from bench.metrology.least_squares import Array
from bench.metrology.plausibility import Doubt

LEVELS_G = 1.05  # maximum level of a gravity run


def levels(levels_g: Iterable[tuple[str, float]]) -> Iterator[Doubt]:
    """Doubt about gravity runs at more than 1 g."""
    for name, level_g in levels_g:
        if abs(level_g) > LEVELS_G:
            tail = plausibility.slip(level_g)
            yield Doubt("implausible_scale", f"{name}: {level_g:.4g} g, where gravity gives 1 g at most{tail}")


def thermostats(name: str, converter_c: Array, accelerometer_c: Array, held_c: float | None) -> Iterator[Doubt]:
    """Doubt about the thermometers: the converter's temperature is constant, but the accelerometer's varies."""
    yield from plausibility.kelvin("T_conv_C", converter_c)
    known = np.isfinite(converter_c) & np.isfinite(accelerometer_c)
    if held_c is None or not known.any():
        return
    held = abs(float(np.median(converter_c[known])) - held_c) < 1 and np.ptp(converter_c[known]) < 2
    if held and np.ptp(accelerometer_c[known]) > 5:
        yield Doubt(
            "columns_exchanged", f"{name}: T_conv_C is held at {held_c:g} °C while T_acc_C goes: they seem exchanged"
        )
