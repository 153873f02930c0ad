"""Rules for hosts and origins of requests, which keep pages of other sites away."""

from __future__ import annotations

import re

from starlette.datastructures import Headers

SAFE = frozenset({"GET", "HEAD", "OPTIONS"})
_HOST = re.compile(r"(\[[0-9a-f:.]+\]|[a-z0-9_.-]+)(?::[0-9]{1,5})?", re.ASCII)


def host_is_allowed(headers: Headers, hosts: frozenset[str]) -> bool:
    """Return True if a request names one host, and this one is allowed; every port is, since tunnels change it."""
    given = headers.getlist("host")
    found = _HOST.fullmatch(given[0].lower()) if len(given) == 1 else None
    return found is not None and found[1].strip("[]") in hosts


def is_admitted(method: str, headers: Headers, scheme: str) -> bool:
    """Return True unless a browser sent a request on behalf of another site. A request with a token needs no check.

    The browser's own words are its headers Sec-Fetch-Site, which it leaves out in plain networks, and Origin, which it
    sends with all requests that may change something.
    """
    if _is_bearer(headers):
        return True
    site = headers.get("sec-fetch-site")
    if method in SAFE:
        return site not in ("cross-site", "same-site") or _opens_page(headers)
    origins = headers.getlist("origin")
    return site in (None, "same-origin") and origins == [f"{scheme}://{headers['host'].lower()}"]


def _is_bearer(headers: Headers) -> bool:
    """Return True for a request with a token, which no page of another site can send."""
    return headers.get("authorization", "").partition(" ")[0].lower() == "bearer"


def _opens_page(headers: Headers) -> bool:
    """Return True if a person follows a link to a page of the station, in a window of its own."""
    return headers.get("sec-fetch-mode") == "navigate" and headers.get("sec-fetch-dest") == "document"
