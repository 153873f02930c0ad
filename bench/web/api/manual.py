"""Manual control of a bench: a run that waits for orders. The station passes them on and opens no instrument."""

from __future__ import annotations

import json
from typing import Annotated

from fastapi import APIRouter, status
from pydantic import BaseModel, Field

from bench.sequence.steps.manual import SEQUENCE
from bench.station.queue.items import PRIORITIES, Item, Line, Short, Submission, Word
from bench.web.access import Engineer, Person, Stopper
from bench.web.api import leases, queue
from bench.web.api.queue import Key
from bench.web.api.runs import Done
from bench.web.commanding import command_run, is_alive, make_safe
from bench.web.services import Reason, Services, Station

router = APIRouter(prefix="/api/v1", tags=["manual control"])
NOT_STATED = "NOT-STATED"  # serial number of units that may be there: their limits hold


class Session(BaseModel):
    """Session of manual control; it begins when the bench is free, before other items."""

    units: dict[Word, Short] = Field({}, description="serial numbers by place; if none is given, every place counts")
    silence: Short = Field("", description="it is stopped after this time without a sign of life; default 5 min")
    order: Line = Field("", description="order or reason, for the record")


class Ordered(BaseModel):
    """Order: one step of a sequence, as `{"move": "head", "to": "90 °"}`; its verb comes first."""

    order: Annotated[dict[Word, Short], Field(min_length=1, max_length=12)]


class Halt(BaseModel):
    """Device whose order under way is interrupted."""

    device: Short = Field(min_length=1)


class SessionState(BaseModel):
    """State of a session: time in s until it is stopped without a sign of life, and devices by order under way."""

    silence_s: float
    left_s: float
    busy: dict[str, list[str]]


@router.post("/benches/{bench}/manual", status_code=status.HTTP_201_CREATED)
async def begin(station: Station, person: Engineer, bench: str, wanted: Session, key: Key = "") -> Item:
    """Queue a session of manual control before all other items, and take the lease of the bench."""
    file = station.daemon.scheduler.bench(bench)
    await _lease(station, person, bench)
    units = {place: serial for place, serial in wanted.units.items() if serial}
    if not units and not file.is_simulated:
        units = dict.fromkeys(file.places, NOT_STATED)
    submission = Submission(
        sequence=SEQUENCE, bench=bench, units=units, order=wanted.order, priority=PRIORITIES, past_due="mark",
        settings={"silence": wanted.silence} if wanted.silence else {}, speed="1" if file.is_simulated else None,
    )  # fmt: skip
    return await queue.submit(station, person, submission, key)


@router.post("/runs/{run}/orders")
async def order(station: Station, person: Engineer, run: str, given: Ordered, reason: Reason = "") -> Done:
    """Begin an order; the answer is its id in the journal, where its result will be."""
    text = json.dumps(given.order, ensure_ascii=False)
    return Done(answer=await command_run(station, person, run, "order", reason, order=text))


@router.post("/runs/{run}/orders/halt")
async def halt(station: Station, person: Stopper, run: str, given: Halt, reason: Reason = "") -> Done:
    """Interrupt the order under way to a device, and stop what it has started."""
    return Done(answer=await make_safe(station, person, run, "halt", reason, device=given.device))


@router.post("/runs/{run}/orders/finish")
async def finish(station: Station, person: Engineer, run: str, reason: Reason = "") -> Done:
    """End a session: orders under way are interrupted, and everything is made safe."""
    return Done(answer=await command_run(station, person, run, "finish", reason))


@router.post("/runs/{run}/orders/alive")
async def alive(station: Station, person: Engineer, run: str) -> SessionState:
    """Give a sign of life of the person who controls, and renew the lease of the bench."""
    bench = station.daemon.bench_in(station.daemon.catalogue.run(run).manifest)
    if bench is not None:
        await _lease(station, person, bench)
    return SessionState.model_validate_json(await is_alive(station, person, run))


async def _lease(station: Services, person: Person, bench: str) -> None:
    await leases.take(station, person, bench, leases.Wanted(note="manual control"))
