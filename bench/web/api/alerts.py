"""Alerts: what was sent to whom, acknowledgements, and the test of routes."""

from __future__ import annotations

import asyncio
from datetime import datetime
from typing import Annotated

from fastapi import APIRouter, Query
from pydantic import BaseModel, Field

from bench.errors import InputError
from bench.station.alerts.alerts import Alerts
from bench.station.alerts.kinds import Kind
from bench.station.alerts.table import Alert
from bench.station.queue.items import Word
from bench.web.access import Engineer, Operator, Reader
from bench.web.services import Services, Station

router = APIRouter(prefix="/api/v1/alerts", tags=["alerts"])
Limit = Annotated[int, Query(ge=1, le=500)]


class WayView(BaseModel):
    """Way of an alert by a route."""

    route: str
    state: str = Field(description="waiting, sending, sent, failed, or dropped when it was acknowledged before")
    tries: int
    problem: str = Field(description="why it was not sent the last time")


class AlertView(BaseModel):
    """Alert of the station."""

    id: str
    kind: Kind
    at: datetime
    bench: str
    subject: str = Field(description="the run, bench or folder that it is about")
    times: int = Field(description="number of causes in it")
    text: str = Field(description="what happened, what to do, and the link, on three lines")
    historical: bool = Field(description="it happened while the station was down")
    acknowledged: datetime | None
    by: str = Field(description="who has acknowledged it; 'answer' for an answered question")
    ways: list[WayView]


class RouteView(BaseModel):
    """Route of alerts, without its address."""

    name: str
    events: list[Kind]
    next: str | None = Field(description="route to take when nobody acknowledges an urgent alert")
    language: str
    tried: datetime | None = Field(description="when it has worked for the last time")
    problem: str


class Test(BaseModel):
    """Test of a route, or of all."""

    route: Word | None = Field(None, description="null for all routes")


class TestedView(BaseModel):
    """Result of the test of a route."""

    route: str
    sent: bool
    problem: str


def _alerts(station: Services) -> Alerts:
    if station.daemon.alerts is None:
        raise InputError("this station has no alerts; station.yaml needs a block 'alerts' with routes")
    return station.daemon.alerts


def _view(alerts: Alerts, alert: Alert) -> AlertView:
    cause = alert.cause
    return AlertView(
        id=alert.id, kind=cause.kind, at=alert.at, bench=cause.bench, subject=cause.subject, times=alert.times,
        text=alerts.text(alert).body, historical=cause.historical, acknowledged=alert.acknowledged, by=alert.by,
        ways=[
            WayView(route=each.route, state=each.state, tries=each.tries, problem=each.problem)
            for each in alerts.table.deliveries(alert.id)
        ],
    )  # fmt: skip


@router.get("")
async def alerts_(station: Station, _: Reader, limit: Limit = 100) -> list[AlertView]:
    """Return the newest alerts, newest first."""
    alerts = _alerts(station)
    return [_view(alerts, each) for each in alerts.table.newest(limit)]


@router.get("/routes")
async def routes(station: Station, _: Reader) -> list[RouteView]:
    """Return the routes of alerts."""
    alerts = _alerts(station)
    tried = await asyncio.to_thread(alerts.tried)
    return [
        RouteView(
            name=name, events=list(each.route.entry.events), next=each.route.entry.next,
            language=each.route.entry.language, tried=tried[name], problem=each.failure,
        )
        for name, each in alerts.sending.items()
    ]  # fmt: skip


@router.post("/test")
async def test(station: Station, person: Engineer, wanted: Test) -> list[TestedView]:
    """Send a test by a route or all, and answer when it was sent; at the latest after 35 s."""
    alerts = _alerts(station)
    station.audit.note(person, "test alerts", wanted.route or "all routes")
    found = await alerts.test(wanted.route, person.name)
    return [TestedView(route=each.route, sent=not each.problem, problem=each.problem) for each in found]


@router.post("/{id_}/acknowledge")
async def acknowledge(station: Station, person: Operator, id_: str) -> AlertView:
    """Acknowledge an alert: it is not sent any further. A second time changes nothing."""
    alerts = _alerts(station)
    station.audit.note(person, "acknowledge alert", id_)
    return _view(alerts, alerts.acknowledge(id_, person.name))
