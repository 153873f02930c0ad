"""Line of open alerts that is on every page."""

from __future__ import annotations

import hashlib
from contextlib import suppress
from typing import NamedTuple

from bench.errors import StoreError
from bench.figures.languages import current
from bench.figures.sayings import plain
from bench.station.alerts.alerts import Alerts
from bench.station.alerts.kinds import Kind
from bench.station.alerts.table import Alert

MOST = 50


class Line(NamedTuple):
    """Number of open alerts, the newest one in words, and a mark that changes with the content; empty without any."""

    number: int = 0
    newest: str = ""
    mark: str = ""


def in_words(alerts: Alerts, alert: Alert) -> list[str]:
    """Return what an alert says and what to do, in the current language."""
    cause = alert.cause
    if cause.kind is not Kind.QUESTION and (text := cause.values.get("text")):  # a question is in the words of people
        cause = cause._replace(values={**cause.values, "text": plain(text)})
    return alerts.text(alert._replace(cause=cause), current()).body.splitlines()[:2]


def opened(alerts: Alerts | None) -> Line:
    """Return the line of the urgent alerts that nobody has acknowledged, in the current language."""
    if alerts is None:
        return Line()
    with suppress(StoreError):  # is among the problems of the station
        if found := alerts.table.unacknowledged(MOST):
            newest = in_words(alerts, found[0])[0]
            content = f"{current()} {' '.join(f'{each.id}/{each.times}' for each in found)}"
            return Line(len(found), newest, hashlib.sha256(content.encode()).hexdigest()[:16])
    return Line()
