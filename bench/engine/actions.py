"""Each kind of step as one short function."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass
from typing import Any, assert_never

import numpy as np

from bench.engine.monitor import Monitor
from bench.errors import StepError
from bench.rig import Rig
from bench.sequence.plan import PlannedStep
from bench.sequence.steps import Acquire, Move, Note, Ramp, SetOutput, Soak, Stable, Wait, WaitUntil
from bench.store.writer import RunWriter
from drivers.frame_block import FrameBlock

LOOK_EVERY_S = 5.0
WINDOW_COVERAGE = 0.95  # of the hold time must be covered by readings before it is judged


@dataclass(frozen=True)
class Bench:
    """What a step acts with."""

    rig: Rig
    monitor: Monitor
    writer: RunWriter
    notice: Callable[[str], None]


async def perform(planned: PlannedStep, bench: Bench) -> Mapping[str, Any]:
    """Does a step; what it found, for the journal."""
    step = planned.step
    match step:
        case Move():
            return await _move(step, bench)
        case SetOutput():
            return await _set_output(step, bench)
        case Wait():
            await asyncio.sleep(step.duration_s)
            return {}
        case WaitUntil():
            return await _wait_until(step, bench)
        case Note():
            bench.notice(step.text)
            return {"note": step.text}
        case Ramp():
            await bench.rig.chamber(step.role).ramp_to(step.temperature_c, step.rate_c_per_min)
            return {"set_point_c": step.temperature_c}
        case Soak():
            return await _soak(step, bench)
        case Acquire():
            return await _acquire(step, planned.id, bench)
        case _:
            assert_never(step)


async def _move(step: Move, bench: Bench) -> Mapping[str, Any]:
    head = bench.rig.positioner(step.role)
    reading = await head.move_to(step.angle_deg, approach=step.approach, settle_s=step.settle_s)
    return {"angle_deg": reading.value}


async def _set_output(step: SetOutput, bench: Bench) -> Mapping[str, Any]:
    source = bench.rig.source(step.role)
    window = bench.monitor.windows.get(step.role)
    if window is not None:
        window.on_since_s = None
    level = step.voltage_v if step.voltage_v is not None else step.current_a
    limit = step.current_limit_a if step.current_limit_a is not None else step.compliance_v
    await source.set(level or 0.0, limit=limit or 0.0, output=step.output == "on")
    found = await source.read()
    if window is not None and step.output == "on":
        window.on_since_s = asyncio.get_running_loop().time()
    return {"voltage_v": found.voltage_v, "current_a": found.current_a, "output": found.output}


async def _wait_until(step: WaitUntil, bench: Bench) -> Mapping[str, Any]:
    """Until every reading of the last `hold_s` fulfils the condition; StepError when that takes too long."""
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    low_c = -math.inf if step.above_c is None else step.above_c
    high_c = math.inf if step.below_c is None else step.below_c
    while True:
        window = bench.monitor.last(step.role, step.hold_s)
        covered = len(window) > 0 and window[-1, 0] - max(window[0, 0], began_s) >= WINDOW_COVERAGE * step.hold_s
        if covered and ((low_c < window[:, 1]) & (window[:, 1] < high_c)).all():
            return {"temperature_c": float(window[-1, 1]), "waited_s": loop.time() - began_s}
        if loop.time() - began_s >= step.give_up_after_s:
            found = f"{window[-1, 1]:.2f} °C" if len(window) else "unknown"
            raise StepError(
                f"{step.role} is {found} after {step.give_up_after_s / 60:.1f} min, expected {_condition(step)}. "
                "Check the chamber and the sensor, or wait longer."
            )
        await asyncio.sleep(LOOK_EVERY_S)


def _condition(step: WaitUntil) -> str:
    above = "" if step.above_c is None else f"above {step.above_c:g} °C"
    below = "" if step.below_c is None else f"below {step.below_c:g} °C"
    held = f" for {step.hold_s:g} s" if step.hold_s else ""
    return " and ".join(filter(None, (above, below))) + held


async def _soak(step: Soak, bench: Bench) -> Mapping[str, Any]:
    """At least so long, then until the reading is stable; StepError when that takes too long."""
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    await asyncio.sleep(step.at_least_s)
    while step.until_stable is not None:
        spread_c, slope_c_per_h = _steadiness(
            bench.monitor.last(step.role, step.until_stable.hold_s), step.until_stable
        )
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
    newest = bench.monitor.latest(step.role)
    return {"temperature_c": newest.value if newest else None, "soaked_s": loop.time() - began_s}


def _steadiness(window: np.ndarray[Any, np.dtype[np.float64]], stable: Stable) -> tuple[float, float]:
    """Max - min in °C and the fitted slope in °C/h; infinite while the readings do not cover the hold time."""
    if len(window) < 3 or window[-1, 0] - window[0, 0] < WINDOW_COVERAGE * stable.hold_s:
        return float("inf"), float("inf")
    hours = (window[:, 0] - window[:, 0].mean()) / 3600
    values = window[:, 1]
    return float(np.ptp(values)), float(hours @ (values - values.mean()) / (hours @ hours))


async def _acquire(step: Acquire, step_id: str, bench: Bench) -> Mapping[str, Any]:
    """Records frames for the time asked; the last block is cut at its end."""
    counter = bench.rig.counter(step.role)
    began_s = asyncio.get_running_loop().time()
    gate = asyncio.timeout_at(began_s + step.duration_s)
    async with counter.acquire() as blocks:
        try:
            async with gate:
                await _record(blocks, step, step_id, bench.writer)
        except TimeoutError:
            if not gate.expired():  # a silent counter is a TimeoutError too
                raise
    await _record(blocks, step, step_id, bench.writer)
    return {"label": step.label, "begin_s": began_s, "end_s": asyncio.get_running_loop().time()}


async def _record(blocks: AsyncIterator[FrameBlock], step: Acquire, step_id: str, writer: RunWriter) -> None:
    async for block in blocks:
        writer.frames(step.role, step_id, block)
