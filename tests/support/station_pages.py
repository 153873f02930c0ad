"""The application of a station in this process, for requests without a server."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import NamedTuple

import httpx

from bench.station.daemon import at_work
from bench.station.settings import read_station
from bench.station.storage.audit import Audit
from bench.web.access import EVERYTHING, ROLES, Person
from bench.web.app import make_app
from bench.web.identity import Identity
from bench.web.services import Services
from tests.support import worker_processes  # noqa: F401  its tracker is to be there before

HTML = {"accept": "text/html"}


class Asked(NamedTuple):
    """Client of everybody's scopes, the services behind it, and one of a viewer."""

    client: httpx.AsyncClient
    services: Services
    viewer: httpx.AsyncClient


def _launch_nothing(_: Path) -> None:
    """Start no process: items stay in the state `starting`."""


@asynccontextmanager
async def asked(folder: Path, runs: Path, bench: str = "simulated") -> AsyncIterator[Asked]:
    """Yield clients of a station with a bench named demo, whose items never begin."""
    settings = read_station(None, folder / "station", runs=str(runs), benches={"demo": bench})
    async with at_work(settings, _launch_nothing) as daemon:
        identity = Identity(daemon.database)
        services = Services(daemon, identity, Audit(daemon.database))
        transport = httpx.ASGITransport(make_app(services))
        everything, reader = (
            identity.new_token(Person(name, scopes, "token", is_user=False), "test", scopes, 1)
            for name, scopes in (("anna", EVERYTHING), ("victor", ROLES["viewer"]))
        )
        async with (
            httpx.AsyncClient(transport=transport, base_url="http://localhost", headers=_bearer(everything)) as client,
            httpx.AsyncClient(transport=transport, base_url="http://localhost", headers=_bearer(reader)) as viewer,
        ):
            yield Asked(client, services, viewer)


def _bearer(token: str) -> dict[str, str]:
    return {"authorization": f"Bearer {token}"}
