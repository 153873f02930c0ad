"""Routers of all pages."""

from __future__ import annotations

from bench.web.pages import commands, entrance, files, station

ROUTERS = (files.router, entrance.router, station.router, commands.router)
