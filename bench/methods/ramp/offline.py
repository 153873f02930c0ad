"""Cases of method M4b: a ramp of temperature at one position (equations 6.3 and 9)."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from bench.methods.ramp import doubts
from bench.methods.ramp.reduction.characteristic import RampLimits, reduce_ramp
from bench.methods.ramp.reduction.legs import RampRecord, cut_into_legs
from bench.metrology import plausibility
from bench.metrology.least_squares import NotDetermined
from bench.metrology.results.flag import INVALID
from bench.offline.case_file import LEGS, Case, Limit, Reduction, Reductions, Scale, Settings

RAMP_FIGURES = (
    "B0_V", "B1_V_per_C", "max_resid_ug", "rms_resid_ug", "hysteresis_max_ug", "repeatability_max_ug",
)  # fmt: skip


class DynamicSettings(Settings):
    """Settings of `dynamic`; no verdict on a limit that is not given."""

    scale_v_per_g: Scale = Field(alias="K1_V_per_g")
    jump_threshold_ug: float = Field(60.0, gt=0)
    jump_window: int = Field(8, ge=2, le=1000)
    resid_limit_ug: Limit | None = None
    repeat_limit_ug: Limit | None = None


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
            *doubts.ramp(found.legs, record.temperature_c, record.output_g, float(found.line.powers[1])),
        ],
    }  # fmt: skip


def _no_ramp(record: RampRecord, problem: NotDetermined) -> dict[str, Any]:
    """Result of a record without two temperatures: everything unknown, no verdict."""
    legs, excluded = cut_into_legs(record)
    return dict.fromkeys(RAMP_FIGURES) | {
        "jumps": [],
        "lag_model": None,
        "verdict": None,
        "flags": [INVALID],
        "notes": [f"the record is insufficient: {problem}"],
        "rejected": excluded,
        "doubts": doubts.ramp(legs, record.temperature_c, record.output_g, None),
    }


REDUCTIONS: Reductions = {("M4", "dynamic"): Reduction(_dynamic, ("ramp",), lacking=frozenset({INVALID}))}
