"""Cases of method M4a, the static tumble, and of an accelerometer as a tilt meter (equations 6 and 9)."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import Field

from bench.methods.tumble import doubts
from bench.methods.tumble.reduction.dwells import DWELL_ILL_CONDITIONED, DWELL_INCOMPLETE, SolvedDwell
from bench.methods.tumble.reduction.recorded_dwells import DWELL_INVALID, TumbleRecord, recorded_dwells
from bench.methods.tumble.reduction.temperature_models import TemperatureModels, temperature_models
from bench.metrology import plausibility
from bench.metrology.results.flag import ILL_CONDITIONED, TOO_FEW_TEMPERATURES
from bench.metrology.tilt import TiltModel, compare_tilt, compare_tilt_of_two
from bench.offline.case_file import LEGS, Case, Reduction, Reductions, Scale, Settings
from bench.offline.csv_record import Table


class StaticSettings(Settings):
    """Settings of `static`; without a degree it is chosen by the data."""

    degree: int | None = Field(None, ge=1, le=8)


class TiltAxisSettings(Settings):
    """Scale factor and biases of an accelerometer that measures a tilt."""

    scale_v_per_g: Scale = Field(alias="K1_V_per_g")
    bias_v: float = Field(alias="B0_V")
    slope_v_per_c: float = Field(alias="B1_V_per_C")
    nominal_bias_v: float = Field(alias="K0_nominal_V")

    @property
    def model(self) -> TiltModel:
        """The same for the reduction."""
        return TiltModel(self.scale_v_per_g, self.nominal_bias_v, (self.bias_v, self.slope_v_per_c))


class TiltSettings(TiltAxisSettings):
    """Settings of `tilt`; `across` is a second accelerometer at 90° and a skew, up when the first is level."""

    across: TiltAxisSettings | None = None
    skew_rad: float = 0.0
    u_skew_rad: float = Field(0.0, ge=0)


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
    dwells, flags, excluded = recorded_dwells(record)
    values = {
        "K0": np.array([dwell.tumble.c0 for dwell in dwells]),
        "K1": np.array([dwell.tumble.k1 for dwell in dwells]),
    }
    models = {
        name: temperature_models(name, value, dwells, settings.degree, lowest=0) for name, value in values.items()
    }
    return {
        "points": [_point(dwell) for dwell in dwells],
        **{name: _over_temperature(found) for name, found in models.items()},
        "flags": [*flags, *(flag for found in models.values() for flag in dict.fromkeys(found.flags))],
        "notes": [],
        "rejected": excluded,
        "doubts": doubts.tumble(record.position_deg, record.output_v, record.measured_c, record.set_c, dwells),
    }


def _point(dwell: SolvedDwell) -> dict[str, Any]:
    return {
        "T_C": dwell.temperature_c,
        "T_set_C": dwell.set_c,
        "leg": "up" if dwell.rising else "down",
        "cycle": dwell.cycle,
        "dwell": dwell.number,
        "K0_V": dwell.tumble.c0,
        "K1_V_per_g": dwell.tumble.k1,
        "K2_V_per_g2": dwell.tumble.c2,
        "delta_rad": dwell.tumble.misalignment_rad,
    }


def _over_temperature(found: TemperatureModels) -> dict[str, Any]:
    model, line, loop = found.model, found.line, found.loop
    return {
        "poly": model.powers if model else [],
        "linear": line.powers if line else None,
        "u_linear": line.u_powers if line else None,
        "max_resid": model.max_residual if model else None,
        "max_resid_linear": line.max_residual if line else None,
        "hysteresis_max": loop.value if loop else None,
        "hysteresis_at_C": loop.set_c if loop else None,
    }


def _tilt(case: Case) -> dict[str, Any]:
    settings = case.settings(TiltSettings)
    # without a time, a copy cannot be distinguished from an equal reading
    two = settings.across is not None
    table, copies = case.record("tilt", "T_C,U_V,U_across_V" if two else "T_C,U_V").without_copies()
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
        **_by_both(settings, table),
        "flags": [flag for flag in found.flags if flag != "out_of_range"],
        "notes": [
            *(["samples beyond ±90° are left out"] if "out_of_range" in found.flags else []),
            *([f"rows left out because they are equal to another: {copies}"] if copies else []),
        ],
        "rejected": found.excluded | {"duplicate": copies},
        "doubts": [
            *plausibility.kelvin("T_C", table.numbers("T_C")),
            *doubts.tilts(
                table.numbers("U_V"),
                found.excluded["out_of_range"],
                settings.scale_v_per_g,
                settings.slope_v_per_c,
            ),
        ],
    }


def _by_both(settings: TiltSettings, table: Table) -> dict[str, Any]:
    """Tilt by two accelerometers, where the settings have a second."""
    if settings.across is None:
        return {}
    found = compare_tilt_of_two(
        table.numbers("T_C"), (table.numbers("U_V"), table.numbers("U_across_V")),
        (settings.model, settings.across.model), skew_rad=settings.skew_rad, u_skew_rad=settings.u_skew_rad,
    )  # fmt: skip
    return {
        "of_two": {
            "raw_span_deg": found.raw_span_deg,
            "comp_span_deg": found.compensated_span_deg,
            "raw_mean_deg": found.raw_mean_deg,
            "comp_mean_deg": found.compensated_mean_deg,
            "u_skew_deg": found.u_skew_deg,
        }
    }


REDUCTIONS: Reductions = {
    ("M4", "static"): Reduction(
        _static,
        ("tumble",),
        ("points",),
        frozenset({DWELL_INCOMPLETE, DWELL_ILL_CONDITIONED, DWELL_INVALID, TOO_FEW_TEMPERATURES, ILL_CONDITIONED}),
    ),
    ("M4", "tilt"): Reduction(_tilt, ("tilt",), lacking=frozenset({TOO_FEW_TEMPERATURES})),
}
