"""Pages of all benches: the board, the wall screen, one bench, a unit in the archive; and the stream of the board."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import Annotated

from fastapi import APIRouter, HTTPException, Query, Request
from fastapi.responses import HTMLResponse, StreamingResponse

from bench.clock import wall_utc
from bench.errors import BenchError, error_message
from bench.figures.languages import language
from bench.overview.board import Boards, Viewer, url_for
from bench.overview.history import PastRun
from bench.overview.site import All, AllBenches
from bench.overview.words import Words as OfCard
from bench.overview.words import outcome
from bench.web.access import Reader
from bench.web.guards import is_this_computer
from bench.web.pages.render import language_of, page
from bench.web.pages.results_shown import day
from bench.web.pages.runs import Words

router = APIRouter(include_in_schema=False)
LOOK_EVERY_S = 1.0
ALIVE_EVERY_S = 3.0
Name = Annotated[str, Query(max_length=200)]


@router.get("/")
async def board_page(request: Request, site: All, _: Reader, station: Name = "", gone: Name = "") -> HTMLResponse:
    """Return the board of all benches, or of those of a station."""
    viewer = _viewer(request, site, station, gone)
    return page(
        request, "overview/board.html.j2", place="/", parts=site.boards.parts(viewer), viewer=viewer,
        stations=site.boards.stations(),
    )  # fmt: skip


@router.get("/wall")
async def wall_page(request: Request, site: All, _: Reader, station: Name = "", gone: Name = "hide") -> HTMLResponse:
    """Return the board for a screen on the wall."""
    viewer = _viewer(request, site, station, gone)
    return page(request, "overview/wall.html.j2", place="/wall", parts=site.boards.parts(viewer), viewer=viewer)


@router.get("/live")
async def live(
    request: Request, site: All, _: Reader, station: Name = "", gone: Name = "", bench: Name = ""
) -> StreamingResponse:
    """Stream the parts of a board that change, as server-sent events."""
    viewer = _viewer(request, site, station, gone, bench)
    return StreamingResponse(_stream(site.boards, viewer), media_type="text/event-stream")


@router.get("/bench/{key}")
async def bench_page(request: Request, site: All, _: Reader, key: str) -> HTMLResponse:
    """Return the page of one bench: its state, its alarms and results, and its runs in the archive."""
    card = site.boards.card(key)
    if card is None:
        raise HTTPException(404, "no bench of this name is known any more; see all benches")
    viewer, runs, problem = _viewer(request, site, bench=key), list[PastRun](), ""
    if site.history is not None:
        try:
            runs = await site.history.runs_of(card.recorded, card.computer)
        except BenchError as error:
            problem = error_message(error)
    with language(viewer.language):
        parts = site.boards.parts(viewer)
        return page(
            request, "overview/bench.html.j2", place="/", card=card, parts=parts, viewer=viewer,
            words=OfCard(card, wall_utc(), site.zone), url=url_for(card, viewer), runs=runs, problem=problem,
            has_archive=site.history is not None, outcome=outcome,
        )  # fmt: skip


@router.get("/unit")
async def unit_page(
    request: Request, site: All, _: Reader, serial: Annotated[str, Query(max_length=64)] = ""
) -> HTMLResponse:
    """Return the calibrations of a unit over all benches, by the archive."""
    if site.history is None:
        raise HTTPException(404, "there is no archive; start with --archive DEST")
    found, problem = None, ""
    if serial:
        try:
            found = await site.history.unit(serial)
        except BenchError as error:
            problem = error_message(error)
    return page(
        request, "overview/unit.html.j2", place="/unit", serial=serial, unit=found, problem=problem, day=day,
        **Words,
    )  # fmt: skip


def _viewer(request: Request, site: AllBenches, station: str = "", gone: str = "", bench: str = "") -> Viewer:
    """Return what a viewer sees; a station that is not known is none."""
    known = station if station in dict(site.boards.stations()) else ""
    is_here = is_this_computer(request.scope)
    return Viewer(language_of(request), known, gone == "hide", is_here, bench if site.boards.card(bench) else "")


async def _stream(boards: Boards, viewer: Viewer) -> AsyncIterator[str]:
    """Yield each part when it has changed; the whole board when cards come, go or move."""
    order: tuple[object, ...] | None = None
    sent: dict[str, str] = {}
    silent_s = 0.0
    while True:
        parts = boards.parts(viewer)
        changed = {}
        if parts.order != order:
            order, sent = parts.order, {"status": sent.get("status", ""), **parts.cards}
            changed["board"] = parts.board
        now = {"status": parts.status, **parts.cards}
        changed |= {name: html for name, html in now.items() if sent.get(name) != html}
        sent = now
        if changed or silent_s >= ALIVE_EVERY_S:
            silent_s = 0.0
            yield "".join(f"event: {name}\n{_data(html)}\n\n" for name, html in (changed or {"alive": ""}).items())
        await asyncio.sleep(LOOK_EVERY_S)
        silent_s += LOOK_EVERY_S


def _data(html: str) -> str:
    return "\n".join(f"data: {line}" for line in html.splitlines() or [""])
