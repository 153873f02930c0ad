"""Instruments: a card for each, who holds it, and when its calibration is due."""

from __future__ import annotations

import asyncio
from datetime import datetime
from typing import Annotated, Any

from fastapi import APIRouter, Form, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response

from bench.clock import wall_utc
from bench.figures.languages import tr
from bench.figures.times_and_sizes import duration
from bench.station.instruments.calibrations import CalibrationView, all_calibrations, days_ahead
from bench.station.instruments.view import Guarding
from bench.web.access import Clearer, Reader
from bench.web.api import runs
from bench.web.api.instruments import instruments_of
from bench.web.pages.controls import limit_in_words, limit_name
from bench.web.pages.readings import label
from bench.web.pages.render import page
from bench.web.services import Station
from bench.web.shown import clock_time, reading

router = APIRouter(include_in_schema=False)
PLACE = "/instruments"
Text = Annotated[str, Form(min_length=1, max_length=200)]
GUARDING = {
    Guarding.NOT_NEEDED: "not needed: nothing real moves or is energised",
    Guarding.NONE: "none: no run is in progress",
    Guarding.GUARDS: "guards the run in progress",
    Guarding.RESCUES: "makes the bench safe now",
    Guarding.FOLLOWS: "follows the chambers after a run",
}


@router.get(PLACE)
async def instruments_page(request: Request, station: Station, _: Reader) -> HTMLResponse:
    """Return the instruments of all benches."""
    benches = [await instruments_of(station, name) for name in station.daemon.settings.benches]
    due = await asyncio.to_thread(all_calibrations, station.daemon, wall_utc())
    soon = [each for each in due if each.state != "later"]
    return page(request, "instruments.html.j2", place=PLACE, benches=benches, soon=soon, **_words(station))


@router.get("/instruments/calibrations")
async def calibrations_page(request: Request, station: Station, _: Reader) -> HTMLResponse:
    """Return the calibrations of all instruments, the next one due first."""
    due = await asyncio.to_thread(all_calibrations, station.daemon, wall_utc())
    return page(
        request, "calibrations.html.j2", place=PLACE, due=due, days=days_ahead(station.daemon), **_words(station)
    )


@router.post("/instruments/acknowledge")
async def acknowledge(station: Station, person: Clearer, run: Text, reason: Text) -> Response:
    """Acknowledge a latched run, after somebody has looked at its bench."""
    await runs.acknowledge(station, person, run, runs.Acknowledgement(reason=reason))
    return RedirectResponse(PLACE, 303)


def left(each: CalibrationView) -> str:
    """Return when a calibration is due, in words."""
    if each.left_days < 0:
        return tr("past due for {days} d", days=-each.left_days)
    return tr("due today") if each.left_days == 0 else tr("{days} d left", days=each.left_days)


def _words(station: Station) -> dict[str, Any]:
    zone, now = station.daemon.settings.zone, wall_utc()

    def when(instant: datetime | str | None) -> str:
        try:
            at = datetime.fromisoformat(instant) if isinstance(instant, str) else instant
        except ValueError:
            at = None
        return clock_time(at, zone, now)

    return {
        "when": when, "left": left, "guarding": GUARDING, "limit": limit_in_words, "limit_name": limit_name,
        "label": label, "duration": duration,
        "reading": lambda each: reading(each.model_dump()),
    }  # fmt: skip
