"""Runs: list, state, events, and commands to runs in progress."""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncIterator
from typing import Annotated, Literal

from fastapi import APIRouter, Header, Query
from fastapi.responses import StreamingResponse
from pydantic import BaseModel, Field

from bench.errors import InputError, StoreError
from bench.runner.held import is_followed
from bench.station.queue.items import Line, Short
from bench.station.view import EventView, RunFilter, RunInfo, RunView, event_view, found_runs, run_info, run_view
from bench.store.latch import acknowledge as acknowledged
from bench.store.tail import Tail
from bench.web.access import Clearer, Operator, Reader, Stopper
from bench.web.commanding import command_run, make_safe
from bench.web.services import Reason, Services, Station

router = APIRouter(prefix="/api/v1/runs", tags=["runs"])
LOOK_EVERY_S = 0.25
ALIVE_EVERY_S = 15.0
AT_ONCE = 500
_NUMBER = re.compile(r"[0-9]{1,15}")
After = Annotated[int, Query(ge=0, lt=10**15)]


class RunQuery(RunFilter):
    """Filter of runs, and the greatest number of them."""

    limit: int = Field(100, ge=1, le=1000)


class Done(BaseModel):
    """Answer of a run to a command."""

    answer: str


class Acknowledgement(BaseModel):
    """Findings at the bench, and action taken."""

    reason: Line = Field(min_length=1)


class Answer(BaseModel):
    """Answer to a question of a run."""

    answer: Line
    step: Short | None = Field(None, description="which question; needed if several are open")


@router.get("")
async def runs(station: Station, _: Reader, wanted: Annotated[RunQuery, Query()]) -> list[RunInfo]:
    """Return the runs that match every filter, newest first."""
    return await asyncio.to_thread(lambda: found_runs(station.daemon.catalogue.all(), wanted, wanted.limit))


@router.get("/{run}")
async def run_(station: Station, _: Reader, run: str) -> RunInfo:
    """Return a run."""
    return await asyncio.to_thread(lambda: run_info(station.daemon.catalogue.run(run)))


@router.get("/{run}/live")
async def live(station: Station, _: Reader, run: str) -> RunView:
    """Return the state of a run in progress."""
    found = station.daemon.live.runs.get(run)
    if found is None:
        raise InputError(f"run '{run}' is not in progress")
    return run_view(found)


@router.get("/{run}/events")
async def events(
    station: Station, _: Reader, run: str, after: After = 0, last_event_id: Annotated[str, Header()] = ""
) -> StreamingResponse:
    """Stream the journal of a run as server-sent events, from after an entry; the number of an entry is its id."""
    station.daemon.catalogue.run(run)
    first = int(last_event_id) if _NUMBER.fullmatch(last_event_id) else after
    return StreamingResponse(_stream(station, run, first), media_type="text/event-stream")


async def _stream(station: Services, run: str, after: int) -> AsyncIterator[str]:
    """Yield entries as they appear. A slow reader delays only itself: each look reads from the record."""
    silent_s = 0.0
    while True:
        new = await asyncio.to_thread(_events_of, station, run, after)
        for view in new:
            yield f"id: {view.seq}\nevent: {view.kind}\ndata: {view.model_dump_json()}\n\n"
            after = view.seq
        if new:
            silent_s = 0.0
            continue
        if await asyncio.to_thread(_has_ended, station, run):
            yield "event: end\ndata: {}\n\n"
            return
        await asyncio.sleep(LOOK_EVERY_S)
        silent_s += LOOK_EVERY_S
        if silent_s >= ALIVE_EVERY_S:
            silent_s = 0.0
            yield ": alive\n\n"


def _has_ended(station: Services, run: str) -> bool:
    return run not in station.daemon.live.runs and station.daemon.catalogue.run(run).state != "running"


def _events_of(station: Services, run: str, after: int) -> list[EventView]:
    path = station.daemon.catalogue.run(run).path
    try:
        with Tail(path) as tail:
            found = tail.events(after, AT_ONCE)
            begins = tail.begins()
    except StoreError:
        return []  # it has just begun
    return [event_view(begins, each) for each in found]


@router.post("/{run}/pause")
async def pause(station: Station, person: Stopper, run: str, reason: Reason = "") -> Done:
    """Pause before the next step."""
    return Done(answer=await command_run(station, person, run, "pause", reason))


@router.post("/{run}/stop")
async def stop(
    station: Station, person: Stopper, run: str, when: Literal["now", "after_step"] = "now", reason: Reason = ""
) -> Done:
    """Interrupt the current step, or complete it; then the teardown runs."""
    return Done(answer=await make_safe(station, person, run, "stop" if when == "now" else "stop_after_step", reason))


@router.post("/{run}/abort")
async def abort(station: Station, person: Stopper, run: str, reason: Reason = "") -> Done:
    """End at once: no teardown, all devices are made safe."""
    return Done(answer=await make_safe(station, person, run, "abort", reason))


@router.post("/{run}/resume")
async def resume(station: Station, person: Operator, run: str, reason: Reason = "") -> Done:
    """Continue a paused run."""
    return Done(answer=await command_run(station, person, run, "resume", reason))


@router.post("/{run}/skip")
async def skip(station: Station, person: Operator, run: str, reason: Reason = "") -> Done:
    """Interrupt the current step and continue with the next one."""
    return Done(answer=await command_run(station, person, run, "skip", reason))


@router.post("/{run}/repeat")
async def repeat(station: Station, person: Operator, run: str, reason: Reason = "") -> Done:
    """Restart the current step or, while paused, repeat the previous one."""
    return Done(answer=await command_run(station, person, run, "repeat", reason))


@router.post("/{run}/answer")
async def answer(station: Station, person: Operator, run: str, given: Answer) -> Done:
    """Answer a question."""
    return Done(
        answer=await command_run(station, person, run, "answer", "", answer=given.answer, step=given.step or "")
    )


@router.post("/{run}/acknowledge")
async def acknowledge(station: Station, person: Clearer, run: str, given: Acknowledgement) -> Done:
    """Acknowledge a latched run, after somebody has inspected the bench."""
    path = station.daemon.catalogue.run(run).path
    station.audit.note(person, "acknowledge", run, reason=given.reason)
    try:
        why = await asyncio.to_thread(acknowledged, path, person.name, given.reason, is_followed)
    except InputError as problem:
        station.audit.note_afterwards(person, "acknowledge refused", run, after=str(problem))
        raise
    return Done(answer=f"acknowledged: {why}")
