"""Runs: list, state, events, and commands to runs in progress."""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Annotated, Literal, TypeVar

from fastapi import APIRouter, Header, Query
from fastapi.responses import StreamingResponse
from pydantic import BaseModel, Field

from bench.errors import InputError, StoreError
from bench.runner.tell import send_command
from bench.station.items import Line, Short
from bench.station.view import EventView, RunInfo, RunView, event_view, run_info, run_view
from bench.store.tail import Tail
from bench.web.access import Operator, Person, Reader, Stopper
from bench.web.services import Reason, Services, Station, plain

T = TypeVar("T")
router = APIRouter(prefix="/api/v1/runs", tags=["runs"])
LOOK_EVERY_S = 0.25
ALIVE_EVERY_S = 15.0
AT_ONCE = 500
_NUMBER = re.compile(r"[0-9]{1,15}")
After = Annotated[int, Query(ge=0, lt=10**15)]
Limit = Annotated[int, Query(ge=1, le=1000)]


class Done(BaseModel):
    """Answer of a run to a command."""

    answer: str


class Answer(BaseModel):
    """Answer to a question of a run."""

    answer: Line
    step: Short | None = Field(None, description="which question; needed if several are open")


@router.get("")
async def runs(
    station: Station, _: Reader, text: str = "", state: str = "", limit: Limit = 100, before: str = ""
) -> list[RunInfo]:
    """Return runs, newest first; `text` is searched in names, titles, units and operators."""

    def found() -> list[RunInfo]:
        chosen: list[RunInfo] = []
        for run in station.daemon.catalogue.all():
            info = run_info(run)
            if (not before or info.run < before) and state in ("", info.state) and _matches(info, text):
                chosen.append(info)
                if len(chosen) >= limit:
                    break
        return chosen

    return await asyncio.to_thread(found)


def _matches(info: RunInfo, text: str) -> bool:
    within = " ".join([info.run, info.title, info.operator, info.verdict or "", *info.units]).lower()
    return all(word in within for word in text.lower().split())


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


async def _command(
    station: Services, person: Person, run: str, command: str, reason: str, **arguments: str
) -> Done:  # fmt: skip
    """Send a command to a run, once it is in the audit; nobody else may work at the bench."""
    found = await _apart(station, lambda: station.daemon.catalogue.run(run))
    if command != "pause":
        station.daemon.leases.expect(station.daemon.bench_in(found.manifest), person.name)
    station.audit.note(person, command, run, reason=plain(reason), **arguments)
    try:
        return Done(answer=await _sent(station, found.path, command, by=person.name, **arguments))
    except InputError as problem:
        station.audit.note_afterwards(person, f"{command} refused", run, after=str(problem))
        raise


async def _make_safe(station: Services, person: Person, run: str, command: str, reason: str) -> Done:
    """Send a command that makes safe. It waits neither for the disk of the station nor for a lease."""
    path = (await _apart(station, lambda: station.daemon.catalogue.run(run))).path
    try:
        answer = await _sent(station, path, command, by=person.name)
    except InputError as problem:
        station.audit.note_afterwards(person, f"{command} refused", run, reason=plain(reason), after=str(problem))
        raise
    problem_ = station.audit.note_afterwards(person, command, run, reason=plain(reason), after=answer)
    return Done(answer=f"{answer}; this is not in the audit yet: {problem_}" if problem_ else answer)


async def _sent(station: Services, path: Path, command: str, **arguments: str) -> str:
    return await _apart(station, lambda: send_command(path, command, **arguments))


async def _apart(station: Services, call: Callable[[], T]) -> T:
    """Return what a function returns, called in a thread that no reader uses."""
    return await asyncio.get_running_loop().run_in_executor(station.daemon.commands, call)


@router.post("/{run}/pause")
async def pause(station: Station, person: Stopper, run: str, reason: Reason = "") -> Done:
    """Pause before the next step."""
    return await _command(station, person, run, "pause", reason)


@router.post("/{run}/stop")
async def stop(
    station: Station, person: Stopper, run: str, when: Literal["now", "after_step"] = "now", reason: Reason = ""
) -> Done:
    """Interrupt the current step, or complete it; then the teardown runs."""
    return await _make_safe(station, person, run, "stop" if when == "now" else "stop_after_step", reason)


@router.post("/{run}/abort")
async def abort(station: Station, person: Stopper, run: str, reason: Reason = "") -> Done:
    """End at once: no teardown, all devices are made safe."""
    return await _make_safe(station, person, run, "abort", reason)


@router.post("/{run}/resume")
async def resume(station: Station, person: Operator, run: str, reason: Reason = "") -> Done:
    """Continue a paused run."""
    return await _command(station, person, run, "resume", reason)


@router.post("/{run}/skip")
async def skip(station: Station, person: Operator, run: str, reason: Reason = "") -> Done:
    """Interrupt the current step and continue with the next one."""
    return await _command(station, person, run, "skip", reason)


@router.post("/{run}/repeat")
async def repeat(station: Station, person: Operator, run: str, reason: Reason = "") -> Done:
    """Restart the current step or, while paused, repeat the previous one."""
    return await _command(station, person, run, "repeat", reason)


@router.post("/{run}/answer")
async def answer(station: Station, person: Operator, run: str, given: Answer) -> Done:
    """Answer a question."""
    return await _command(station, person, run, "answer", "", answer=given.answer, step=given.step or "")
