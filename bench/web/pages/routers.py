"""Routers of all pages."""

from __future__ import annotations

from bench.web.pages import alerts, commands, entrance, files, queue, runs, start, station, units

ROUTERS = (
    files.router, entrance.router, station.router, commands.router, start.router, queue.router, runs.router,
    units.router, alerts.router,
)  # fmt: skip
