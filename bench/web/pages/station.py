"""Station: the benches, and what runs."""

from __future__ import annotations

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse

from bench.web.access import Reader
from bench.web.pages.render import page

router = APIRouter(include_in_schema=False)


@router.get("/")
async def station_page(request: Request, _: Reader) -> HTMLResponse:
    """Return the page of the station."""
    return page(request, "station.html.j2", place="/")
