"""The station as a whole: its state, once and as a stream."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

from fastapi import APIRouter
from fastapi.responses import StreamingResponse
from pydantic import BaseModel

from bench.clock import wall_utc
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
async def live(station: Station, _: Reader) -> StreamingResponse:
    """Stream the state of the station as server-sent events, at most once a second."""
    return StreamingResponse(_stream(station), media_type="text/event-stream")


async def _stream(station: Services) -> AsyncIterator[str]:
    """Yield the present state; one that a slow reader has missed is not sent later."""
    while True:
        yield f"event: station\ndata: {station_view(station.daemon, wall_utc(), station.banner).model_dump_json()}\n\n"
        await asyncio.sleep(AT_MOST_EVERY_S)
