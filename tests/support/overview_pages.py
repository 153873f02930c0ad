"""The pages of all benches in this process, without a server and without a broker."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, closing
from pathlib import Path
from typing import NamedTuple

import httpx

from bench.overview.board import Boards
from bench.overview.broker import BrokerFiles, Subscription, address_of
from bench.overview.history import History
from bench.overview.server import ROUTERS
from bench.overview.site import AllBenches
from bench.station.storage.audit import Audit
from bench.station.storage.database import Database
from bench.web.access import ROLES, Person
from bench.web.app import application, guarded
from bench.web.identity import Identity
from bench.web.patience import Patience
from tests.support.overview import Told

PASSWORD = "a long password"
HTML = {"accept": "text/html"}


class Pages(NamedTuple):
    """Pages, a client of a viewer, one of nobody, and what the stations have told."""

    told: Told
    site: AllBenches
    viewer: httpx.AsyncClient
    nobody: httpx.AsyncClient

    async def get(self, path: str, **headers: str) -> str:
        """Return a page, as a viewer sees it now."""
        self.site.boards._cards = None
        self.site.boards._parts.clear()
        answer = await self.viewer.get(path, headers={**HTML, **headers})
        assert answer.status_code == 200, answer.text
        return answer.text


@asynccontextmanager
async def all_benches(folder: Path, archive: str = "", *, secure: bool = False) -> AsyncIterator[Pages]:
    """Yield the pages of a user `anna`, who is a viewer."""
    told = Told()
    subscription = Subscription(address_of("mqtt://127.0.0.1", BrokerFiles()), told.overview)
    subscription.problem = ""
    history = History(archive) if archive else None
    with closing(Database(folder / "overview")) as database:
        identity = Identity(database, patience=Patience())
        identity.set_user("anna", "viewer", PASSWORD)
        boards = Boards(told.overview, subscription, "Europe/Berlin", lambda: told.now)
        site = AllBenches(
            boards, subscription, identity, Audit(database), "All benches", "Europe/Berlin", history=history
        )
        app = guarded(application("All benches", site, ROUTERS), site, ("bench.lab",), secure=secure)
        token = identity.new_token(Person("anna", ROLES["viewer"], "session"), "test", ROLES["viewer"], 1)
        base, transport = f"http{'s' if secure else ''}://localhost", httpx.ASGITransport(app)
        async with (
            httpx.AsyncClient(
                transport=transport, base_url=base, headers={"authorization": f"Bearer {token}"}
            ) as viewer,
            httpx.AsyncClient(transport=transport, base_url=base) as nobody,
        ):
            try:
                yield Pages(told, site, viewer, nobody)
            finally:
                if history is not None:
                    history.close()
                    history._thread.shutdown()  # so that no thread is left
