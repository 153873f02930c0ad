"""What makes the result of a case doubtful: data that no bench of the method gives (methods.md 1.10)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from bench.analysis import plausibility
from bench.analysis.fit import Array
from bench.analysis.plausibility import Doubt
from bench.analysis.ramp import Leg
from bench.analysis.temperature_static import Dwell

LEVELS_G = 1.05  # of gravity
LONGEST_DWELL_S = 7200.0
MOST_UNLIKE = 20.0  # channels of one unit
WAYS = {"up": "falls", "down": "rises"}  # of a leg that goes against its name
LARGEST_MOUNT_RAD = 0.02  # more than a degree is seen by eye, and corrected
SAME_READING_C = 10.0  # between set points; no chamber comes that near to another
LARGEST_MISFIT = 0.1  # of a reading from what the model of its sensor says, in scale factors
SIGNS_OR_ROWS = ": see the signs of the output, and whether rows are displaced"
NAMED = 5  # dwells
SCALES_PPS_PER_G = (1.0, 1e7)
SCALES_PULSE_PER_DEG = (0.1, 1e7)


def with_doubts(result: dict[str, Any], doubts: Iterable[Doubt]) -> dict[str, Any]:
    """The result with the flags and the notes of the doubts; a doubtful result has no verdict."""
    with np.errstate(all="ignore"):  # of readings that are no readings
        found = list(doubts)
    flags = [flag for flag in dict.fromkeys(doubt.flag for doubt in found) if flag]
    changed: dict[str, Any] = {
        "flags": [*result["flags"], *flags],
        "notes": [*result["notes"], *dict.fromkeys(doubt.note for doubt in found)],
    }
    if flags and "passed" in result:
        changed["passed"] = None
    if flags and "verdict" in result:
        changed["verdict"] = "invalid"
    return result | changed


def sweep(
    angle_deg: Array, output_v: Array, lines: Mapping[str, tuple[float, float]], mount_rad: Mapping[str, float | None]
) -> Iterator[Doubt]:
    """Of M1: angles, voltages, of the line of each end the scale factor in V/g and its linearity, residual angles."""
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
    """Of the clocking of M1, and the tilt of the surface that follows from it."""
    if frozen := plausibility.frozen("clock: V", output_v):
        yield frozen
    elif tilt_rad is not None and abs(tilt_rad) > LARGEST_MOUNT_RAD:
        seen = f"clock: by these readings the surface is tilted by {np.degrees(tilt_rad):.3g}°"
        yield Doubt("implausible_scale", seen + "; is V in the unit of V_mean, and is each a reading?")


def tumble(
    position_deg: Array, output_v: Array, measured_c: Array, set_c: Array, dwells: Iterable[Dwell]
) -> Iterator[Doubt]:
    """Of M4 static; a misalignment or a K2 that no accelerometer has comes from signs or rows."""
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
    """A thermometer that stands still while the set point goes on."""
    known = np.isfinite(measured_c) & np.isfinite(set_c)
    readings, which = np.unique(measured_c[known], return_inverse=True)
    lowest, highest = np.full(len(readings), np.inf), np.full(len(readings), -np.inf)
    np.minimum.at(lowest, which, set_c[known])
    np.maximum.at(highest, which, set_c[known])
    frozen = readings[highest - lowest > SAME_READING_C]
    if len(frozen):
        seen = f"T_meas_C is {frozen[0]:.6g} °C at set points more than {SAME_READING_C:g} °C apart"
        yield Doubt("implausible_temperature", f"{seen}: it is frozen")


def ramp(legs: Sequence[Leg], temperature_c: Array, output_g: Array, slope_g_per_c: float | None) -> Iterator[Doubt]:
    """Of M4 dynamic."""
    yield from plausibility.kelvin("T_C", temperature_c)
    rest_g = plausibility.beyond(output_g, plausibility.LARGEST_REST_G)
    if rest_g is not None:
        span_c = np.ptp(temperature_c[np.isfinite(temperature_c)])
        exchanged = "; are T_C and U_V exchanged?" if span_c < 2 else "; see the units of U_V and of K1_V_per_g"
        yield Doubt("implausible_scale", f"U_V over K1_V_per_g goes to {rest_g:.4g} g at rest{exchanged}")
    elif slope_g_per_c is not None and abs(slope_g_per_c) > plausibility.LARGEST_SLOPE_G_PER_C:
        yield Doubt(
            "implausible_scale", f"the slope is {slope_g_per_c * 1e6:.4g} µg/°C: see the units of U_V and of K1_V_per_g"
        )
    frozen = [f"{leg.name} of cycle {leg.cycle}" for leg in legs if len(leg.time_s) > 2 and not np.ptp(leg.output_g)]
    if frozen:
        yield Doubt("implausible_output", f"U_V does not change on the leg {', '.join(frozen[:NAMED])}: it is frozen")
    still = [f"{leg.name} of cycle {leg.cycle}" for leg in legs if plausibility.stands_still(leg.temperature_c)]
    if still:
        yield Doubt("implausible_temperature", f"T_C stands still on the leg {', '.join(still[:NAMED])}: it is frozen")
    for leg in legs:
        yield from list(plausibility.ramp(leg.time_s, leg.temperature_c))[:1]
    against = [leg for leg in legs if leg.against]
    if against:
        ways = ", ".join(f"{leg.name} of cycle {leg.cycle} {WAYS[leg.name]}" for leg in against)
        yield Doubt("legs_exchanged", f"leg: {ways}, and is left out; are up and down exchanged?")


def tilts(output_v: Array, out_of_range: int, scale_v_per_g: float, slope_v_per_c: float) -> Iterator[Doubt]:
    """Of M4 tilt: most samples cannot be tilts, or the settings are those of no accelerometer."""
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


def unit(
    dwell_s: Array,
    command_dps: Array,
    rate_dps: Array,
    told_c: Mapping[str, Array],
    scales: Sequence[tuple[str, str, float]],
) -> Iterator[Doubt]:
    """Of M2; thermometers by their columns, and the scale factors of all set points by their keys and axes."""
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


def levels(levels_g: Iterable[tuple[str, float]]) -> Iterator[Doubt]:
    """Of M0: gravity runs beyond gravity."""
    for name, level_g in levels_g:
        if abs(level_g) > LEVELS_G:
            tail = plausibility.slip(level_g)
            yield Doubt("implausible_scale", f"{name}: {level_g:.4g} g, where gravity gives 1 g at most{tail}")


def thermostats(name: str, converter_c: Array, accelerometer_c: Array, held_c: float | None) -> Iterator[Doubt]:
    """Of M0: the converter's temperature is held where the accelerometer's should be, which goes."""
    yield from plausibility.kelvin("T_conv_C", converter_c)
    known = np.isfinite(converter_c) & np.isfinite(accelerometer_c)
    if held_c is None or not known.any():
        return
    held = abs(float(np.median(converter_c[known])) - held_c) < 1 and np.ptp(converter_c[known]) < 2
    if held and np.ptp(accelerometer_c[known]) > 5:
        yield Doubt(
            "columns_exchanged", f"{name}: T_conv_C is held at {held_c:g} °C while T_acc_C goes: they seem exchanged"
        )
