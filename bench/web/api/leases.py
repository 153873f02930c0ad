"""Leases: who works at a bench. Others cannot command its runs meanwhile, except that everybody may make safe."""

from __future__ import annotations

from fastapi import APIRouter, status
from pydantic import BaseModel

from bench.station.queue.items import Line
from bench.station.view import LeaseView
from bench.web.access import Engineer, Operator
from bench.web.services import Station

router = APIRouter(prefix="/api/v1/benches/{bench}/lease", tags=["leases"])


class Wanted(BaseModel):
    """Lease that is asked for; the note is for others."""

    note: Line = ""


@router.put("")
async def take(station: Station, person: Operator, bench: str, wanted: Wanted) -> LeaseView:
    """Take the lease of a bench for a minute, or renew it."""
    station.daemon.settings.bench_file(bench)
    before = station.daemon.leases.of(bench)
    station.daemon.leases.expect(bench, person.name)
    if before is None:  # renewals are no news
        station.audit.note(person, "take lease", bench, note=wanted.note)
    return LeaseView.of(station.daemon.leases.take(bench, person.name, wanted.note))


@router.post("/take-over")
async def take_over(station: Station, person: Engineer, bench: str, wanted: Wanted) -> LeaseView:
    """Take the lease of a bench from its holder."""
    station.daemon.settings.bench_file(bench)
    before = station.daemon.leases.of(bench)
    holder = before.holder if before is not None else ""
    station.audit.note(person, "take over lease", bench, before=holder, after=person.name, reason=wanted.note)
    return LeaseView.of(station.daemon.leases.take_over(bench, person.name, wanted.note))


@router.delete("", status_code=status.HTTP_204_NO_CONTENT)
async def give_back(station: Station, person: Operator, bench: str) -> None:
    """Give the lease of a bench back."""
    station.daemon.settings.bench_file(bench)
    station.daemon.leases.expect(bench, person.name)
    station.audit.note(person, "give lease back", bench)
    station.daemon.leases.give_back(bench, person.name)
