"""Off-line reduction of recorded data: `case.json` and CSV records in, the result as plain JSON types out.

The formats, the names of settings and results, and the units in them are those of methods.md section 9.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from bench.analysis.fit import NotDetermined
from bench.analysis.ramp import RampRecord
from bench.analysis.temperature_dynamic import RampLimits, reduce_ramp
from bench.analysis.temperature_static import Characteristic, Dwell, TumbleRecord, reduce_static
from bench.analysis.tilt import compare_tilt
from bench.errors import InputError
from bench.report.table import Table, read_table, read_text
from drivers.fields import FileBeside
from drivers.wording import in_plain_words

CASE_LIMIT_BYTES = 2**20
LEGS = ("up", "down")
SettingsT = TypeVar("SettingsT", bound=BaseModel)


def _not_zero(value: float) -> float:
    if value == 0:
        raise ValueError("is 0; a scale factor is not")
    return value


Scale = Annotated[float, AfterValidator(_not_zero)]
Limit = Annotated[float, Field(ge=0)]


class _Settings(BaseModel):
    """Settings that a reduction does not know are for somebody else and passed over."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)


class StaticSettings(_Settings):
    """Of `static`; without a degree it is chosen by the data."""

    degree: int | None = Field(None, ge=1, le=8)


class DynamicSettings(_Settings):
    """Of `dynamic`; a limit that is not given is not judged."""

    scale_v_per_g: Scale = Field(alias="K1_V_per_g")
    jump_threshold_ug: float = Field(60.0, gt=0)
    jump_window: int = Field(8, ge=2, le=1000)
    resid_limit_ug: Limit | None = None
    repeat_limit_ug: Limit | None = None


class TiltSettings(_Settings):
    """Of `tilt`."""

    scale_v_per_g: Scale = Field(alias="K1_V_per_g")
    bias_v: float = Field(alias="B0_V")
    slope_v_per_c: float = Field(alias="B1_V_per_C")
    nominal_bias_v: float = Field(alias="K0_nominal_V")


class CaseFile(_Settings):
    """What stands in `case.json`; the records are files in its folder or below."""

    format: Literal["itb-case/1"] = Field(alias="schema")
    method: str
    sub: str = ""
    site: dict[str, Any] = Field(default_factory=dict)
    settings: dict[str, Any] = Field(default_factory=dict)
    records: dict[str, Annotated[Path, FileBeside()]]


@dataclass(frozen=True, slots=True)
class _Case:
    """A case file that was read, and its name for error messages."""

    name: str
    content: CaseFile

    def settings(self, model: type[SettingsT]) -> SettingsT:
        return _validated(model, self.content.settings, f"{self.name}: settings.")

    def record(self, name: str, columns: str) -> Table:
        if name not in self.content.records:
            raise InputError(f"{self.name}: records: '{name}' is missing; {self._title()} needs it")
        return read_table(self.content.records[name], columns.split(","))

    def _title(self) -> str:
        return f"{self.content.method} {self.content.sub}".rstrip()


def reduce_case(path: Path) -> dict[str, Any]:
    """Reduces the case file at `path`; gives the content of `result.json`.

    Raises InputError, which names the file and the place in it, when the case cannot be read or reduced.
    """
    case = _read_case(path)
    reduce = REDUCTIONS.get((case.content.method, case.content.sub))
    if reduce is None:
        known = ", ".join(f"{method} {sub}" for method, sub in REDUCTIONS)
        raise InputError(
            f"{case.name}: there is no reduction of {case.content.method!r} {case.content.sub!r}; known: {known}"
        )
    try:
        result = reduce(case)
    except NotDetermined as problem:
        files = ", ".join(record.name for record in case.content.records.values())
        raise InputError(f"{case.name}: the record does not suffice ({files}): {problem}") from None
    return {"method": case.content.method, "sub": case.content.sub, **_json(result)}


def _read_case(path: Path) -> _Case:
    text = read_text(path, CASE_LIMIT_BYTES)
    try:
        content = json.loads(text)
    except json.JSONDecodeError as problem:
        raise InputError(f"{path.name}: line {problem.lineno}, column {problem.colno}: {problem.msg}") from None
    except (RecursionError, ValueError):
        raise InputError(f"{path.name}: nested too deeply, or a number with too many digits") from None
    return _Case(path.name, _validated(CaseFile, content, f"{path.name}: ", folder=path.parent))


def _validated(model: type[SettingsT], content: Any, where: str, folder: Path | None = None) -> SettingsT:
    try:
        return model.model_validate(content, context={"folder": folder})
    except ValidationError as problem:
        details = [
            ".".join(map(str, item["loc"])) + (": " if item["loc"] else "") + in_plain_words(item)
            for item in problem.errors(include_url=False)
        ]
        raise InputError(where + "; ".join(details)) from None


def _static(case: _Case) -> dict[str, Any]:
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
        "rejected": found.excluded,
    }


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


def _dynamic(case: _Case) -> dict[str, Any]:
    settings = case.settings(DynamicSettings)
    table = case.record("ramp", "cycle,leg,t_s,T_C,U_V")
    record = RampRecord(
        cycle=table.whole_numbers("cycle"),
        leg=table.words("leg", LEGS),
        time_s=table.numbers("t_s"),
        temperature_c=table.numbers("T_C"),
        output_v=table.numbers("U_V"),
    )
    limits = RampLimits(
        jump_threshold_ug=settings.jump_threshold_ug,
        jump_window=settings.jump_window,
        residual_ug=settings.resid_limit_ug,
        repeatability_ug=settings.repeat_limit_ug,
    )
    found = reduce_ramp(record, settings.scale_v_per_g, limits)
    return {
        "B0_V": found.bias_v,
        "B1_V_per_C": found.slope_v_per_c,
        "max_resid_ug": found.max_residual_ug,
        "rms_resid_ug": found.rms_residual_ug,
        "hysteresis_max_ug": found.hysteresis_ug,
        "repeatability_max_ug": found.repeatability_ug,
        "jumps": [
            {"cycle": jump.cycle, "leg": jump.leg, "T_C": jump.temperature_c, "size_ug": jump.size_ug}
            for jump in found.jumps
        ],
        "lag_model": found.lag and {
            "B0_V": found.lag.bias_v,
            "B1_V_per_C": found.lag.slope_v_per_c,
            "Bd_V_s_per_C": found.lag.rate_v_s_per_c,
            "max_resid_ug": found.lag.max_residual_ug,
        },
        "verdict": found.verdict,
        "flags": found.flags,
        "notes": ["the loop is a lag behind the thermometer, not hysteresis"] if found.is_lag else [],
        "rejected": found.excluded,
    }  # fmt: skip


def _tilt(case: _Case) -> dict[str, Any]:
    settings = case.settings(TiltSettings)
    table = case.record("tilt", "T_C,U_V")
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
        "flags": found.flags,
        "rejected": found.excluded,
    }


REDUCTIONS: Mapping[tuple[str, str], Callable[[_Case], dict[str, Any]]] = {
    ("M4", "static"): _static,
    ("M4", "dynamic"): _dynamic,
    ("M4", "tilt"): _tilt,
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
