"""Manual control of a bench, for engineers: begin a session, give orders, see what becomes of them."""

from __future__ import annotations

import json
import secrets
from collections.abc import Awaitable, Callable, Mapping
from datetime import datetime
from typing import Any, NamedTuple
from zoneinfo import ZoneInfo

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response

from bench.errors import BenchError
from bench.figures.languages import language, tr
from bench.figures.sayings import plain
from bench.figures.times_and_sizes import duration
from bench.sequence.steps.manual import SEQUENCE
from bench.station.queue.items import Item
from bench.station.runs.live import LiveRun
from bench.web.access import Engineer, Stopper
from bench.web.api import manual as api
from bench.web.api.instruments import instruments_of
from bench.web.api.preparing import bench_info, read_fields
from bench.web.api.runs import Done
from bench.web.pages.controls import controls, order_of
from bench.web.pages.readings import label
from bench.web.pages.render import form_of, language_of, page, rendered, with_prefix
from bench.web.pages.screen import live_of
from bench.web.pages.start import UNIT
from bench.web.services import Services, Station
from bench.web.shown import number, reading

router = APIRouter(include_in_schema=False)
PLACE = "/instruments"
ORDERS_SHOWN = 12


class OrderLine(NamedTuple):
    """Order as it is shown: number, what, by whom, when, and what became of it; `state` is done, busy or bad."""

    number: str
    text: str
    by: str
    at: datetime | None
    result: str
    state: str


@router.get("/benches/{bench}/manual")
async def manual_page(
    request: Request, station: Station, _: Engineer, bench: str, run: str = ""
) -> HTMLResponse:  # fmt: skip
    """Return the page of manual control; `run` is the session that a page shows already."""
    live, item = live_of(station, bench), _item(station, bench)
    shown = live if live is not None and live.status.get("manual") else None
    if run and (shown is None or shown.run.id != run):
        return HTMLResponse("", headers={"hx-refresh": "true"})
    with language(language_of(request)):
        return page(
            request, "manual.html.j2", place=PLACE, bench=bench, info=bench_info(station, bench), item=item,
            found=await instruments_of(station, bench), key=secrets.token_hex(16), duration=duration,
            session=shown.status["manual"] if shown is not None else None, run=shown.run.id if shown else "",
            other=live.run.id if live is not None and shown is None else "", controls=controls,
            when=_when(station, bench), orders=_orders(shown) if shown is not None else [], label=label,
            reading=lambda each: reading(each.model_dump()),
            holds=[plain(by) for by in shown.holds] if shown is not None else [],
        )  # fmt: skip


@router.post("/benches/{bench}/manual")
async def begin(request: Request, station: Station, person: Engineer, bench: str) -> Response:
    """Queue a session of manual control."""
    form = await form_of(request)
    wanted = api.Session(units=with_prefix(form, UNIT), order=form.get("order", ""))
    await api.begin(station, person, bench, wanted, form.get("key", "")[:100])
    return RedirectResponse(f"/benches/{bench}/manual", 303)


@router.post("/manual/{run}/order")
async def order(request: Request, station: Station, person: Engineer, run: str) -> Response:
    """Begin an order."""
    fields = {"order": order_of(await form_of(request))}
    return await _answered(
        request, station, run, lambda: api.order(station, person, run, read_fields(api.Ordered, fields))
    )


@router.post("/manual/{run}/halt")
async def halt(request: Request, station: Station, person: Stopper, run: str) -> Response:
    """Interrupt the order under way to a device."""
    fields = {"device": (await form_of(request)).get("device", "")}
    return await _answered(request, station, run, lambda: api.halt(station, person, run, read_fields(api.Halt, fields)))


@router.post("/manual/{run}/finish")
async def finish(request: Request, station: Station, person: Engineer, run: str) -> Response:
    """End the session."""
    return await _answered(request, station, run, lambda: api.finish(station, person, run))


@router.post("/manual/{run}/alive")
async def alive(request: Request, station: Station, person: Engineer, run: str) -> HTMLResponse:
    """Give a sign of life of the page that controls; return what it shows of it."""
    problem = ""
    try:
        await api.alive(station, person, run)
    except BenchError as refused:
        problem = str(refused)
    with language(language_of(request)):
        return HTMLResponse(rendered("part_alive.html.j2", problem=problem, person=person))


