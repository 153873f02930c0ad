"""Units: serial numbers, and all calibrations of one."""

from __future__ import annotations

import asyncio
from typing import Annotated

from fastapi import APIRouter, Query, Request
from fastapi.responses import HTMLResponse

from bench.figures.languages import tr
from bench.figures.words import source_in_words
from bench.web.access import Reader
from bench.web.api.results import unit, units_of
from bench.web.pages.charts import history_chart
from bench.web.pages.render import page
from bench.web.pages.results_shown import day
from bench.web.pages.runs import Words
from bench.web.services import Station

router = APIRouter(include_in_schema=False)
MOST = 200


@router.get("/units")
async def units_page(
    request: Request, station: Station, _: Reader, text: Annotated[str, Query(max_length=64)] = ""
) -> HTMLResponse:
    """Return the list of serial numbers."""
    found = await asyncio.to_thread(units_of, station, text)
    return page(request, "units.html.j2", place="/units", units=list(found.items())[:MOST], text=text, **Words)


@router.get("/unit")
async def unit_page(
    request: Request, station: Station, person: Reader, serial: Annotated[str, Query(min_length=1, max_length=64)],
    quantity: str = "",
) -> HTMLResponse:  # fmt: skip
    """Return the history of a unit, of one quantity at a time."""
    found = await unit(station, person, serial)
    quantities = list(dict.fromkeys(each.quantity for each in found.series))
    chosen = quantity if quantity in quantities else next(iter(quantities), "")
    shown = [each for each in found.series if each.quantity == chosen]
    return page(
        request, "unit.html.j2", place="/units", unit=found, quantities=quantities, chosen=chosen, series=shown,
        chart=history_chart, sources_in_words=_in_words, day=day, **Words,
    )  # fmt: skip


def _in_words(sources: list[str]) -> str:
    return tr(", ").join(map(source_in_words, sources))
