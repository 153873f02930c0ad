"""Steps that acquire: data of counters, units and voltmeters, recorded under a label as it arrives."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Mapping, Sequence
from typing import Any, NamedTuple

from bench.engine.context import Bench
from bench.engine.missed import Watch
from bench.engine.outputs import Sink, Watched, acquire_into
from bench.errors import StepError
from bench.metrology.acquisition import Output
from bench.metrology.outputs import STABLE_PART_S, mean_of, steadiness
from bench.quality import Valid
from bench.sequence.steps.measuring import Acquire, StableOutput
from bench.sequence.steps.stimulus import TURN_DEG
from bench.store.writer import RunWriter
from drivers.can.frame_block import FrameBlock
from drivers.capabilities import RateTable

WATCHED_BLOCK_S = 1.0  # block length of frames while their stability is judged
TURN_LOOK_S = 0.02  # resolution in time of the end of the last turn
NOTHING = Output(math.nan, math.nan, ("missing",))


async def acquire(step: Acquire, step_id: str, bench: Bench) -> Mapping[str, Any]:
    """Record for the requested time or turns, or until the steps of `during` are done."""
    if step.turns is not None and step.of is not None:
        course: dict[str, Any] = {"of": step.of}
        found = await acquire_during(step, step_id, bench, _turned(bench.rig.table(step.of), step.turns, course))
        return {**found, "turned": course}
    if step.until_stable is not None and step.give_up_after_s is not None:
        watched = Watched(bench.file, step.until_stable.over_s)
        stability = _Stability(step.until_stable, bench, watched)
        found = await acquire_during(step, step_id, bench, stability.until_stable(step.give_up_after_s), watched)
        return {**found, "over_s": step.until_stable.over_s, "stable": stability.stable()}
    return await acquire_during(step, step_id, bench, asyncio.sleep(step.least_s))


async def acquire_during(
    step: Acquire, step_id: str, bench: Bench, end: Awaitable[None], watched: Watched | None = None
) -> Mapping[str, Any]:
    """Record all devices of a role simultaneously while `end` is awaited, which may use the data in `watched`."""
    began_s = asyncio.get_running_loop().time()
    gaps = Watch(bench, step_id)
    sinks: list[Sink] = [_Recorded(bench.writer, step_id), gaps]
    if watched is not None:
        sinks.append(watched)
    block_s = WATCHED_BLOCK_S if watched is not None else None
    await acquire_into(bench.file.acquired_from(step.role), bench.rig, sinks, end, block_s)
    ended_s = asyncio.get_running_loop().time()
    await gaps.report()
    return {"label": step.label, "begin_s": began_s, "end_s": ended_s}


async def outputs_of(place: str, duration_s: float, step_id: str, bench: Bench) -> Mapping[str, Output]:
    """Mean outputs of the unit in a place over a time; the data they are computed from is stored with the step.

    Those of an inertial unit by its accelerometers, that of any other unit by "".
    """
    watched = Watched(bench.file, math.inf)
    gaps = Watch(bench, step_id)
    sinks: list[Sink] = [_Recorded(bench.writer, step_id), gaps, watched]
    entry = bench.file.places[place]
    await acquire_into(bench.file.measuring(entry), bench.rig, sinks, asyncio.sleep(duration_s), WATCHED_BLOCK_S)
    await gaps.report()
    found = {sensor: watched.measured(place, sensor) for sensor in entry.accelerometers or ("",)}
    return {sensor: mean_of(each) if each is not None else NOTHING for sensor, each in found.items()}


class _Recorded(NamedTuple):
    """A sink that writes to the run store, under a step."""

    writer: RunWriter
    step_id: str

    def frames(self, role: str, block: FrameBlock) -> None:
        self.writer.frames(role, self.step_id, block)

    def readings(self, role: str, readings: Sequence[Valid]) -> None:
        self.writer.samples(role, self.step_id, readings)


class _Stability:
    """Stability of the units, from their newest data."""

    def __init__(self, rule: StableOutput, bench: Bench, watched: Watched) -> None:
        self._rule, self._bench, self._watched = rule, bench, watched

    async def until_stable(self, give_up_after_s: float) -> None:
        """Wait until all remaining units are stable, or the time is over."""
        give_up_s = asyncio.get_running_loop().time() + give_up_after_s
        while asyncio.get_running_loop().time() < give_up_s:
            await asyncio.sleep(STABLE_PART_S)
            if len(self.stable()) == len(self._bench.monitor.units.left):
                return

    def stable(self) -> list[str]:
        """Places of the units that are stable."""
        return [place for place in self._bench.monitor.units.left if self._is_stable(place)]

    def _is_stable(self, place: str) -> bool:
        per_g = self._bench.file.nominal_per_g(place)
        found = self._watched.measured(place)
        steady = steadiness(found, self._rule.over_s) if found is not None else None
        if steady is None or per_g is None:
            return False
        sd, slope = steady
        return sd <= self._rule.sd_g * abs(per_g) and abs(slope) <= self._rule.slope_g_per_s * abs(per_g)


async def _turned(table: RateTable, turns: float, course: dict[str, Any]) -> None:
    """Return when the table has turned by this angle; StepError if it does not turn.

    `course` gets bench time and angle at the beginning and at the end.
    """
    begin, rate = await table.angle(), await table.rate()
    if rate.value == 0:
        raise StepError("the table whose turns are counted does not turn; put this step into the 'during' of a rotate")
    while True:
        angle = await table.angle()
        left_deg = turns * TURN_DEG - abs(angle.value - begin.value)
        if left_deg <= 0:
            course |= {"from_s": begin.at_s, "from_deg": begin.value, "to_s": angle.at_s, "to_deg": angle.value}
            return
        await asyncio.sleep(max(left_deg / abs(rate.value) / 2, TURN_LOOK_S))