async def _answered(request: Request, station: Services, run: str, act: Callable[[], Awaitable[Done]]) -> Response:
    """Do something; a script gets the answer, a form goes back to the page of manual control."""
    is_problem = False
    try:
        text = (await act()).answer
    except BenchError as problem:
        if "hx-request" not in request.headers:
            raise
        text, is_problem = str(problem).removeprefix(f"{run}: "), True
    if "hx-request" not in request.headers:
        bench = station.daemon.bench_in(station.daemon.catalogue.run(run).manifest)
        return RedirectResponse(f"/benches/{bench}/manual" if bench is not None else "/", 303)
    with language(language_of(request)):
        said = tr("Order {number} begins", number=text.rpartition("=")[2]) if text.startswith("steps/order=") else text
        return HTMLResponse(rendered("part_answer.html.j2", text=said, is_problem=is_problem))


def _when(station: Services, bench: str) -> Any:
    zone = ZoneInfo(station.daemon.settings.zones.get(bench, "UTC"))
    return lambda instant: f"{instant.astimezone(zone):%H:%M:%S}" if instant is not None else ""


def _item(station: Services, bench: str) -> Item | None:
    """Return the item of a session of manual control that waits or runs at a bench."""
    queue = station.daemon.queue
    items = (*queue.occupying(), *queue.waiting())
    return next(
        (each for each in items if (each.submission.bench, each.submission.sequence) == (bench, SEQUENCE)), None
    )


def _orders(live: LiveRun) -> list[OrderLine]:
    """Return the newest orders first, with what became of each."""
    results: dict[str, tuple[str, str]] = {}
    lines: list[OrderLine] = []
    for event in list(live.events):
        at = live.instant_of(event)
        if event.kind == "order":
            lines.append(OrderLine(event.step, _text(event.data), str(event.data.get("by", "")), at, "", ""))
        elif event.kind == "order_refused":
            why = plain(str(event.data.get("text", "")))
            lines.append(OrderLine("", _text(event.data), str(event.data.get("by", "")), at, why, "bad"))
        elif event.kind in RESULTS:
            results[event.step] = RESULTS[event.kind](event.data)
    return [_with(line, results) for line in reversed(lines)][:ORDERS_SHOWN]


def _with(line: OrderLine, results: Mapping[str, tuple[str, str]]) -> OrderLine:
    if not line.number:
        return line
    state, result = results.get(line.number, ("busy", tr("waits")))
    return line._replace(number=line.number.rpartition("=")[2], result=result, state=state)


def _text(data: Mapping[str, Any]) -> str:
    """Return an order as words: `move head, to 90 °`; as it was written if it is no JSON."""
    text = str(data.get("order", ""))
    try:
        found = json.loads(text)
    except ValueError:
        return text
    return ", ".join(f"{key} {value}" for key, value in found.items()) if isinstance(found, dict) else text


def _result(data: Mapping[str, Any]) -> tuple[str, str]:
    for key, unit in (("angle_deg", "°"), ("rate_dps", "°/s"), ("set_point_c", "°C")):
        if isinstance(data.get(key), int | float):
            return "done", number(float(data[key]), unit, ".3f")
    if isinstance(data.get("value"), int | float):
        return "done", number(float(data["value"]), str(data.get("unit", "")))
    if "output" in data:
        levels = ((data.get("voltage_v"), "V"), (data.get("current_a"), "A"))
        shown = ", ".join(number(float(value), unit, ".4g") for value, unit in levels if isinstance(value, int | float))
        return "done", f"{tr('on') if data['output'] else tr('off')} {shown}".strip()
    return "done", tr("done")


RESULTS: Mapping[str, Any] = {
    "step_begins": lambda _: ("busy", tr("under way")),
    "step_ended": _result,
    "step_cut": lambda _: ("cut", tr("halted")),
    "step_failed": lambda data: ("bad", plain(str(data.get("text", "")))),
}
