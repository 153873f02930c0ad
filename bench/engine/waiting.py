"""Steps that wait for readings: until a condition holds, or until a unit has reached the temperature of its chamber.

For a group of the thermometers of several units, the step waits for all remaining ones. A unit that has not
arrived when the step gives up is dropped, and the others go on.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from bench.engine.monitor import Monitor
from bench.errors import StepError
from bench.quality import Absent, Fresh, Window
from bench.sequence.steps.waits import LOOK_EVERY_S, WINDOW_COVERAGE, Soak, Stable, WaitUntil


async def until(step: WaitUntil, monitor: Monitor) -> Mapping[str, Any]:
    """Wait until all readings of the last `hold_s` fulfil the condition; StepError if that takes too long."""
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    unit = monitor.unit_of(step.reading)
    low = -math.inf if step.above is None else step.above.to(unit)
    high = math.inf if step.below is None else step.below.to(unit)
    while True:
        for name in monitor.units.members(step.reading):
            await monitor.wait_for_fresh(name)
        windows = {name: monitor.window(name, step.hold_s, began_s) for name in monitor.units.members(step.reading)}
        values: dict[str, Any] = {
            name: value
            for name, window in windows.items()
            if (value := _held(window, low, high, step.hold_s)) is not None
        }
        waiting = [name for name in windows if name not in values]
        if not waiting:
            value = values.get(step.reading, values)
            return {"reading": step.reading, "value": value, "unit": unit, "waited_s": loop.time() - began_s}
        if loop.time() - began_s >= step.give_up_after_s:
            text = "; ".join(f"{name} {_newest(windows[name], unit)}" for name in waiting)
            text += (
                f" after {step.give_up_after_s / 60:.1f} min, expected {_condition(step)}. "
                "Check what it measures and the sensor, or wait longer."
            )
            if not monitor.drop_by_readings(waiting, "not_settled", text):
                raise StepError(text)
            continue
        await asyncio.sleep(LOOK_EVERY_S)


def _held(window: Window | Absent, low: float, high: float, hold_s: float) -> float | None:
    """The newest value, if valid readings cover the hold time and all are between the bounds; otherwise None."""
    if not isinstance(window, Window) or not _covers(window, hold_s):
        return None
    return float(window.values[-1]) if ((low < window.values) & (window.values < high)).all() else None


def _covers(window: Window, hold_s: float) -> bool:
    return bool(window.at_s[-1] - window.at_s[0] >= WINDOW_COVERAGE * hold_s)


def _newest(window: Window | Absent, unit: str) -> str:
    return f"is {window.values[-1]:.2f} {unit}" if isinstance(window, Window) else window.why


def _condition(step: WaitUntil) -> str:
    above = "" if step.above is None else f"above {step.above}"
    below = "" if step.below is None else f"below {step.below}"
    held = f" for {step.hold_s:g} s" if step.hold_s else ""
    return " and ".join(filter(None, (above, below))) + held


async def soak(step: Soak, monitor: Monitor, passed_s: float = 0.0) -> Mapping[str, Any]:
    """Wait for the minimum time, then until the reading is stable; StepError if that takes too long.

    `passed_s` of the minimum time count as passed; stability is judged by readings from now on alone.
    """
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    await asyncio.sleep(max(0.0, step.at_least_s - passed_s))
    while step.until_stable is not None:
        stable = step.until_stable
        windows = {name: monitor.window(name, stable.hold_s, began_s) for name in monitor.units.members(step.role)}
        restless = {
            name: seen
            for name, window in windows.items()
            if not isinstance(seen := _seen(window, stable), _Course) or not seen.is_within(stable)
        }
        if not restless:
            break
        waited_s = loop.time() - began_s
        if step.give_up_after_s is not None and waited_s >= step.give_up_after_s:
            text = " ".join(_not_stable(name, seen, waited_s, stable) for name, seen in restless.items())
            if not monitor.drop_by_readings(restless, "not_settled", text):
                raise StepError(text)
            continue
        await asyncio.sleep(LOOK_EVERY_S)
    newest = {name: monitor.latest(name) for name in monitor.units.members(step.role)}
    values = {name: latest.reading.value if isinstance(latest, Fresh) else None for name, latest in newest.items()}
    return {"temperature_c": values.get(step.role, values or None), "soaked_s": loop.time() - began_s}


class _Course(NamedTuple):
    """Range (max − min, °C) and fitted slope (°C/h) of a temperature."""

    spread_c: float
    slope_c_per_h: float

    def is_within(self, stable: Stable) -> bool:
        """True if both are within the criterion; false if one of them is not a number."""
        return self.spread_c <= stable.band_c and abs(self.slope_c_per_h) <= stable.slope_c_per_h


def _seen(window: Window | Absent, stable: Stable) -> _Course | str:
    """Temperature range and slope over the hold time, or the reason why valid readings of the step do not cover it."""
    if not isinstance(window, Window):
        return window.why
    if len(window.at_s) < 3 or not _covers(window, stable.hold_s):
        return f"has been read for {(window.at_s[-1] - window.at_s[0]) / 60:.3g} min only since the step began"
    hours = (window.at_s - window.at_s.mean()) / 3600
    values = window.values
    return _Course(float(np.ptp(values)), float(hours @ (values - values.mean()) / (hours @ hours)))


def _not_stable(name: str, seen: _Course | str, waited_s: float, stable: Stable) -> str:
    text = f"{name} is not stable after {waited_s / 3600:.1f} h: "
    if isinstance(seen, str):
        return f"{text}it {seen}. Check the sensor, its cable, and the instrument that reads it."
    return (
        f"{text}over the last "
        f"{stable.hold_s / 60:g} min it spread over {seen.spread_c:.2f} °C with a slope of "
        f"{seen.slope_c_per_h:.2f} °C/h, allowed are {stable.band_c:g} °C and "
        f"{stable.slope_c_per_h:g} °C/h. Check the chamber, or widen the band."
    )
