"""Page of alerts: open and earlier ones with their deliveries and acknowledgements, and a test of each route."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from datetime import datetime, timedelta
from typing import Annotated, NamedTuple
from urllib.parse import quote

from fastapi import APIRouter, Form, Query, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response

from bench.clock import wall_utc
from bench.figures.languages import language, tr
from bench.station.alerts.alerts import Alerts
from bench.station.alerts.kinds import URGENT, Kind
from bench.station.alerts.table import Alert, Delivery
from bench.web.access import Engineer, Operator, Reader
from bench.web.api import alerts as api
from bench.web.open_alerts import in_words, opened
from bench.web.pages.render import language_of, page, rendered
from bench.web.services import Services, Station
from bench.web.shown import clock_time

router = APIRouter(include_in_schema=False)
NEWEST = 50
KINDS = {
    Kind.QUESTION: "Question", Kind.ALARM: "Alarm", Kind.SAFE_STOP: "Run ended early", Kind.END: "Run ended",
    Kind.DEVICE_LOST: "Device lost", Kind.DISK_LOW: "Disk nearly full", Kind.ITEM_REFUSED: "Item of the queue",
    Kind.BENCH_STOPPED: "Bench stopped", Kind.CALIBRATION_DUE: "Calibration due", Kind.DIGEST: "Digest",
}  # fmt: skip
STATES = {
    "waiting": "waits", "sending": "is being sent", "sent": "sent", "failed": "given up",
    "dropped": "not sent: acknowledged before",
}  # fmt: skip


class Way(NamedTuple):
    """Delivery of an alert by a route, in words; `problem` is why it was not sent the last time."""

    route: str
    text: str
    problem: str


class Shown(NamedTuple):
    """Alert as it is shown; `next_` is the route to which it goes unless somebody acknowledges it, and when."""

    id: str
    kind: str
    what: str
    do: str
    link: str
    at: datetime
    is_open: bool
    acknowledged: str
    ways: list[Way]
    next_: str


class RouteShown(NamedTuple):
    """Route as it is shown."""

    name: str
    kinds: list[str]
    next: str
    language: str
    tried: datetime | None
    problem: str


@router.get("/alerts")
async def alerts_page(request: Request, station: Station, _: Reader) -> HTMLResponse:
    """Return the page of alerts."""
    return await _page(request, station)


@router.get("/alerts/open")
async def open_alerts(
    request: Request, station: Station, _: Reader, seen: Annotated[str, Query(max_length=64)] = ""
) -> Response:
    """Return the line of open alerts that is on every page; no content while it is the one that the page has."""
    with language(language_of(request)):
        line = opened(station.alerts)
        if line.mark == seen:
            return Response(status_code=204)
        return HTMLResponse(rendered("part_open_alerts.html.j2", open_alerts=line))


@router.post("/alerts/test")
async def send_test(
    request: Request, station: Station, person: Engineer, route: Annotated[str, Form(max_length=64)] = ""
) -> HTMLResponse:
    """Send a test by a route or by all, and show whether it was sent."""
    tested = await api.test(station, person, api.Test(route=route or None))
    return await _page(request, station, tested)


@router.post("/alerts/{id_}/acknowledge")
async def acknowledge(station: Station, person: Operator, id_: str) -> Response:
    """Acknowledge an alert."""
    await api.acknowledge(station, person, id_)
    return RedirectResponse("/alerts", 303)


async def _page(request: Request, station: Services, tested: list[api.TestedView] | None = None) -> HTMLResponse:
    alerts = station.daemon.alerts
    if alerts is None:
        return page(request, "alerts.html.j2", place="/alerts", alerts=None)
    tried = await asyncio.to_thread(alerts.tried)
    with language(language_of(request)):
        zone, now = station.daemon.settings.zone, wall_utc()
        unacknowledged = [_shown(alerts, each, zone, now) for each in alerts.table.unacknowledged(NEWEST)]
        newest = [_shown(alerts, each, zone, now) for each in alerts.table.newest(NEWEST)]
        routes = [
            RouteShown(
                name, [tr(KINDS[kind]) for kind in each.route.entry.events], each.route.entry.next or "",
                each.route.entry.language, tried[name], each.failure,
            )
            for name, each in alerts.sending.items()
        ]  # fmt: skip
    minutes = alerts.settings.entry.escalate_after / 60
    return page(
        request, "alerts.html.j2", place="/alerts", alerts=alerts, open=unacknowledged, minutes=f"{minutes:g}",
        past=[each for each in newest if not each.is_open], routes=routes, tested=tested or [], every=len(Kind),
        when=lambda at: clock_time(at, zone, now),
    )  # fmt: skip


def _shown(alerts: Alerts, alert: Alert, zone: str, now: datetime) -> Shown:
    cause, deliveries = alert.cause, alerts.table.deliveries(alert.id)
    what, do = in_words(alerts, alert)
    is_open = alert.acknowledged is None and cause.kind in URGENT
    by = "" if alert.acknowledged is None else clock_time(alert.acknowledged, zone, now)
    who = tr("an answer to the question") if alert.by == "answer" else alert.by
    return Shown(
        alert.id, tr(KINDS[cause.kind]), what, do, f"/{quote(cause.link)}" if cause.link else "", alert.at, is_open,
        tr("acknowledged by {name} at {time}", name=who, time=by) if by else "",
        [_way(each) for each in deliveries], tr("; ").join(_next(alerts, deliveries, zone, now)) if is_open else "",
    )  # fmt: skip


def _way(delivery: Delivery) -> Way:
    text = tr(STATES[delivery.state])
    if delivery.state == "waiting" and delivery.tries:
        text = tr("failed attempts: {count}, is tried again", count=delivery.tries)
    if delivery.after:
        text = tr("{state}, since nobody acknowledged it on {route}", state=text, route=delivery.after)
    return Way(delivery.route, text, delivery.problem if delivery.state in ("waiting", "failed") else "")


def _next(alerts: Alerts, deliveries: list[Delivery], zone: str, now: datetime) -> Iterator[str]:
    """Yield the routes to which an alert goes unless somebody acknowledges it."""
    known = {each.route for each in deliveries}
    for each in deliveries:
        route = alerts.settings.routes.get(each.route)
        if route is not None and route.entry.next is not None and route.entry.next not in known:
            at = each.since + timedelta(seconds=alerts.settings.entry.escalate_after)
            yield tr("goes to {route} at {time}", route=route.entry.next, time=clock_time(max(at, now), zone, now))
