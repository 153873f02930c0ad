"""What routes use: the daemon, users and the audit of a station."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from fastapi import Depends, Query, Request

from bench.station.daemon import Daemon
from bench.station.storage.audit import Audit
from bench.web.identity import Identity

Reason = Annotated[str, Query(description="why, for the audit")]


def plain(text: str) -> str:
    """Return a reason as a short line; none is refused, since it must not stand in the way of what it explains."""
    return "".join(letter if letter.isprintable() else " " for letter in text[:200]).strip()


class Services(NamedTuple):
    """Parts of a station behind its routes."""

    daemon: Daemon
    identity: Identity
    audit: Audit
    banner: str = ""  # permanent warning on all pages
    report_form: str = "pdf"  # of approved reports


def _services(request: Request) -> Services:
    services: Services = request.app.state.services
    return services


Station = Annotated[Services, Depends(_services)]
