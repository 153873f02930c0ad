"""A station without a process: its daemon and application in one event loop."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, NamedTuple

import httpx

from bench.station.alerts.settings import AlertsEntry, read_alerts
from bench.station.daemon import Daemon
from bench.station.settings import Settings, read_station
from bench.station.storage.audit import Audit
from bench.station.storage.database import Database
from bench.station.worker import Workers
from bench.web.access import ROLES, Person
from bench.web.app import make_app
from bench.web.identity import Identity
from bench.web.services import Services


class Inside(NamedTuple):
    """Daemon, whose parts do not work by themselves, and a client of its API for each role."""

    daemon: Daemon
    clients: dict[str, httpx.AsyncClient]


def settings_of(folder: Path, alerts: dict[str, Any] | None = None, **addresses: str) -> Settings:
    """Settings of a station with the simulated bench, and with routes to these addresses, if any."""
    settings = read_station(None, folder / "station", runs=folder / "runs")
    if not addresses:
        return settings
    file = folder / "addresses.yaml"
    file.write_text("".join(f"{name}: '{url}'\n" for name, url in addresses.items()))
    file.chmod(0o600)
    content = {"addresses": file.name, "digest": None, "routes": {name: {} for name in addresses}, **(alerts or {})}
    return settings._replace(alerts=read_alerts(AlertsEntry.model_validate(content), folder, settings.benches))


@asynccontextmanager
async def inside(settings: Settings, log: Any = None) -> AsyncIterator[Inside]:
    """Yield a station without a process until the block ends."""
    database, workers = Database(settings.folder), Workers()
    try:
        daemon = Daemon(settings, database, workers, launch=lambda _: None)
        identity = Identity(database)
        app = make_app(Services(daemon, identity, Audit(database)), log=log)
        clients = {}
        for role, scopes in ROLES.items():
            token = identity.new_token(Person("anna", scopes, "token", is_user=False), role, scopes, 1)
            clients[role] = httpx.AsyncClient(
                transport=httpx.ASGITransport(app), base_url="http://127.0.0.1",
                headers={"authorization": f"Bearer {token}"},
            )  # fmt: skip
        yield Inside(daemon, clients)
        for client in clients.values():
            await client.aclose()
    finally:
        workers.close()
        database.close()
