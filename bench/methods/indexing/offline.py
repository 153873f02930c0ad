"""Off-line reduction of method M1: static calibration on an indexing table (equations 3 and 9)."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field

from bench.methods.indexing import doubts
from bench.methods.indexing.reduction.calibrate import END_MISSING, CalibrationSettings, StaticCalibration, calibrate
from bench.methods.indexing.reduction.model import SweepModel
from bench.methods.indexing.reduction.sweep import EndSweep, SweepRecord, by_travel
from bench.methods.indexing.reduction.two_ends import Agreement, TwoEnds
from bench.metrology.least_squares import Array
from bench.metrology.propagation import Measured
from bench.metrology.results.flag import INVALID
from bench.offline.case_file import Case, Limit, Reduction, Reductions, Settings
from bench.offline.csv_record import Table

Term = Literal["c0", "c1", "c2", "c3", "cxz", "delta"]
MEASURED = (
    "G_V_per_g", "b_V", "dG_V_per_g", "db_V", "delta_rad", "cxz_V_per_g2", "b3_V", "b4_V", "b5_V", "b_total_V",
    "b_corrected_V",
)  # fmt: skip
REJECTED = ("unstable", "saturated", "outlier")


def _each_once(terms: tuple[Term, ...]) -> tuple[Term, ...]:
    if len(set(terms)) < len(terms):
        raise ValueError("names a term twice")
    return terms


class MountSettings(Settings):
    """Residual angles of the installation and of the platform; None if not measured."""

    angle3_rad: float | None = None
    angle4_rad: float | None = None
    u_angle3_rad: Limit = 0.0
    u_angle4_rad: Limit = 0.0


class IndexingSettings(Settings):
    """Settings of a case of M1; `repeats` is the number of preceding repetitions of this calibration."""

    terms: Annotated[tuple[Term, ...], Field(min_length=1), AfterValidator(_each_once)] = ("c0", "c1", "cxz", "delta")
    scale_tolerance: Limit = Field(0.0, alias="G_tol_rel")
    k_tol: Limit = 2.0
    outlier_k: float = Field(6.0, gt=0)
    output_limit_v: float | None = Field(None, alias="output_limit_V", gt=0)
    cond_limit: float = Field(1e3, ge=1)
    max_repeats: int = Field(3, ge=0)
    repeats: int = Field(0, ge=0)
    mount: MountSettings = Field(default_factory=MountSettings)


def _static_calibration(case: Case) -> dict[str, Any]:
    settings = case.settings(IndexingSettings)
    table = case.record("sweep", "end,pass,seq,theta_deg,V_mean,stable", optional="T_C,approach")
    clock, copies = case.record("clock", "psi_deg,V").without_copies() if case.has("clock") else (None, 0)
    # readings that cannot be voltages; the results from them are null
    with np.errstate(over="ignore", invalid="ignore"):
        record = _sweep(table)
        found = calibrate(record, _settings(settings), _clocking(clock))
    ends = {name: end and _end(end) for name, end in found.ends.items()}
    tilt_rad = found.both.surface_tilt_rad if found.both else None
    missing = None in ends.values()
    return {
        "ends": ends,
        "combined": None if missing else _combined(found),
        "model": _model(found.model),
        "rejected": {reason: found.excluded[reason] for reason in REJECTED},
        "flags": found.flags,
        "notes": [*found.notes, *([f"clock: rows left out because they are there twice: {copies}"] if copies else [])],
        "doubts": [
            *doubts.sweep(
                record.angle_deg,
                record.output_v,
                {
                    name: (end.fit.scale_v_per_g, end.fit.linearity)
                    for name, end in found.ends.items()
                    if end and end.fit
                },
                {"angle3_rad": settings.mount.angle3_rad, "angle4_rad": settings.mount.angle4_rad},
            ),
            *(doubts.clocked(clock.numbers("V"), tilt_rad) if clock else ()),
        ],
    }


def _sweep(table: Table) -> SweepRecord:
    came = table.words("approach", ("from_below", "from_above"))
    record = SweepRecord(
        end=table.words("end", ("up", "down")),
        direction=table.words("pass", ("fwd", "rev")),
        sequence=_sequence(table),
        angle_deg=table.numbers("theta_deg"),
        output_v=table.numbers("V_mean"),
        stable=table.truths("stable"),
        temperature_c=table.numbers("T_C"),
        side=np.select([came == "from_below", came == "from_above"], ["below", "above"], ""),
        stand=np.zeros(len(came), dtype=np.int_),
    )
    return by_travel(record)


def _sequence(table: Table) -> Array:
    """Order of the dwells; that of the file if the column is empty."""
    given = table.numbers("seq")
    return given if np.isfinite(given).any() else np.arange(float(len(given)))


def _clocking(table: Table | None) -> tuple[Array, Array] | None:
    return None if table is None else (np.radians(table.numbers("psi_deg")), table.numbers("V"))


def _settings(settings: IndexingSettings) -> CalibrationSettings:
    mount = settings.mount
    return CalibrationSettings(
        terms=settings.terms,
        agreement=Agreement(settings.scale_tolerance, settings.k_tol, settings.repeats, settings.max_repeats),
        outlier_k=settings.outlier_k,
        output_limit_v=np.inf if settings.output_limit_v is None else settings.output_limit_v,
        condition_limit=settings.cond_limit,
        installation_rad=None if mount.angle3_rad is None else Measured(mount.angle3_rad, mount.u_angle3_rad),
        platform_rad=None if mount.angle4_rad is None else Measured(mount.angle4_rad, mount.u_angle4_rad),
    )


def _end(end: EndSweep) -> dict[str, Any]:
    fit = end.fit
    u_bias, u_scale = fit.u if fit else (None, None)
    return {
        "b_V": fit and fit.bias_v,
        "G_V_per_g": fit and fit.scale_v_per_g,
        "u_b": u_bias,
        "u_G": u_scale,
        "linearity": fit and fit.linearity,
        "hysteresis_max_V": fit and fit.hysteresis_v,
        "n": len(end.dwells),
    }


def _combined(found: StaticCalibration) -> dict[str, Any]:
    """Results of both ends together; all null if one of them has no line."""
    measured = _measured(found.both) if found.both else dict.fromkeys(MEASURED)
    return {
        **{name: value and value.value for name, value in measured.items()},
        "surface_tilt_rad": found.both and found.both.surface_tilt_rad,
        "decision": found.decision,
        "u": {name: value and value.u for name, value in measured.items()},
    }


def _measured(both: TwoEnds) -> dict[str, Measured | None]:
    return dict(zip(MEASURED, (
        both.scale_v_per_g, both.bias_v, both.scale_difference_v_per_g, both.bias_difference_v, both.misalignment_rad,
        both.coupling_v_per_g2, both.installation_v, both.platform_v, both.beyond_v, both.bias_total_v,
        both.bias_corrected_v,
    ), strict=True))  # fmt: skip


def _model(model: SweepModel) -> dict[str, Any]:
    """Results of the model; null if not found or not requested."""
    fit = model.fit
    c1 = model.value("c1")
    return {
        "params": {term: model.value(term) for term in model.terms},
        "u": dict(zip(model.terms, fit.u if fit else [None] * len(model.terms), strict=True)),
        "covariance": fit and fit.covariance,
        "cond": fit.linear.condition if fit else model.doubt and model.doubt.condition,
        "rank": fit.linear.rank if fit else model.doubt and model.doubt.rank,
        "rms_V": fit and float(np.sqrt(np.mean(fit.residuals**2))),
        "iterations": fit and fit.iterations,
        "ieee": {
            "K1_V_per_g": c1,
            "K0_g": _ratio(model.value("c0"), c1),
            "K2_g_per_g2": _ratio(model.value("c2"), c1),
            "K3_g_per_g3": _ratio(model.value("c3"), c1),
            "Kxz_g_per_g2": _ratio(model.value("cxz"), c1),
            "delta_rad": model.value("delta"),
        },
    }


def _ratio(coefficient: float | None, c1: float | None) -> float | None:
    return coefficient / c1 if coefficient is not None and c1 else None


LACKING = frozenset({*END_MISSING.values(), INVALID})
REDUCTIONS: Reductions = {("M1", ""): Reduction(_static_calibration, ("sweep", "clock"), lacking=LACKING)}
