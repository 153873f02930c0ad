"""Steps that acquire: what counters send and voltmeters read, recorded as it comes under a label."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Mapping
from typing import TYPE_CHECKING, Any

from bench.errors import StepError
from bench.sequence.measuring import Acquire
from bench.sequence.stimulus import TURN_DEG
from bench.store.writer import RunWriter
from drivers.capabilities import PulseCounter, RateTable, Voltmeter
from drivers.frame_block import FrameBlock

if TYPE_CHECKING:  # which calls the functions here
    from bench.engine.actions import Bench

TURN_LOOK_S = 0.02  # how closely the end of the last turn is looked for


async def acquire(step: Acquire, step_id: str, bench: Bench) -> Mapping[str, Any]:
    """Records for the time or the turns asked, or until the steps inside are done: `during`."""
    if step.turns is not None and step.of is not None:
        return await acquire_during(step, step_id, bench, _turned(bench.rig.table(step.of), step.turns))
    return await acquire_during(step, step_id, bench, asyncio.sleep(step.least_s))


async def acquire_during(step: Acquire, step_id: str, bench: Bench, end: Awaitable[None]) -> Mapping[str, Any]:
    """Records all devices of a role at the same time while `end` is awaited; one that fails ends the waiting.

    Of a counter the last block is cut at the end; the reading of a voltmeter that is under way then is the last.
    """
    began_s, over = asyncio.get_running_loop().time(), asyncio.Event()
    try:
        async with asyncio.TaskGroup() as group:
            for role in bench.file.acquired_from(step.role):
                group.create_task(_record(role, step_id, bench, over), name=f"record {role} in {step_id}")
            await end
            over.set()
    except BaseExceptionGroup as problems:
        raise first_of(problems) from problems
    return {"label": step.label, "begin_s": began_s, "end_s": asyncio.get_running_loop().time()}


async def _record(role: str, step_id: str, bench: Bench, over: asyncio.Event) -> None:
    if "voltmeter" in bench.file.devices[role].description.capabilities:
        await _record_voltages(bench.rig.voltmeter(role), step_id, bench.writer, over)
    else:
        await _record_frames(bench.rig.counter(role), step_id, bench.writer, over)


async def _record_voltages(meter: Voltmeter, step_id: str, writer: RunWriter, over: asyncio.Event) -> None:
    """One reading at a time, so that each is kept as soon as it is there."""
    while not over.is_set():
        writer.samples(meter.name, step_id, await meter.measure(1, nplc=None))


async def _record_frames(counter: PulseCounter, step_id: str, writer: RunWriter, over: asyncio.Event) -> None:
    async def keep(blocks: AsyncIterator[FrameBlock]) -> None:
        async for block in blocks:
            writer.frames(counter.name, step_id, block)

    async with counter.acquire() as blocks:
        recording, ending = asyncio.ensure_future(keep(blocks)), asyncio.ensure_future(over.wait())
        try:
            await asyncio.wait([ending, recording], return_when=asyncio.FIRST_COMPLETED)
        finally:
            open_tasks = [task for task in (ending, recording) if not task.done()]
            for task in open_tasks:
                task.cancel()
            if open_tasks:
                await asyncio.wait(open_tasks)
        if not recording.cancelled() and (problem := recording.exception()) is not None:
            raise problem
    await keep(blocks)


async def _turned(table: RateTable, turns: float) -> None:
    """Returns when the table has turned so far; StepError when it does not turn."""
    begin, rate = await table.angle(), await table.rate()
    if rate.value == 0:
        raise StepError("the table whose turns are counted does not turn; put this step into the 'during' of a rotate")
    while True:
        angle = await table.angle()
        left_deg = turns * TURN_DEG - abs(angle.value - begin.value)
        if left_deg <= 0:
            return
        await asyncio.sleep(max(left_deg / abs(rate.value) / 2, TURN_LOOK_S))


def first_of(problems: BaseExceptionGroup[BaseException]) -> BaseException:
    """The first of several errors that came at once."""
    problem = problems.exceptions[0]
    return first_of(problem) if isinstance(problem, BaseExceptionGroup) else problem
