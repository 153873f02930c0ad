"""Off-line reduction of recorded data: `case.json` and CSV records in, the result as plain JSON types out.

The formats, the names of settings and results, and the units in them are those of methods.md section 9.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field

from bench.analysis import plausibility
from bench.analysis.fit import NotDetermined
from bench.analysis.ramp import RampRecord, cut_into_legs
from bench.analysis.temperature_dynamic import RampLimits, reduce_ramp
from bench.analysis.temperature_static import Characteristic, Dwell, TumbleRecord, reduce_static
from bench.analysis.tilt import compare_tilt
from bench.errors import InputError
from bench.report import case_channel, case_doubts, case_imu, case_indexing, case_response
from bench.report.case_doubts import with_doubts
from bench.report.case_file import Case, Limit, Reduction, Reductions, Scale, Settings, read_case

LEGS = ("up", "down")
RAMP_FIGURES = (
    "B0_V", "B1_V_per_C", "max_resid_ug", "rms_resid_ug", "hysteresis_max_ug", "repeatability_max_ug",
)  # fmt: skip


class StaticSettings(Settings):
    """Of `static`; without a degree it is chosen by the data."""

    degree: int | None = Field(None, ge=1, le=8)


class DynamicSettings(Settings):
    """Of `dynamic`; a limit that is not given is not judged."""

    scale_v_per_g: Scale = Field(alias="K1_V_per_g")
    jump_threshold_ug: float = Field(60.0, gt=0)
    jump_window: int = Field(8, ge=2, le=1000)
    resid_limit_ug: Limit | None = None
    repeat_limit_ug: Limit | None = None


class TiltSettings(Settings):
    """Of `tilt`."""

    scale_v_per_g: Scale = Field(alias="K1_V_per_g")
    bias_v: float = Field(alias="B0_V")
    slope_v_per_c: float = Field(alias="B1_V_per_C")
    nominal_bias_v: float = Field(alias="K0_nominal_V")


def reduce_case(path: Path) -> dict[str, Any]:
    """Reduces the case file at `path`; gives the content of `result.json`.

    Raises InputError, which names the file and the place in it, when the case cannot be read or reduced.
    """
    case = read_case(path)
    method, sub = case.content.method, case.content.sub
    reduction = REDUCTIONS.get((method, sub)) or REDUCTIONS.get((method, ""))  # a method of one reduction has no sub
    if reduction is None:
        known = ", ".join(" ".join(title).rstrip() for title in REDUCTIONS)
        raise InputError(f"{case.name}: there is no reduction for {method!r} {sub!r}; known: {known}")
    case.check_records(reduction.records)
    try:
        with np.errstate(all="ignore"):  # of readings that are no readings; what becomes of them is null
            result = reduction.reduce(case)
    except NotDetermined as problem:
        files = ", ".join(record.name for record in case.content.records.values())
        raise InputError(f"{case.name}: the record is insufficient ({files}): {problem}") from None
    result = with_doubts(result, result.pop("doubts"))
    result["notes"] = [*case.notes, *result["notes"]]
    return {"method": method, "sub": sub, **_json(result)}


def _static(case: Case) -> dict[str, Any]:
    settings = case.settings(StaticSettings)
    table = case.record("tumble", "cycle,leg,dwell,T_set_C,T_meas_C,pos_deg,rep,U_V,valid")
    record = TumbleRecord(
        cycle=table.whole_numbers("cycle"),
        leg=table.words("leg", LEGS),
        dwell=table.whole_numbers("dwell"),
        set_c=table.numbers("T_set_C"),
        measured_c=table.numbers("T_meas_C"),
        position_deg=table.numbers("pos_deg"),
        repetition=table.numbers("rep"),
        output_v=table.numbers("U_V"),
        valid=table.truths("valid"),
    )
    found = reduce_static(record, settings.degree)
    return {
        "points": [_point(dwell) for dwell in found.dwells],
        "K0": _characteristic(found.bias),
        "K1": _characteristic(found.scale),
        "flags": found.flags,
        "notes": [],
        "rejected": found.excluded,
        "doubts": case_doubts.tumble(
            record.position_deg, record.output_v, record.measured_c, record.set_c,
            found.dwells,
        ),
    }  # fmt: skip


def _point(dwell: Dwell) -> dict[str, Any]:
    return {
        "T_C": dwell.temperature_c,
        "T_set_C": dwell.set_c,
        "leg": dwell.leg,
        "cycle": dwell.cycle,
        "dwell": dwell.number,
        "K0_V": dwell.tumble.c0,
        "K1_V_per_g": dwell.tumble.k1,
        "K2_V_per_g2": dwell.tumble.c2,
        "delta_rad": dwell.tumble.misalignment_rad,
    }


def _characteristic(found: Characteristic) -> dict[str, Any]:
    polynomial, line, loop = found.polynomial, found.line, found.hysteresis
    return {
        "poly": polynomial.powers if polynomial else [],
        "linear": line.powers if line else None,
        "u_linear": line.u_powers if line else None,
        "max_resid": polynomial.max_residual if polynomial else None,
        "max_resid_linear": line.max_residual if line else None,
        "hysteresis_max": loop.value if loop else None,
        "hysteresis_at_C": loop.set_c if loop else None,
    }


def _dynamic(case: Case) -> dict[str, Any]:
    settings = case.settings(DynamicSettings)
    table = case.record("ramp", "cycle,leg,t_s,T_C,U_V")
    record = RampRecord(
        cycle=table.whole_numbers("cycle"),
        leg=table.words("leg", LEGS),
        time_s=table.numbers("t_s"),
        temperature_c=table.numbers("T_C"),
        output_g=table.numbers("U_V") / settings.scale_v_per_g,
    )
    limits = RampLimits(
        jump_threshold_ug=settings.jump_threshold_ug,
        jump_window=settings.jump_window,
        residual_ug=settings.resid_limit_ug,
        repeatability_ug=settings.repeat_limit_ug,
    )
    try:
        found, scale_v_per_g = reduce_ramp(record, limits), settings.scale_v_per_g
    except NotDetermined as problem:
        return _no_ramp(record, problem)
    bias_v, slope_v_per_c = found.line.powers * scale_v_per_g
    return {
        "B0_V": bias_v,
        "B1_V_per_C": slope_v_per_c,
        "max_resid_ug": found.max_residual_ug,
        "rms_resid_ug": found.rms_residual_ug,
        "hysteresis_max_ug": found.hysteresis_ug,
        "repeatability_max_ug": found.repeatability_ug,
        "jumps": [
            {"cycle": jump.cycle, "leg": jump.leg, "T_C": jump.temperature_c, "size_ug": jump.size_ug}
            for jump in found.jumps
        ],
        "lag_model": found.lag and {
            "B0_V": found.lag.bias_g * scale_v_per_g,
            "B1_V_per_C": found.lag.slope_g_per_c * scale_v_per_g,
            "Bd_V_s_per_C": found.lag.rate_g_s_per_c * scale_v_per_g,
            "max_resid_ug": found.lag.max_residual_ug,
        },
        "verdict": found.verdict,
        "flags": found.flags,
        "notes": [
            *(["the loop is a lag behind the thermometer, not hysteresis"] if found.is_lag else []),
            *(f"not known: {what}" for what in found.missing),
        ],
        "rejected": found.excluded,
        "doubts": [
            *plausibility.scale(
                "settings.K1_V_per_g", settings.scale_v_per_g, plausibility.SCALES_V_PER_G, "V/g"
            ),
            *case_doubts.ramp(found.legs, record.temperature_c, record.output_g, float(found.line.powers[1])),
        ],
    }  # fmt: skip


def _no_ramp(record: RampRecord, problem: NotDetermined) -> dict[str, Any]:
    """Of a record without two temperatures: nothing is known, and nothing judged."""
    legs, excluded = cut_into_legs(record)
    return dict.fromkeys(RAMP_FIGURES) | {
        "jumps": [],
        "lag_model": None,
        "verdict": None,
        "flags": ["invalid"],
        "notes": [f"the record is insufficient: {problem}"],
        "rejected": excluded,
        "doubts": case_doubts.ramp(legs, record.temperature_c, record.output_g, None),
    }


def _tilt(case: Case) -> dict[str, Any]:
    settings = case.settings(TiltSettings)
    table, copies = case.record("tilt", "T_C,U_V").without_copies()  # no time tells a copy from an equal reading
    found = compare_tilt(
        table.numbers("T_C"),
        table.numbers("U_V"),
        scale_v_per_g=settings.scale_v_per_g,
        nominal_bias_v=settings.nominal_bias_v,
        bias_v=(settings.bias_v, settings.slope_v_per_c),
    )
    return {
        "raw_span_deg": found.raw_span_deg,
        "comp_span_deg": found.compensated_span_deg,
        "raw_mean_deg": found.raw_mean_deg,
        "comp_mean_deg": found.compensated_mean_deg,
        "flags": [flag for flag in found.flags if flag != "out_of_range"],
        "notes": [
            *(["samples beyond ±90° are left out"] if "out_of_range" in found.flags else []),
            *([f"rows left out because they are equal to another: {copies}"] if copies else []),
        ],
        "rejected": found.excluded | {"duplicate": copies},
        "doubts": [
            *plausibility.kelvin("T_C", table.numbers("T_C")),
            *case_doubts.tilts(
                table.numbers("U_V"),
                found.excluded["out_of_range"],
                settings.scale_v_per_g,
                settings.slope_v_per_c,
            ),
        ],
    }


REDUCTIONS: Reductions = {
    **case_channel.REDUCTIONS,
    **case_indexing.REDUCTIONS,
    **case_imu.REDUCTIONS,
    **case_response.REDUCTIONS,
    ("M4", "static"): Reduction(_static, ("tumble",)),
    ("M4", "dynamic"): Reduction(_dynamic, ("ramp",)),
    ("M4", "tilt"): Reduction(_tilt, ("tilt",)),
}


def _json(value: Any) -> Any:
    """Plain JSON types: arrays and tuples become lists, what is not a finite number becomes null."""
    if isinstance(value, dict):
        return {key: _json(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_json(inner) for inner in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value
