"""Static calibration of an accelerometer on an indexing table, with the unit on both of its ends (equations 3).

The sweep of each end gives a line; both lines give the unit's bias and scale factor, free of misalignment and cross
coupling; all dwells together give the model with the terms asked for.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from bench.methods.indexing.reduction.model import SweepModel, fit_sweeps
from bench.methods.indexing.reduction.sweep import EndSweep, SweepRecord, bias_drifts, reduce_end, usable_rows
from bench.methods.indexing.reduction.two_ends import (
    Agreement,
    Clocking,
    Decision,
    Mounting,
    TwoEnds,
    combine,
    fit_clocking,
)
from bench.methods.indexing.words import DRIFTS, LEFT_OUT, NO_DWELL, REPEATS, WARMED
from bench.metrology.least_squares import CONDITION_LIMIT, OUTLIER_SIGMAS, Array, NotDetermined
from bench.metrology.propagation import Measured
from bench.metrology.results.flag import ILL_CONDITIONED, INVALID, Flag

ENDS = ("up", "down")
END_MISSING = {"up": "end_up_missing", "down": "end_down_missing"}
LARGEST_CHANGE_C = 0.5


@dataclass(frozen=True, slots=True)
class CalibrationSettings:
    """Settings of the reduction: outputs at `output_limit_v` or beyond are not fitted; φ3 and φ4 as in `Mounting`."""

    terms: tuple[str, ...] = ("c0", "c1", "cxz", "delta")
    agreement: Agreement = field(default_factory=Agreement)
    outlier_k: float = OUTLIER_SIGMAS
    output_limit_v: float = np.inf
    condition_limit: float = CONDITION_LIMIT
    installation_rad: Measured | None = None
    platform_rad: Measured | None = None


@dataclass(frozen=True, slots=True)
class StaticCalibration:
    """Result of the calibration; `ends` has None for an end that was not swept, `both` needs the lines of both.

    `decision` is None when an end was not swept. `excluded` counts dwells by reason; `notes` say in words what a reader
    should know beside the flags.
    """

    ends: Mapping[str, EndSweep | None]
    both: TwoEnds | None
    decision: Decision | Literal["invalid"] | None
    model: SweepModel
    excluded: Mapping[str, int]
    flags: tuple[str, ...]
    notes: tuple[Flag, ...]


def calibrate(
    record: SweepRecord, settings: CalibrationSettings, clocking: tuple[Array, Array] | None = None
) -> StaticCalibration:
    """Reduce the sweeps of both ends; `clocking` are angles ψ (m,) in rad of the unit on its seat, and its outputs."""
    usable, excluded = usable_rows(record, settings.output_limit_v)
    first = float(np.min(usable.sequence, initial=np.inf))
    ends = _ends(record, usable, settings.outlier_k, first)
    model = _model(ends, settings, first)
    excluded["outlier"] = sum(end.outliers for end in ends.values() if end)
    seat, problem = _seat(clocking, settings.output_limit_v)
    both = _both(ends, Mounting(settings.installation_rad, settings.platform_rad, seat))
    invalid = any(end is not None and end.fit is None for end in ends.values())
    warmed_c = {name: end.dwells.temperature_change_c for name, end in ends.items() if end}
    warmed_c = {name: change_c for name, change_c in warmed_c.items() if change_c > LARGEST_CHANGE_C}
    decision = _decision(
        both, settings.agreement, invalid=invalid, missing=None in ends.values(), warmed=bool(warmed_c)
    )
    flags = {
        **{END_MISSING[name]: end is None for name, end in ends.items()},
        INVALID: invalid,
        ILL_CONDITIONED: model.doubt is not None or problem is not None,
        "hysteresis:equal_histories": _equal_histories(ends),
        "marginal": decision == "marginal" or bool(warmed_c),
    }
    return StaticCalibration(
        ends=ends,
        both=both,
        decision=decision,
        model=model,
        excluded=excluded,
        flags=tuple(flag for flag, raised in flags.items() if raised),
        notes=(
            *_notes_on_rows(excluded),
            *(Flag(NO_DWELL, f"end {name}") for name in _swept(record) if ends[name] is None),
            *(replace(note, at=f"end {name}") for name, end in ends.items() if end for note in _notes_on_end(end)),
            *(Flag(WARMED, f"end {name}", values={"change": f"{each:.2f}"}) for name, each in warmed_c.items()),
            *(replace(note, at="model") for note in model.notes),
            *([replace(problem.note, at="clock")] if problem is not None else []),
        ),
    )


def _ends(record: SweepRecord, usable: SweepRecord, outlier_k: float, first: float) -> dict[str, EndSweep | None]:
    """Line of each end. If the bias of one drifts, both are fitted with a drift, from the dwell `first`.

    An end without usable dwells is missing, unless that applies to both.
    """
    swept = [name for name in ENDS if np.any(usable.end == name)] or list(_swept(record))
    ends = {name: reduce_end(usable.rows(usable.end == name), outlier_k=outlier_k) for name in swept}
    if any(end.fit and bias_drifts(end.fit) for end in ends.values()):
        ends = {name: end.with_drift(first) for name, end in ends.items()}
    return {name: ends.get(name) for name in ENDS}


def _swept(record: SweepRecord) -> Iterator[str]:
    return (name for name in ENDS if np.any(record.end == name))


def _model(ends: Mapping[str, EndSweep | None], settings: CalibrationSettings, first: float) -> SweepModel:
    """Model of all dwells kept by the lines of the ends, with a drift if one of them has it."""
    swept = [end for end in ends.values() if end]
    dwells = SweepRecord.joined([end.dwells for end in swept])
    drifts = any(end.fit and end.fit.drift_v is not None for end in swept)
    return fit_sweeps(
        dwells.angle_rad,
        np.where(dwells.end == "up", 1.0, -1.0),
        dwells.output_v,
        settings.terms,
        since_first=dwells.sequence - first if drifts else None,
        condition_limit=settings.condition_limit,
    )


def _seat(clocking: tuple[Array, Array] | None, output_limit_v: float) -> tuple[Clocking | None, NotDetermined | None]:
    """Fit over the clocking, or the reason why there is none."""
    if clocking is None:
        return None, None
    psi_rad, output_v = clocking
    good = np.isfinite(psi_rad) & np.isfinite(output_v) & (np.abs(output_v) < output_limit_v)
    try:
        return fit_clocking(psi_rad[good], output_v[good]), None
    except NotDetermined as problem:
        return None, problem


def _both(ends: Mapping[str, EndSweep | None], mounting: Mounting) -> TwoEnds | None:
    up, down = (end.fit if end else None for end in (ends["up"], ends["down"]))
    return combine(up, down, mounting) if up and down else None


def _decision(
    both: TwoEnds | None, agreement: Agreement, *, invalid: bool, missing: bool, warmed: bool
) -> Decision | Literal["invalid"] | None:
    if missing or both is None or invalid:
        return None if missing else "invalid"
    decision = agreement.judge(both.scale_difference_v_per_g, both.scale_v_per_g.value)
    return "marginal" if warmed and decision == "accept" else decision


def _equal_histories(ends: Mapping[str, EndSweep | None]) -> bool:
    """True if there is a reverse pass, but no angle approached from both sides."""
    fits = [end.fit for end in ends.values() if end is not None and end.fit is not None]
    both_ways = any(len(np.unique(fit.dwells.direction)) > 1 for fit in fits)
    return both_ways and not any(len(fit.loop_v) for fit in fits)


def _notes_on_rows(excluded: Mapping[str, int]) -> Iterator[Flag]:
    for reason, note in LEFT_OUT.items():
        if excluded[reason]:
            yield Flag(note, values={"count": excluded[reason]})


def _notes_on_end(end: EndSweep) -> Iterator[Flag]:
    if end.why is not None:
        yield end.why
    if end.fit is not None and end.fit.drift_v is not None:
        yield Flag(DRIFTS, values={"drift": f"{end.fit.drift_v:.3g}"})
    if end.fit is not None and end.fit.pattern is not None:
        yield Flag(REPEATS, values={"periods": end.fit.pattern})
