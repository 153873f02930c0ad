"""Routers of all pages."""

from __future__ import annotations

from fastapi.routing import APIRoute

from bench.web.pages import (
    alerts,
    commands,
    editing,
    entrance,
    files,
    instruments,
    manual,
    queue,
    runs,
    sequences,
    start,
    station,
    units,
)  # fmt: skip

ROUTERS = (
    files.router, entrance.router, station.router, commands.router, start.router, queue.router, runs.router,
    units.router, instruments.router, manual.router, sequences.router, editing.router, alerts.router,
)  # fmt: skip
for _route in (each for router in ROUTERS for each in router.routes):
    if isinstance(_route, APIRoute) and _route.methods == {"GET"} and _route.endpoint is not station.live:
        _route.methods = {"GET", "HEAD"}  # as link checkers and proxies ask; the server leaves the body out
