"""Steps that acquire: what counters and units send and voltmeters read, recorded as it comes under a label."""

from __future__ import annotations

import asyncio
from collections import defaultdict
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from contextlib import AbstractAsyncContextManager
from typing import TYPE_CHECKING, Any

import numpy as np

from bench.analysis.acquired import Voltages
from bench.analysis.outputs import STABLE_PART_S, Measured, steadiness
from bench.errors import StepError
from bench.sequence.measuring import Acquire, Stable
from bench.sequence.stimulus import TURN_DEG
from bench.store.codes import CodeDecoder
from bench.store.counts import CountDecoder
from drivers.can_counter.description import CounterOptions
from drivers.can_telemetry.description import TelemetryOptions
from drivers.capabilities import RateTable, Voltmeter
from drivers.frame_block import FrameBlock
from drivers.values import Reading

if TYPE_CHECKING:  # which calls the functions here
    from bench.engine.actions import Bench

WATCHED_BLOCK_S = 1.0  # how fresh frames are whose steadiness is looked at
TURN_LOOK_S = 0.02  # how closely the end of the last turn is looked for


async def acquire(step: Acquire, step_id: str, bench: Bench) -> Mapping[str, Any]:
    """Records for the time or the turns asked, or until the steps inside are done: `during`."""
    if step.turns is not None and step.of is not None:
        course: dict[str, Any] = {"of": step.of}
        found = await acquire_during(step, step_id, bench, _turned(bench.rig.table(step.of), step.turns, course))
        return {**found, "turned": course}
    if step.until_stable is not None and step.give_up_after_s is not None:
        watched = Watched(step.until_stable, bench)
        found = await acquire_during(step, step_id, bench, watched.until_stable(step.give_up_after_s), watched)
        return {**found, "over_s": step.until_stable.over_s, "stable": watched.stable()}
    return await acquire_during(step, step_id, bench, asyncio.sleep(step.least_s))


async def acquire_during(
    step: Acquire, step_id: str, bench: Bench, end: Awaitable[None], watched: Watched | None = None
) -> Mapping[str, Any]:
    """Records all devices of a role at the same time while `end` is awaited; one that fails ends the waiting.

    Of what sends frames the last block is cut at the end; the reading of a voltmeter that is under way then is the
    last.
    """
    began_s, over = asyncio.get_running_loop().time(), asyncio.Event()
    try:
        async with asyncio.TaskGroup() as group:
            for role in bench.file.acquired_from(step.role):
                group.create_task(_record(role, step_id, bench, over, watched), name=f"record {role} in {step_id}")
            await end
            over.set()
    except BaseExceptionGroup as problems:
        raise first_of(problems) from problems
    return {"label": step.label, "begin_s": began_s, "end_s": asyncio.get_running_loop().time()}


async def _record(role: str, step_id: str, bench: Bench, over: asyncio.Event, watched: Watched | None) -> None:
    def keep_frames(block: FrameBlock) -> None:
        bench.writer.frames(role, step_id, block)
        if watched is not None:
            watched.frames[role].append(block)

    def keep_readings(readings: Sequence[Reading]) -> None:
        bench.writer.samples(role, step_id, readings)
        if watched is not None:
            watched.readings[role].extend(readings)

    if "voltmeter" in bench.file.devices[role].description.capabilities:
        await _record_voltages(bench.rig.voltmeter(role), keep_readings, over)
    else:
        source = bench.rig.frame_source(role)
        acquiring = source.acquire() if watched is None else source.acquire(block_s=WATCHED_BLOCK_S)
        await _record_frames(acquiring, keep_frames, over)


async def _record_voltages(
    meter: Voltmeter, keep_readings: Callable[[Sequence[Reading]], None], over: asyncio.Event
) -> None:
    """One reading at a time, so that each is kept as soon as it is there."""
    while not over.is_set():
        keep_readings(await meter.measure(1, nplc=None))


