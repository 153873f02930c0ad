"""Cases recorded elsewhere: `bench reduce case.json` reduces them with the arithmetic of the method."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from bench.metrology.least_squares import Array
from bench.metrology.plausibility import Doubt
from bench.offline.case_file import Case, Reduction, Reductions, Settings
from pydantic import Field

from toy_rest.reduction import CURVED, TOO_FEW, line_of

LONGEST_S = 30 * 86400.0


class CaseSettings(Settings):
    """Settings of a case."""

    fewest: int = Field(10, ge=4)


def _rest(case: Case) -> dict[str, Any]:
    table = case.record("rest", "t_s,output")
    time_s, output = table.numbers("t_s"), table.numbers("output")
    known = np.isfinite(time_s) & np.isfinite(output)
    time_s, output = time_s[known], output[known]
    result: dict[str, Any] = {"readings": len(output), "flags": [], "notes": [], "doubts": _doubts(time_s)}
    if len(output) < case.settings(CaseSettings).fewest:
        return result | {"flags": [TOO_FEW]}
    rest = line_of(time_s, output)
    return result | {
        "mean": rest.mean,
        "mean_u": rest.mean_u,
        "drift_per_h": rest.slope_per_h / rest.mean,
        "drift_u_per_h": rest.slope_u_per_h / abs(rest.mean),
        "flags": [CURVED] if rest.is_curved else [],
    }


def _doubts(time_s: Array) -> Iterator[Doubt]:
    """Reasons not to rely on the result; a doubtful one is INCOMPLETE."""
    if len(time_s) and np.ptp(time_s) > LONGEST_S:
        yield Doubt("implausible_time", f"t_s spans {np.ptp(time_s):.4g} s; is it in milliseconds?")
    if np.any(np.diff(time_s) <= 0):
        yield Doubt("implausible_time", "t_s does not rise from row to row")


LACKING = frozenset({TOO_FEW})
REDUCTIONS: Reductions = {("toy_rest", ""): Reduction(_rest, ("rest",), lacking=LACKING)}
