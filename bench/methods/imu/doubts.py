"""Doubts about a case of method M2: implausible data of a table or an inertial unit (equations 1.10)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from bench.metrology import plausibility
from bench.metrology.least_squares import Array
from bench.metrology.plausibility import Doubt

LONGEST_DWELL_S = 7200.0
MOST_UNLIKE = 20.0  # ratio between channels of one unit
SCALES_PPS_PER_G = (1.0, 1e7)
SCALES_PULSE_PER_DEG = (0.1, 1e7)


def unit(
    dwell_s: Array,
    command_dps: Array,
    rate_dps: Array,
    told_c: Mapping[str, Array],
    scales: Sequence[tuple[str, str, float]],
) -> Iterator[Doubt]:
    """Doubts about a case of M2; thermometers are by columns, scale factors of all set points by keys and axes."""
    dwell = plausibility.beyond(dwell_s, LONGEST_DWELL_S)
    if dwell is not None:
        yield Doubt("implausible_time", f"dwell_s goes to {dwell:.4g} s; is it in milliseconds?")
    for name, column_c in told_c.items():
        yield from plausibility.kelvin(name, column_c)
    moving = np.isfinite(command_dps) & np.isfinite(rate_dps) & (command_dps != 0)
    if moving.any():
        ratio = float(np.median(rate_dps[moving] / command_dps[moving]))
        if not 0.5 <= abs(ratio) <= 2:
            yield Doubt(
                "implausible_angle", f"rate_true_dps is {ratio:.4g} times rate_cmd_dps{plausibility.slip(ratio)}"
            )
        yield from plausibility.radians("rate_cmd_dps", command_dps[moving])
    for key, bounds, unit_of in (
        ("K1_pps_per_g", SCALES_PPS_PER_G, "pulse/s/g"), ("KG_p_per_deg", SCALES_PULSE_PER_DEG, "pulse/°"),
    ):  # fmt: skip
        if dead := sorted({axis for name, axis, value in scales if name == key and not value}):
            yield Doubt("implausible_output", f"{key} of {', '.join(dead)} is 0: the counts do not follow the input")
        signs = {(axis, value > 0) for name, axis, value in scales if name == key and value}
        if both := sorted({axis for axis, _ in signs if {(axis, True), (axis, False)} <= signs}):
            yield Doubt("implausible_scale", f"{key} of {', '.join(both)} has another sign at some set points")
        values = np.array([abs(value) for name, _, value in scales if name == key and value])
        if not len(values):
            continue
        yield from plausibility.scale(key, float(np.median(values)), bounds, unit_of)
        if np.max(values) > MOST_UNLIKE * np.min(values):
            seen = f"{key} goes from {np.min(values):.4g} to {np.max(values):.4g} {unit_of} in one unit"
            yield Doubt("implausible_scale", f"{seen}; are columns of counts exchanged?")
