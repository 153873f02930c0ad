"""The step that waits until what units put out no longer drifts, as after power-on."""

from __future__ import annotations

import asyncio
import math
from collections import deque
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from bench.analysis.counts import mean_rate
from bench.engine.measuring import frames_of
from bench.errors import StepError
from bench.sequence.readings import PULSE_RATE
from bench.sequence.waits import STEADY_PARTS, Steady, WaitUntil
from bench.store.counts import CountDecoder
from drivers.can_counter.description import CounterOptions

if TYPE_CHECKING:  # which calls the function here
    from bench.engine.actions import Bench


async def until_steady(step: WaitUntil, bench: Bench) -> Mapping[str, Any]:
    """Until the pulse rates of all units that are in are steady; StepError when that takes too long.

    With several units, one that keeps the others waiting so long is dropped. What is counted here is not recorded.
    """
    role, _, channel = step.reading.partition(".")
    options, units = bench.file.devices[role].options, bench.monitor.units
    if not isinstance(options, CounterOptions) or step.steady is None:
        raise StepError(f"the pulses of {role} cannot be counted here")
    decoder = CountDecoder(options, options.dbc.parent)
    loop = asyncio.get_running_loop()
    began_s, most_pps = loop.time(), step.steady.change.to(PULSE_RATE)
    rates: dict[str, deque[float]] = {name: deque(maxlen=STEADY_PARTS) for name in options.channels}
    while True:
        block = await frames_of(bench.rig.counter(role), step.steady.over_s / STEADY_PARTS)
        for name, counts in decoder.counts(block).items():
            rates[name].append(mean_rate(counts).net_pps)
        wanted = {place: unit.channel for place, unit in units.left.items() if channel in ("", unit.channel)}
        changes = {place: _change(rates[name]) for place, name in wanted.items()}
        restless = {place: change for place, change in changes.items() if not abs(change) <= most_pps}
        if not restless:
            return {"changes_pps": changes, "waited_s": loop.time() - began_s}
        if loop.time() - began_s >= step.give_up_after_s:
            text = " ".join(_in_words(place, change, step.steady, most_pps) for place, change in restless.items())
            if not bench.monitor.drop_all(restless, "not_settled", text):
                raise StepError(f"{text} Look whether the temperature still changes, or allow more.")


def _change(rates_pps: deque[float]) -> float:
    """By how much the ends of the line fitted to the rates differ; infinite while there are too few."""
    if len(rates_pps) < STEADY_PARTS:
        return math.inf
    parts = np.arange(STEADY_PARTS) - (STEADY_PARTS - 1) / 2
    slope = float(parts @ np.array(rates_pps) / (parts @ parts))
    return slope * STEADY_PARTS


def _in_words(place: str, change_pps: float, steady: Steady, most_pps: float) -> str:
    return (
        f"The pulse rate of the unit in place {place} still changed by {change_pps:.3g} pulse/s over "
        f"{steady.over_s / 60:g} min, allowed are {most_pps:.3g} pulse/s."
    )