async def _record_frames(
    acquiring: AbstractAsyncContextManager[AsyncIterator[FrameBlock]],
    keep_frames: Callable[[FrameBlock], None],
    over: asyncio.Event,
) -> None:
    async def keep(blocks: AsyncIterator[FrameBlock]) -> None:
        async for block in blocks:
            keep_frames(block)

    async with acquiring as blocks:
        recording, ending = asyncio.ensure_future(keep(blocks)), asyncio.ensure_future(over.wait())
        try:
            await asyncio.wait([ending, recording], return_when=asyncio.FIRST_COMPLETED)
        finally:
            open_tasks = [task for task in (ending, recording) if not task.done()]
            for task in open_tasks:
                task.cancel()
            if open_tasks:
                await asyncio.wait(open_tasks)
            elif not recording.cancelled():
                recording.exception()  # looked at, also where the step was cut at the instant that it failed
        if not recording.cancelled() and (problem := recording.exception()) is not None:
            raise problem
    await keep(blocks)


class Watched:
    """What an acquisition has recorded so far, and which units it shows to be stable."""

    def __init__(self, rule: Stable, bench: Bench) -> None:
        self.frames: defaultdict[str, list[FrameBlock]] = defaultdict(list)
        self.readings: defaultdict[str, list[Reading]] = defaultdict(list)
        self._rule, self._bench = rule, bench
        self._decoders = {
            role: _decoder(options)
            for role, entry in bench.file.devices.items()
            if isinstance(options := entry.options, CounterOptions | TelemetryOptions)
        }

    async def until_stable(self, give_up_after_s: float) -> None:
        """Returns when all units that are in are stable, or when that has taken too long."""
        give_up_s = asyncio.get_running_loop().time() + give_up_after_s
        while asyncio.get_running_loop().time() < give_up_s:
            await asyncio.sleep(STABLE_PART_S)
            if len(self.stable()) == len(self._bench.monitor.units.left):
                return

    def stable(self) -> list[str]:
        """The places of the units that are stable by what was measured last."""
        return [place for place in self._bench.monitor.units.left if self._is_stable(place)]

    def _is_stable(self, place: str) -> bool:
        per_g = self._bench.file.nominal_per_g(place)
        found = self._measured(place)
        steady = steadiness(found, self._rule.over_s) if found is not None else None
        if steady is None or per_g is None:
            return False
        sd, slope = steady
        return sd <= self._rule.sd_g * per_g and abs(slope) <= self._rule.slope_g_per_s * per_g

    def _measured(self, place: str) -> Measured | None:
        entry = self._bench.file.places[place]
        if entry.voltmeter is not None:
            return Voltages(*np.array(self.readings[entry.voltmeter], np.float64).reshape(-1, 2).T)
        for role, decoded in self._decoders.items():
            if blocks := self.frames.get(role):
                recent = FrameBlock.joined(blocks[-_blocks_of(blocks, self._rule.over_s + STABLE_PART_S) :])
                if (found := decoded(recent).get(entry.telemetry or entry.channel)) is not None:
                    return found
        return None


def _decoder(options: CounterOptions | TelemetryOptions) -> Callable[[FrameBlock], Mapping[str, Measured]]:
    """What makes counts, or codes, by their channels, of the frames of a device."""
    if isinstance(options, TelemetryOptions):
        return CodeDecoder(options, options.dbc.parent).codes
    return CountDecoder(options, options.dbc.parent).counts


def _blocks_of(blocks: Sequence[FrameBlock], span_s: float) -> int:
    """How many of the last blocks hold the last `span_s`."""
    begin_s = float(blocks[-1].at_s[-1]) - span_s
    return sum(1 for block in blocks if block.at_s[-1] >= begin_s)


async def _turned(table: RateTable, turns: float, course: dict[str, Any]) -> None:
    """Returns when the table has turned so far; StepError when it does not turn.

    `course` takes when it stood where in the beginning and at the end, bench time and angle.
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


def first_of(problems: BaseExceptionGroup[BaseException]) -> BaseException:
    """The first of several errors that came at once."""
    problem = problems.exceptions[0]
    return first_of(problem) if isinstance(problem, BaseExceptionGroup) else problem
