"""Step that waits until the outputs of units no longer drift, for example after power-on."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping
from typing import Any

from bench.engine.context import Bench
from bench.engine.outputs import Watched, acquire_into
from bench.errors import StepError
from bench.metrology.outputs import steadiness
from bench.sequence.language.readings import units_at
from bench.sequence.steps.waits import STEADY_PARTS, Steady, WaitUntil
from drivers.quantity.units import customary_unit


async def until_steady(step: WaitUntil, bench: Bench) -> Mapping[str, Any]:
    """Wait until the outputs of all remaining units are steady; StepError if that takes too long.

    With several units, one that is not steady by then is dropped. These measurements are not recorded.
    """
    if step.steady is None:
        raise StepError("it does not name the outputs that must be steady")
    found: dict[str, Any] = {}
    part_s = step.steady.over_s / STEADY_PARTS
    watched = Watched(bench.file, step.steady.over_s)
    roles = bench.file.acquired_from(step.reading.partition(".")[0])
    end = _wait_for_all(step, step.steady, bench, watched, found)
    await acquire_into(roles, bench.rig, [watched], end, part_s / STEADY_PARTS)
    return found


async def _wait_for_all(step: WaitUntil, steady: Steady, bench: Bench, watched: Watched, found: dict[str, Any]) -> None:
    """Wait until all units are stable, with the data in `found`; drop those that are not in time, or raise."""
    loop = asyncio.get_running_loop()
    began_s, unit = loop.time(), "g" if steady.in_g else customary_unit(steady.change.dimension)
    most = steady.change.to(unit)
    while True:
        await asyncio.sleep(steady.over_s / STEADY_PARTS)
        left = [place for place in units_at(step.reading, bench.file) if place in bench.monitor.units.left]
        changes = {place: _change(place, steady, bench, watched) for place in left}
        restless = {place: change for place, change in changes.items() if not abs(change) <= most}
        waited_s = loop.time() - began_s
        if not restless:
            found |= {"changes": changes, "unit": unit, "waited_s": waited_s}
            return
        if waited_s >= step.give_up_after_s:
            text = " ".join(_in_words(place, change, steady, f"{most:.3g}", unit) for place, change in restless.items())
            if not bench.monitor.drop_all(restless, "not_settled", text):
                raise StepError(f"{text} Check whether the temperature still changes, or allow a larger change.")


def _change(place: str, steady: Steady, bench: Bench, watched: Watched) -> float:
    """Change of the line fitted to the output over the window; infinite while it is unknown."""
    measured = watched.measured(place)
    known = steadiness(measured, steady.over_s, steady.over_s / STEADY_PARTS) if measured is not None else None
    if known is None:
        return math.inf
    _, slope_per_s = known
    per_unit = bench.file.nominal_per_g(place) if steady.in_g else 1.0
    return slope_per_s * steady.over_s / (per_unit or math.nan)


def _in_words(place: str, change: float, steady: Steady, most: str, unit: str) -> str:
    over = f"over {steady.over_s / 60:g} min"
    if math.isinf(change):
        return f"Too few usable readings of the output of the unit in place {place} {over}."
    problem = f"The output of the unit in place {place} still changed by {change:.3g} {unit} {over}"
    return f"{problem}, allowed are {most} {unit}."
