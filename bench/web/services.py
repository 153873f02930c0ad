"""What routes use: the daemon, users and the audit of a station."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from fastapi import Depends, Request

from bench.station.audit import Audit
from bench.station.daemon import Daemon
from bench.web.identity import Identity


class Services(NamedTuple):
    """Parts of a station behind its routes."""

    daemon: Daemon
    identity: Identity
    audit: Audit
    banner: str = ""  # permanent warning on all pages


def _services(request: Request) -> Services:
    services: Services = request.app.state.services
    return services


Station = Annotated[Services, Depends(_services)]
