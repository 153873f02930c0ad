"""Routers of all pages."""

from __future__ import annotations

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
