"""Steps that wait for readings: until a condition holds, until a unit is as warm as its chamber."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from bench.engine.monitor import Monitor
from bench.errors import StepError
from bench.sequence.waits import LOOK_EVERY_S, WINDOW_COVERAGE, Soak, Stable, WaitUntil


async def until(step: WaitUntil, monitor: Monitor) -> Mapping[str, Any]:
    """Until every reading of the last `hold_s` fulfils the condition; StepError when that takes too long."""
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    unit = monitor.unit_of(step.reading)
    low = -math.inf if step.above is None else step.above.to(unit)
    high = math.inf if step.below is None else step.below.to(unit)
    while True:
        window = monitor.last(step.reading, step.hold_s)
        covered = len(window) > 0 and window[-1, 0] - max(window[0, 0], began_s) >= WINDOW_COVERAGE * step.hold_s
        if covered and ((low < window[:, 1]) & (window[:, 1] < high)).all():
            return {"reading": step.reading, "value": float(window[-1, 1]), "unit": unit, **_waited(began_s)}
        if loop.time() - began_s >= step.give_up_after_s:
            found = f"{window[-1, 1]:.2f} {unit}" if len(window) else "unknown"
            raise StepError(
                f"{step.reading} is {found} after {step.give_up_after_s / 60:.1f} min, expected {_condition(step)}. "
                "Check what it measures and the sensor, or wait longer."
            )
        await asyncio.sleep(LOOK_EVERY_S)


def _waited(began_s: float) -> dict[str, float]:
    return {"waited_s": asyncio.get_running_loop().time() - began_s}


def _condition(step: WaitUntil) -> str:
    above = "" if step.above is None else f"above {step.above}"
    below = "" if step.below is None else f"below {step.below}"
    held = f" for {step.hold_s:g} s" if step.hold_s else ""
    return " and ".join(filter(None, (above, below))) + held


async def soak(step: Soak, monitor: Monitor) -> Mapping[str, Any]:
    """At least so long, then until the reading is stable; StepError when that takes too long."""
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    await asyncio.sleep(step.at_least_s)
    while step.until_stable is not None:
        spread_c, slope_c_per_h = _steadiness(monitor.last(step.role, step.until_stable.hold_s), step.until_stable)
        if spread_c <= step.until_stable.band_c and abs(slope_c_per_h) <= step.until_stable.slope_c_per_h:
            break
        waited_s = loop.time() - began_s
        if step.give_up_after_s is not None and waited_s >= step.give_up_after_s:
            raise StepError(
                f"{step.role} is not stable after {waited_s / 3600:.1f} h: over the last "
                f"{step.until_stable.hold_s / 60:g} min it spread over {spread_c:.2f} °C with a slope of "
                f"{slope_c_per_h:.2f} °C/h, allowed are {step.until_stable.band_c:g} °C and "
                f"{step.until_stable.slope_c_per_h:g} °C/h. Check the chamber, or widen the band."
            )
        await asyncio.sleep(LOOK_EVERY_S)
    newest = monitor.latest(step.role)
    return {"temperature_c": newest.value if newest else None, "soaked_s": loop.time() - began_s}


def _steadiness(window: np.ndarray[Any, np.dtype[np.float64]], stable: Stable) -> tuple[float, float]:
    """Max - min in °C and the fitted slope in °C/h; infinite while the readings do not cover the hold time."""
    if len(window) < 3 or window[-1, 0] - window[0, 0] < WINDOW_COVERAGE * stable.hold_s:
        return float("inf"), float("inf")
    hours = (window[:, 0] - window[:, 0].mean()) / 3600
    values = window[:, 1]
    return float(np.ptp(values)), float(hours @ (values - values.mean()) / (hours @ hours))
