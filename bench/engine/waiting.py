"""Steps that wait for readings: until a condition holds, or until a unit has reached the temperature of its chamber.

For a group of the thermometers of several units, the step waits for all remaining ones. A unit that has not
arrived when the step gives up is dropped, and the others go on.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from bench.engine.monitor import Monitor
from bench.errors import StepError
from bench.sequence.waits import LOOK_EVERY_S, WINDOW_COVERAGE, Soak, Stable, WaitUntil

Window = np.ndarray[Any, np.dtype[np.float64]]


async def until(step: WaitUntil, monitor: Monitor) -> Mapping[str, Any]:
    """Until every reading of the last `hold_s` fulfils the condition; StepError when that takes too long."""
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    unit = monitor.unit_of(step.reading)
    low = -math.inf if step.above is None else step.above.to(unit)
    high = math.inf if step.below is None else step.below.to(unit)
    while True:
        for name in monitor.units.members(step.reading):
            await monitor.freshen(name)
        windows = {name: monitor.last(name, step.hold_s) for name in monitor.units.members(step.reading)}
        waiting = [name for name, window in windows.items() if not _holds(window, low, high, began_s, step.hold_s)]
        if not waiting:
            values = {name: float(window[-1, 1]) for name, window in windows.items()}
            value = values.get(step.reading, values)
            return {"reading": step.reading, "value": value, "unit": unit, **_waited(began_s)}
        if loop.time() - began_s >= step.give_up_after_s:
            text = "; ".join(f"{name} is {_newest(windows[name], unit)}" for name in waiting)
            text += (
                f" after {step.give_up_after_s / 60:.1f} min, expected {_condition(step)}. "
                "Check what it measures and the sensor, or wait longer."
            )
            if not monitor.drop_those_at(waiting, "not_settled", text):
                raise StepError(text)
            continue
        await asyncio.sleep(LOOK_EVERY_S)


def _holds(window: Window, low: float, high: float, began_s: float, hold_s: float) -> bool:
    """Whether readings since the step began cover the hold time, and all are between the bounds."""
    covered = len(window) > 0 and window[-1, 0] - max(window[0, 0], began_s) >= WINDOW_COVERAGE * hold_s
    return bool(covered and ((low < window[:, 1]) & (window[:, 1] < high)).all())


def _newest(window: Window, unit: str) -> str:
    return f"{window[-1, 1]:.2f} {unit}" if len(window) else "unknown"


def _waited(began_s: float) -> dict[str, float]:
    return {"waited_s": asyncio.get_running_loop().time() - began_s}


def _condition(step: WaitUntil) -> str:
    above = "" if step.above is None else f"above {step.above}"
    below = "" if step.below is None else f"below {step.below}"
    held = f" for {step.hold_s:g} s" if step.hold_s else ""
    return " and ".join(filter(None, (above, below))) + held


async def soak(step: Soak, monitor: Monitor) -> Mapping[str, Any]:
    """Wait for the minimum time, then until the reading is stable; StepError if that takes too long."""
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    await asyncio.sleep(step.at_least_s)
    while step.until_stable is not None:
        stable = step.until_stable
        found = {
            name: _steadiness(monitor.last(name, stable.hold_s), stable) for name in monitor.units.members(step.role)
        }
        restless = {
            name: (spread_c, slope_c_per_h)
            for name, (spread_c, slope_c_per_h) in found.items()
            if spread_c > stable.band_c or abs(slope_c_per_h) > stable.slope_c_per_h
        }
        if not restless:
            break
        waited_s = loop.time() - began_s
        if step.give_up_after_s is not None and waited_s >= step.give_up_after_s:
            text = " ".join(_not_stable(name, *how, waited_s, stable) for name, how in restless.items())
            if not monitor.drop_those_at(restless, "not_settled", text):
                raise StepError(text)
            continue
        await asyncio.sleep(LOOK_EVERY_S)
    newest = {name: monitor.latest(name) for name in monitor.units.members(step.role)}
    values = {name: reading.value if reading else None for name, reading in newest.items()}
    return {"temperature_c": values.get(step.role, values or None), "soaked_s": loop.time() - began_s}


def _not_stable(name: str, spread_c: float, slope_c_per_h: float, waited_s: float, stable: Stable) -> str:
    return (
        f"{name} is not stable after {waited_s / 3600:.1f} h: over the last "
        f"{stable.hold_s / 60:g} min it spread over {spread_c:.2f} °C with a slope of "
        f"{slope_c_per_h:.2f} °C/h, allowed are {stable.band_c:g} °C and "
        f"{stable.slope_c_per_h:g} °C/h. Check the chamber, or widen the band."
    )


def _steadiness(window: Window, stable: Stable) -> tuple[float, float]:
    """Max - min in °C and the fitted slope in °C/h; infinite while the readings do not cover the hold time."""
    if len(window) < 3 or window[-1, 0] - window[0, 0] < WINDOW_COVERAGE * stable.hold_s:
        return float("inf"), float("inf")
    hours = (window[:, 0] - window[:, 0].mean()) / 3600
    values = window[:, 1]
    return float(np.ptp(values)), float(hours @ (values - values.mean()) / (hours @ hours))
