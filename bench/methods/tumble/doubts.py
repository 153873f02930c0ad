"""Doubts about cases of method M4a and of a tilt meter: implausible data (equations 1.10)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from bench.methods.tumble.reduction.dwells import SolvedDwell
from bench.metrology import plausibility
from bench.metrology.least_squares import Array
from bench.metrology.plausibility import Doubt
from bench.offline.doubts import SIGNS_OR_ROWS

SAME_READING_C = 10.0  # between set points; no chamber is that far from its set point
LARGEST_MISFIT = 0.1  # deviation of a reading from the model of its sensor, in scale factors
NAMED = 5  # dwells


def tumble(
    position_deg: Array, output_v: Array, measured_c: Array, set_c: Array, dwells: Iterable[SolvedDwell]
) -> Iterator[Doubt]:
    """Doubts about a case of M4 static; an implausible misalignment or K2 indicates signs or exchanged rows."""
    if plausibility.on_grid(output_v) and not plausibility.on_grid(position_deg):
        yield Doubt("columns_exchanged", "pos_deg and U_V: the voltages are angles of a head, the angles are not")
    yield from plausibility.angles("pos_deg", position_deg)
    yield from plausibility.outputs("U_V", output_v)
    yield from plausibility.kelvin("T_meas_C", measured_c)
    away_c = plausibility.beyond(measured_c - set_c, 50.0)
    if away_c is not None:
        yield Doubt("implausible_temperature", f"T_meas_C is up to {away_c:.4g} °C away from T_set_C")
    yield from _same_reading(measured_c, set_c)
    found = [(dwell.number, dwell.tumble) for dwell in dwells]
    if not found:
        return
    scale = float(np.median([tumble.k1 for _, tumble in found]))
    yield from plausibility.scale("K1", scale, plausibility.SCALES_V_PER_G, "V/g")
    if not scale:
        return
    odd = [
        number
        for number, tumble in found
        if abs(tumble.misalignment_rad) > LARGEST_MISFIT
        or abs(tumble.c2) > LARGEST_MISFIT * abs(tumble.k1)
        or not 0.5 <= tumble.k1 / scale <= 2
    ]
    if odd:
        named = ", ".join(map(str, odd[:NAMED])) + (f" and {len(odd) - NAMED} more" if len(odd) > NAMED else "")
        seen = f"dwell {named}: K1 is not that of the others, or K2 or delta_rad is beyond {LARGEST_MISFIT:g}"
        yield Doubt("implausible_scale", seen + SIGNS_OR_ROWS)


def _same_reading(measured_c: Array, set_c: Array) -> Iterator[Doubt]:
    """Doubt about a thermometer that stays constant while the set point changes."""
    known = np.isfinite(measured_c) & np.isfinite(set_c)
    readings, which = np.unique(measured_c[known], return_inverse=True)
    lowest, highest = np.full(len(readings), np.inf), np.full(len(readings), -np.inf)
    np.minimum.at(lowest, which, set_c[known])
    np.maximum.at(highest, which, set_c[known])
    frozen = readings[highest - lowest > SAME_READING_C]
    if len(frozen):
        seen = f"T_meas_C is {frozen[0]:.6g} °C at set points more than {SAME_READING_C:g} °C apart"
        yield Doubt("implausible_temperature", f"{seen}: it is frozen")


def tilts(output_v: Array, out_of_range: int, scale_v_per_g: float, slope_v_per_c: float) -> Iterator[Doubt]:
    """Doubts about a case of M4 tilt: most samples cannot be tilts, or the settings are implausible."""
    if frozen := plausibility.frozen("U_V", output_v):
        yield frozen
    samples = int(np.sum(~np.isnan(output_v)))
    yield from plausibility.scale("settings.K1_V_per_g", scale_v_per_g, plausibility.SCALES_V_PER_G, "V/g")
    if abs(slope_v_per_c / scale_v_per_g) > plausibility.LARGEST_SLOPE_G_PER_C:
        slope = f"{slope_v_per_c / scale_v_per_g * 1e6:.4g} µg/°C"
        yield Doubt("implausible_scale", f"settings.B1_V_per_C over K1_V_per_g is {slope}: see their units")
    if samples and out_of_range > samples / 2:
        yield Doubt(
            "implausible_scale",
            f"{out_of_range} of {samples} samples are beyond ±90°: see the units of U_V and of the settings, and "
            "whether T_C and U_V are exchanged",
        )
