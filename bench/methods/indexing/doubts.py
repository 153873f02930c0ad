"""Doubts about a case of method M1: implausible data of an indexing table (equations 1.10)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from bench.metrology import plausibility
from bench.metrology.least_squares import Array
from bench.metrology.plausibility import Doubt
from bench.offline.doubts import SIGNS_OR_ROWS

LARGEST_MOUNT_RAD = 0.02  # a larger tilt is visible and would be corrected
LARGEST_MISFIT = 0.1  # deviation of a reading from the model of its sensor, in scale factors


def sweep(
    angle_deg: Array, output_v: Array, lines: Mapping[str, tuple[float, float]], mount_rad: Mapping[str, float | None]
) -> Iterator[Doubt]:
    """Doubts about a case of M1: angles, voltages, scale factor (V/g) and linearity of each end, residual angles."""
    for name, angle_rad in mount_rad.items():
        if angle_rad is not None and abs(angle_rad) > LARGEST_MOUNT_RAD:
            seen = f"settings.mount.{name} is {angle_rad:g} rad, which is {np.degrees(angle_rad):.3g}°"
            yield Doubt("implausible_angle", f"{seen}; is it in degrees?")
    if plausibility.on_grid(output_v) and not plausibility.on_grid(angle_deg):
        yield Doubt("columns_exchanged", "theta_deg and V_mean: the voltages are angles of a table, the angles are not")
    yield from plausibility.angles("theta_deg", angle_deg)
    yield from plausibility.outputs("V_mean", output_v)
    for end, (scale_v_per_g, linearity) in lines.items():
        yield from plausibility.scale("G", scale_v_per_g, plausibility.SCALES_V_PER_G, "V/g")
        if linearity > LARGEST_MISFIT:
            seen = f"end {end}: readings are up to {linearity:.3g} G away from the line through them"
            yield Doubt("implausible_scale", seen + SIGNS_OR_ROWS)
    scales = [scale for scale, _ in lines.values()]
    if len(scales) > 1 and not 0.5 <= scales[0] / scales[1] <= 2:
        seen = f"G is {scales[0]:.6g} V/g at one end and {scales[1]:.6g} V/g at the other"
        yield Doubt("implausible_scale", seen + SIGNS_OR_ROWS)


def clocked(output_v: Array, tilt_rad: float | None) -> Iterator[Doubt]:
    """Doubt about the clocking of M1: the tilt of the surface that it determines."""
    if frozen := plausibility.frozen("clock: V", output_v):
        yield frozen
    elif tilt_rad is not None and abs(tilt_rad) > LARGEST_MOUNT_RAD:
        seen = f"clock: by these readings the surface is tilted by {np.degrees(tilt_rad):.3g}°"
        yield Doubt("implausible_scale", seen + "; is V in the unit of V_mean, and is each a reading?")
