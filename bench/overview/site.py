"""Parts behind the pages of all benches."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple

from fastapi import Depends, Request

from bench.figures.languages import tr
from bench.overview.board import Boards
from bench.overview.broker import Subscription
from bench.overview.history import History
from bench.station.alerts.alerts import Alerts
from bench.station.storage.audit import Audit
from bench.web.identity import Identity
from bench.web.pages.places import Place

PLACES = (Place("/", "Benches"), Place("/wall", "Wall screen"), Place("/unit", "Units"))


class AllBenches(NamedTuple):
    """Site of all benches; `history` is None without an archive."""

    boards: Boards
    subscription: Subscription
    identity: Identity
    audit: Audit
    name: str
    zone: str
    banner: str = ""
    history: History | None = None

    @property
    def title(self) -> str:
        """Name on pages, in the language of the reader unless somebody has given one."""
        return self.name or tr("All benches")

    @property
    def places(self) -> Sequence[Place]:
        """Places that the navigation leads to."""
        return tuple(each for each in PLACES if self.history is not None or each.path != "/unit")

    @property
    def alerts(self) -> Alerts | None:
        """None: alerts are those of stations."""
        return None

    def problems(self) -> list[str]:
        """Return no problems; that of the broker is on the board."""
        return []


def _site(request: Request) -> AllBenches:
    site: AllBenches = request.app.state.services
    return site


All = Annotated[AllBenches, Depends(_site)]
