"""What routes use: the daemon, users and the audit of a station."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple, Protocol

from fastapi import Depends, Query, Request

from bench.station.alerts.alerts import Alerts
from bench.station.daemon import Daemon
from bench.station.storage.audit import Audit
from bench.web.identity import Identity
from bench.web.pages.places import PLACES, Place

Reason = Annotated[str, Query(description="why, for the audit")]


def plain(text: str) -> str:
    """Return a reason as a short line; none is refused, since it must not stand in the way of what it explains."""
    return "".join(letter if letter.isprintable() else " " for letter in text[:200]).strip()


class Site(Protocol):
    """What the frame of pages and the log-in need: title, time zone, places, problems, users and their audit.

    `alerts` is None where there are none to be shown.
    """

    @property
    def identity(self) -> Identity:
        """Users, tokens and sessions."""

    @property
    def audit(self) -> Audit:
        """Audit of what they do."""

    @property
    def banner(self) -> str:
        """Permanent warning; empty for none."""

    @property
    def title(self) -> str:
        """Name of the site."""

    @property
    def zone(self) -> str:
        """Time zone of its clock."""

    @property
    def places(self) -> Sequence[Place]:
        """Places that the navigation leads to."""

    @property
    def alerts(self) -> Alerts | None:
        """Alerts to people."""

    def problems(self) -> list[str]:
        """Return present errors of the site itself."""


class Services(NamedTuple):
    """Parts of a station behind its routes."""

    daemon: Daemon
    identity: Identity
    audit: Audit
    banner: str = ""  # permanent warning on all pages
    report_form: str = "pdf"  # of approved reports

    @property
    def title(self) -> str:
        """Name of the station."""
        return self.daemon.settings.title

    @property
    def zone(self) -> str:
        """Time zone of the station."""
        return self.daemon.settings.zone

    @property
    def places(self) -> Sequence[Place]:
        """Places that the navigation leads to."""
        return PLACES

    @property
    def alerts(self) -> Alerts | None:
        """Alerts to people; None without any."""
        return self.daemon.alerts

    def problems(self) -> list[str]:
        """Return the present errors of the station itself."""
        return self.daemon.problems()


def _services(request: Request) -> Services:
    services: Services = request.app.state.services
    return services


def site_of(request: Request) -> Site:
    """Return what the frame of pages needs: of a station, or of the view of all stations."""
    site: Site = request.app.state.services
    return site


Station = Annotated[Services, Depends(_services)]
AnySite = Annotated[Site, Depends(site_of)]
