"""Station: the benches, and what runs at each; the wall screen; and the stream that keeps both up to date."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import suppress
from functools import lru_cache
from typing import Any, NamedTuple

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, StreamingResponse

from bench.clock import wall_utc
from bench.errors import InputError
from bench.figures.languages import language
from bench.web.access import Person, Reader, Scope
from bench.web.pages.render import language_of, page, rendered
from bench.web.pages.screen import Screen, live_of, screen_of, waiting_at
from bench.web.pages.trends import Trends
from bench.web.services import Services, Station
from bench.web.shown import clock_time

router = APIRouter(include_in_schema=False)
# Parts of the page, each swapped when it changes.
PARTS = (
    "headline", "timeline", "sentence", "details", "alarms", "readings", "guard", "safe", "news", "questions",
    "actions", "after_step", "stop_now", "abort_does", "panels",
)  # fmt: skip
LOOK_EVERY_S = 0.25  # twice in each look of the station at its runs
ALIVE_EVERY_S = 3.0
LEAVE_S = 10.0


class Shown(NamedTuple):
    """What differs between viewers: language, and the buttons that they see."""

    language: str
    may_stop: bool
    may_run: bool

    @property
    def allowed(self) -> dict[str, bool]:
        """Return what the viewer may do, for templates."""
        return {"may_stop": self.may_stop, "may_run": self.may_run}


@lru_cache(maxsize=1)
def trends() -> Trends:
    """Trends that all viewers share."""
    return Trends()


@router.get("/")
async def station_page(request: Request, station: Station, person: Reader) -> HTMLResponse:
    """Return the page of the station: that of its bench, or a choice of several."""
    benches = list(station.daemon.settings.benches)
    if len(benches) == 1 and not _others(station):
        return await _bench_page(request, station, person, benches[0])
    screens = [
        (name, title, await _screen(station, name), waiting_at(station, name)) for name, title in _titles(station)
    ]
    return page(request, "benches.html.j2", place="/", screens=screens, others=_others(station), when=_when(station))


@router.get("/benches/{bench}")
async def bench_page(request: Request, station: Station, person: Reader, bench: str) -> HTMLResponse:
    """Return the page of a bench."""
    return await _bench_page(request, station, person, bench)


@router.get("/wall")
@router.get("/wall/{bench}")
async def wall_page(request: Request, station: Station, _: Reader, bench: str = "") -> HTMLResponse:
    """Return the screen for a wall: state, sentence, end and temperature, readable at three metres."""
    name = bench or next(iter(station.daemon.settings.benches))
    with language(language_of(request)):
        screen = await _screen(station, name)
    return page(request, "wall.html.j2", screen=screen, bench=name, bench_title=station.daemon.settings.titles[name])


@router.get("/benches/{bench}/live")
async def live(request: Request, station: Station, person: Reader, bench: str, run: str = "") -> StreamingResponse:
    """Stream the parts of the page of a bench that change, as server-sent events; the page shows `run`."""
    live_of(station, bench)
    shown = Shown(language_of(request), **_allowed(person))
    return StreamingResponse(_stream(station, bench, run, shown), media_type="text/event-stream")


async def _bench_page(request: Request, station: Services, person: Person, bench: str) -> HTMLResponse:
    with language(language_of(request)):
        screen = await _screen(station, bench)
    daemon, title = station.daemon, station.daemon.settings.titles[bench]
    if screen is not None:
        return page(
            request, "station.html.j2", place="/", bench=bench, bench_title=title, screen=screen, **_allowed(person)
        )  # fmt: skip
    last = await asyncio.to_thread(lambda: next(iter(daemon.catalogue.all()), None))
    return page(
        request, "idle.html.j2", place="/", bench=bench, bench_title=title, waiting=waiting_at(station, bench),
        stopped=daemon.queue.stopped(bench), when=_when(station), last=last,
    )  # fmt: skip


async def _screen(station: Services, bench: str) -> Screen | None:
    found = live_of(station, bench)
    if found is None:
        return None
    return screen_of(found, bench, _zone(station, bench), await trends().of(found))


async def _stream(station: Services, bench: str, run: str, shown: Shown) -> AsyncIterator[str]:
    """Yield each part of the page when it has changed; a change that a slow reader has missed is not sent later."""
    sent: dict[str, str] = {}
    silent_s = 0.0
    while _run_of(station, bench) == run:
        changed = {name: html for name, html in (await _parts(station, bench, shown)).items() if sent.get(name) != html}
        sent |= changed
        if changed:
            yield "".join(f"event: {name}\n{_data(html)}\n\n" for name, html in changed.items())
            silent_s = 0.0
        elif silent_s >= ALIVE_EVERY_S:
            yield "event: alive\ndata: \n\n"
            silent_s = 0.0
        await asyncio.sleep(LOOK_EVERY_S)
        silent_s += LOOK_EVERY_S
    yield "event: other-run\ndata: \n\n"  # the page loads itself again; an end of the stream would be an error to it
    await asyncio.sleep(LEAVE_S)


async def _parts(station: Services, bench: str, shown: Shown) -> Mapping[str, str]:
    """Return the parts of the page of a bench; they are rendered once for all viewers who see the same."""
    found = live_of(station, bench)
    if found is None:
        return {}
    status, kept = found.status, _rendered().get((bench, shown))
    if kept is not None and kept[0] is status:
        return kept[1]
    with language(shown.language):
        screen = screen_of(found, bench, _zone(station, bench), await trends().of(found))
        parts = {name: rendered(f"part_{name}.html.j2", screen=screen, **shown.allowed) for name in PARTS}
    _rendered()[bench, shown] = (status, parts)
    return parts


@lru_cache(maxsize=1)
def _rendered() -> dict[tuple[str, Shown], tuple[Mapping[str, Any], Mapping[str, str]]]:
    """Newest parts by bench and viewer, with the status of the run that they show."""
    return {}


def _data(html: str) -> str:
    """Return a part as lines of an event; without a line of data, a browser would drop the event of an empty part."""
    return "\n".join(f"data: {line}" for line in html.splitlines() or [""])


def _run_of(station: Services, bench: str) -> str:
    with suppress(InputError):
        found = live_of(station, bench)
        return found.run.id if found is not None else ""
    return ""


def _allowed(person: Person) -> dict[str, bool]:
    """Return what a person may do; buttons for anything else are not shown."""
    return {"may_stop": Scope.STOP in person.scopes, "may_run": Scope.RUN in person.scopes}


def _titles(station: Services) -> list[tuple[str, str]]:
    return list(station.daemon.settings.titles.items())


def _others(station: Services) -> list[str]:
    daemon = station.daemon
    return [name for name in daemon.live.runs if daemon.bench_of(name) is None]


def _zone(station: Services, bench: str) -> str:
    return station.daemon.settings.zones.get(bench, "UTC")


def _when(station: Services) -> Any:
    """Return the function that templates show instants with."""
    zone, now = station.daemon.settings.zone, wall_utc()
    return lambda instant: clock_time(instant, zone, now)
