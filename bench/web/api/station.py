"""The station as a whole: its state, once and as a stream."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

from fastapi import APIRouter, Request
from fastapi.responses import StreamingResponse
from pydantic import BaseModel

from bench.clock import Stopwatch, wall_utc
from bench.station.view import StationView, station_view
from bench.web.access import OPEN, Reader
from bench.web.services import Services, Station

router = APIRouter(tags=["station"])
AT_MOST_EVERY_S = 1.0


class Health(BaseModel):
    """Answer of a station that works."""

    status: str = "ok"


@router.get("/health", dependencies=[OPEN])
async def health() -> Health:
    """Return that the station works, and nothing else."""
    return Health()


@router.get("/api/v1/station")
async def station_(station: Station, _: Reader) -> StationView:
    """Return the state of the station."""
    return station_view(station.daemon, wall_utc(), station.banner)


@router.get("/api/v1/live")
async def live(station: Station, _: Reader, request: Request) -> StreamingResponse:
    """Stream the state of the station as server-sent events, at most once a second."""
    state = request.app.state
    if not hasattr(state, "shown"):
        state.shown = _Shown(station)
    return StreamingResponse(_stream(state.shown), media_type="text/event-stream")


class _Shown:
    """State of a station for all viewers, made once a second however many there are."""

    def __init__(self, station: Services) -> None:
        self._station, self._event, self._made = station, "", Stopwatch()

    def message(self) -> str:
        """Return the present state as a server-sent event."""
        if not self._event or self._made.elapsed_s() >= AT_MOST_EVERY_S:
            view = station_view(self._station.daemon, wall_utc(), self._station.banner)
            self._event, self._made = f"event: station\ndata: {view.model_dump_json()}\n\n", Stopwatch()
        return self._event


async def _stream(shown: _Shown) -> AsyncIterator[str]:
    """Yield the present state; one that a slow reader has missed is not sent later."""
    while True:
        yield shown.message()
        await asyncio.sleep(AT_MOST_EVERY_S)
