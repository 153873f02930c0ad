"""Off-line reduction of recorded data: `case.json` and CSV records in, the result as plain JSON types out.

The formats, the names of settings and results, and the units in them are those of equations 9.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from bench.errors import InputError
from bench.metrology.least_squares import NotDetermined
from bench.metrology.results.flag import Flag
from bench.offline.case_file import Reduction, read_case
from bench.offline.doubts import with_doubts
from bench.offline.outcome import ReducedCase
from bench.sequence.method import known_methods
from drivers.installed import loaded


@lru_cache(maxsize=1)
def reductions() -> Mapping[tuple[str, str], Reduction]:
    """Reductions of recorded cases of the installed methods, by method and sub-method."""
    targets = dict.fromkeys(method.offline for method in known_methods().values() if method.offline)
    return {title: reduction for target in targets for title, reduction in loaded(target).items()}


def reduction_of(method: str, sub: str) -> Reduction | None:
    """Reduction of such cases, if there is one; a method with a single reduction has no sub-method."""
    return reductions().get((method, sub)) or reductions().get((method, ""))


def reduce_case(path: Path) -> dict[str, Any]:
    """Reduce the case file at `path`; return the content of `result.json`. Raises as `reduced_case`."""
    return reduced_case(path).content


def reduced_case(path: Path) -> ReducedCase:
    """Reduce the case file at `path`.

    Raises InputError, with the file and the place in it, if the case cannot be read or reduced.
    """
    case = read_case(path)
    method, sub = case.content.method, case.content.sub
    reduction = reduction_of(method, sub)
    if reduction is None:
        known = ", ".join(" ".join(title).rstrip() for title in reductions())
        raise InputError(f"{case.name}: there is no reduction for {method!r} {sub!r}; known: {known}")
    case.check_records(reduction.records)
    try:
        with np.errstate(all="ignore"):  # readings that are not plausible numbers; the results from them are null
            result = reduction.reduce(case)
    except NotDetermined as problem:
        files = ", ".join(record.name for record in case.content.records.values())
        raise InputError(f"{case.name}: the record is insufficient ({files}): {problem}") from None
    flags = [each if isinstance(each, Flag) else Flag(each) for each in result["flags"]]
    result |= {"flags": list(map(str, flags)), "notes": [*case.notes, *map(str, result["notes"])]}
    result["lacking"] = [str(flag) for flag in flags if flag.code in reduction.lacking]
    content = _json({"method": method, "sub": sub, **with_doubts(result, result.pop("doubts"))})
    lacking, parts = content.pop("lacking"), [content[name] for name in reduction.parts]
    if any(not part or all(each is None for each in part) for part in parts):
        lacking.append("nothing")
    return ReducedCase(content, tuple(lacking))


def _json(value: Any) -> Any:
    """Convert to plain JSON types: arrays and tuples become lists, numbers that are not finite become null."""
    if isinstance(value, dict):
        return {key: _json(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_json(inner) for inner in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value
