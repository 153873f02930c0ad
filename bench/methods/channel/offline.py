"""Cases of method M0: an accelerometer channel over temperature and input level (equations 2.5 and 9)."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from bench.errors import InputError
from bench.methods.channel import doubts
from bench.methods.channel.reduction.decision import ChannelDrift, Comparison, channel_drift, compare, out_of_proportion
from bench.methods.channel.reduction.line import NARROW, ChannelRecord, ChannelRules, ChannelRun, no_counts, reduce_run
from bench.metrology.least_squares import OUTLIER_SIGMAS, NotDetermined
from bench.metrology.plausibility import Doubt
from bench.metrology.results.flag import INVALID, Flag
from bench.offline.case_file import Case, Limit, Reduction, Reductions, Scale, Settings
from bench.offline.csv_record import Table
from drivers.schema.suggest import did_you_mean
from drivers.schema.wording import telling

LEVEL_TOLERANCE = 1e-3  # tolerance between two specifications of one level
NAMES_SHOWN = 5  # names of unknown runs in a note


class RunSettings(Settings):
    """One run: gravity on the accelerometer, or a current source in its place; its level in one of three forms."""

    kind: Literal["gravity", "source"]
    a_g: float | None = None
    tilt_deg: float | None = None
    current_ma: float | None = Field(None, alias="I_mA")
    scale_ma_per_g: Scale | None = Field(None, alias="K1_mA_per_g")

    @property
    def level_g(self) -> float:
        """Input in g; a tilt is the angle of the input axis from the vertical."""
        return self._levels_g()[0]

    def _levels_g(self) -> list[float]:
        levels_g = [] if self.a_g is None else [self.a_g]
        if self.tilt_deg is not None:
            levels_g.append(math.cos(math.radians(self.tilt_deg)))
        if self.current_ma is not None and self.scale_ma_per_g is not None:
            levels_g.append(self.current_ma / self.scale_ma_per_g)
        return levels_g

    @model_validator(mode="after")
    def _one_level(self) -> Self:
        levels_g = self._levels_g()
        if not levels_g:
            raise telling("has no level; give a_g, tilt_deg, or I_mA with K1_mA_per_g")
        if max(levels_g) - min(levels_g) > LEVEL_TOLERANCE * max(map(abs, levels_g)):
            raise telling(f"has more than one level: {' g, '.join(f'{level_g:.6g}' for level_g in levels_g)} g")
        return self


class ChannelSettings(Settings):
    """Settings of a case; without `acc_temp_set_C` the accelerometer's temperature is not checked."""

    reference_c: float = Field(alias="T_ref_C", ge=-273.15, le=1000)
    counter_bits: int = Field(ge=1, le=64)
    max_rate_pps: float = Field(gt=0)
    threshold: Limit
    basis: Literal["raw", "normalised"] = Field("normalised", alias="compare_basis")
    reference_policy: Literal["claim", "embodiment"] = "claim"
    reference_run: str = "up_1g"
    source_reference_run: str = "src_1g"
    accelerometer_c: float | None = Field(None, alias="acc_temp_set_C")
    accelerometer_tolerance_c: Limit = Field(0.2, alias="acc_temp_tol_C")
    max_ramp_c_per_h: Limit = Field(30.0, alias="max_ramp_C_per_h")
    min_span_c: Limit = Field(5.0, alias="min_span_C")
    outlier_sigmas: float = Field(OUTLIER_SIGMAS, alias="outlier_k", gt=0)
    runs: dict[str, RunSettings] = Field(min_length=1)

    def rules(self, kind: str) -> ChannelRules:
        """Requirements on a run; without an accelerometer, none on its temperature."""
        return ChannelRules(
            reference_c=self.reference_c,
            counter_bits=self.counter_bits,
            max_rate_pps=self.max_rate_pps,
            accelerometer_c=self.accelerometer_c if kind == "gravity" else None,
            accelerometer_tolerance_c=self.accelerometer_tolerance_c,
            max_ramp_c_per_h=self.max_ramp_c_per_h,
            min_span_c=self.min_span_c,
            outlier_sigmas=self.outlier_sigmas,
        )

    def references(self) -> dict[str, str]:
        """Reference run of each other run.

        By the policy "claim" that is `reference_run`; by "embodiment" the source runs have a reference of their own,
        and only that one is compared with `reference_run`.
        """
        of_sources = self.source_reference_run if self.reference_policy == "embodiment" else self.reference_run
        return {
            name: of_sources if run.kind == "source" and name != self.source_reference_run else self.reference_run
            for name, run in self.runs.items()
            if name != self.reference_run
        }


def _channel(case: Case) -> dict[str, Any]:
    settings = case.settings(ChannelSettings)
    references = _references(case, settings)
    table = case.record("channel", "run,t_s,cum_pos,cum_neg,T_conv_C,T_acc_C")
    record, labels = _record(table), [text.strip() for text in table.columns["run"]]
    rows = {name: record.rows(np.array([label == name for label in labels], np.bool_)) for name in settings.runs}
    runs = {name: reduce_run(rows[name], settings.rules(run.kind)) for name, run in settings.runs.items()}
    compared = {
        name: compare(runs[name], runs[reference], threshold=settings.threshold, basis=settings.basis)
        for name, reference in references.items()
    }
    drift, drift_flags, drift_notes = _drift([run for run in runs.values() if run.valid])
    strangers = Counter(label for label in labels if label and label not in runs)
    return {
        "runs": {name: _run(run, settings.runs[name].level_g) for name, run in runs.items()},
        "deviation": {name: _deviation(found, references[name]) for name, found in compared.items()},
        "channel": _tempcos(drift),
        "flags": [*(Flag(code, of=name) for name, run in runs.items() for code in run.flags), *drift_flags],
        "notes": [
            *(f"{name}: {note}" for name, run in runs.items() for note in run.notes),
            *(f"{name}: {remark}" for name, found in compared.items() for remark in found.remarks),
            *_levels_notes(settings, runs),
            *drift_notes,
            *_strangers_notes(strangers),
            *_no_counts_notes(table, record, settings.counter_bits),
        ],
        "rejected": {"no_run": labels.count(""), "unknown_run": strangers.total()},
        "doubts": _doubts(settings, rows),
    }


