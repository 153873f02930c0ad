"""Line of open alerts that is on every page."""

from __future__ import annotations

import hashlib
from contextlib import suppress
from typing import NamedTuple

from bench.errors import StoreError
from bench.figures.languages import current
from bench.web.services import Services

MOST = 50


class Line(NamedTuple):
    """Number of open alerts, the newest one in words, and a mark that changes with the content; empty without any."""

    number: int = 0
    newest: str = ""
    mark: str = ""


def opened(station: Services) -> Line:
    """Return the line of the urgent alerts that nobody has acknowledged, in the current language."""
    alerts = station.daemon.alerts
    if alerts is None:
        return Line()
    with suppress(StoreError):  # is among the problems of the station
        if found := alerts.table.unacknowledged(MOST):
            newest = alerts.text(found[0], current()).body.splitlines()[0]
            content = f"{current()} {' '.join(f'{each.id}/{each.times}' for each in found)}"
            return Line(len(found), newest, hashlib.sha256(content.encode()).hexdigest()[:16])
    return Line()