def _doubts(settings: ChannelSettings, rows: Mapping[str, ChannelRecord]) -> Iterator[Doubt]:
    gravity = [name for name, run in settings.runs.items() if run.kind == "gravity"]
    yield from doubts.levels((name, settings.runs[name].level_g) for name in gravity)
    for name, record in rows.items():
        held_c = settings.accelerometer_c if name in gravity else None
        yield from doubts.thermostats(name, record.converter_c, record.accelerometer_c, held_c)


def _references(case: Case, settings: ChannelSettings) -> dict[str, str]:
    """Reference run of each run. Raises InputError if a named one is not in the case."""
    references = settings.references()
    for key, needed in (("reference_run", True), ("source_reference_run", False)):
        name = getattr(settings, key)
        if name not in settings.runs and (needed or name in references.values()):
            close = did_you_mean(name, settings.runs)
            raise InputError(f"{case.name}: settings.{key}: there is no run '{name}'{close}")
    return references


def _record(table: Table) -> ChannelRecord:
    return ChannelRecord(
        time_s=table.numbers("t_s"),
        positive=table.numbers("cum_pos"),
        negative=table.numbers("cum_neg"),
        converter_c=table.numbers("T_conv_C"),
        accelerometer_c=table.numbers("T_acc_C"),
    )


def _run(run: ChannelRun, level_g: float) -> dict[str, Any]:
    return {
        "a_g": level_g,
        "D_ref_pps": run.rate,
        "u_D_ref": run.u_rate,
        "k_pps_per_C": run.slope_per_c,
        "u_k": run.u_slope_per_c,
        "kappa_per_C": run.relative_slope_per_c,
        "residual_rms_pps": run.residual_rms,
        "n_used": run.gates_used,
        "rejected": run.excluded,
        "span_C": run.span_c,
        "ramp_C_per_h": run.ramp_c_per_h,
        "flags": run.flags,
    }


def _deviation(found: Comparison, reference: str) -> dict[str, Any]:
    return {
        "reference": reference,
        "dk_raw": found.raw.value,
        "dk_norm": found.normalised.value,
        "u_dk_raw": found.raw.u,
        "u_dk_norm": found.normalised.u,
        "dk_abs_pps_per_C": found.raw.difference,
        "dkappa_abs_per_C": found.normalised.difference,
        "decision": found.decision,
        "marginal": found.marginal,
        "final_c0": found.rate,
        "final_k": found.slope_per_c,
    }


def _drift(valid: list[ChannelRun]) -> tuple[ChannelDrift | None, list[str], list[str]]:
    """Drift of the channel as a whole with its flags and notes; none from fewer than two runs."""
    if len(valid) < 2:
        return None, [], []
    try:
        drift = channel_drift(valid)
    except NotDetermined as problem:
        return None, ["ill_conditioned"], [f"channel: {problem}: the levels are too close to each other"]
    misfit = "channel: the slopes are not an offset and a part in proportion to the level: the drift is not linear"
    return drift, [], [misfit] if drift.misfit else []


def _tempcos(drift: ChannelDrift | None) -> dict[str, Any]:
    return {
        "tempco_offset_pps_per_C": drift and drift.offset_per_c,
        "tempco_scale_per_C": drift and drift.scale_per_c,
        "u_tempco_offset_pps_per_C": drift and drift.u_offset_per_c,
        "u_tempco_scale_per_C": drift and drift.u_scale_per_c,
    }


def _levels_notes(settings: ChannelSettings, runs: Mapping[str, ChannelRun]) -> list[str]:
    levels_g = np.array([settings.runs[name].level_g for name in runs])
    odd = out_of_proportion(levels_g, np.array([run.rate for run in runs.values()]))
    return [
        f"{name}: {run.rate:.6g} pulse/s at {level_g:.6g} g is not proportional to the other runs"
        for (name, run), level_g, is_odd in zip(runs.items(), levels_g, odd, strict=True)
        if is_odd
    ]


def _strangers_notes(strangers: Mapping[str, int]) -> list[str]:
    if not strangers:
        return []
    names = ", ".join(name[:40] for name in list(strangers)[:NAMES_SHOWN])
    more = f" and {len(strangers) - NAMES_SHOWN} more" if len(strangers) > NAMES_SHOWN else ""
    return [f"rows of runs not listed in settings.runs were ignored: {names}{more}"]


def _no_counts_notes(table: Table, record: ChannelRecord, counter_bits: int) -> list[str]:
    kinds = ("counts with a fraction", f"counts that a counter of {counter_bits} bits does not show")
    found = zip(kinds, map(np.flatnonzero, no_counts(record, counter_bits)), strict=True)
    return [f"{table.file}: {kind} were left out: {table.lines(rows)}" for kind, rows in found if len(rows)]


REDUCTIONS: Reductions = {("M0", ""): Reduction(_channel, ("channel",), ("runs",), frozenset({NARROW, INVALID}))}
