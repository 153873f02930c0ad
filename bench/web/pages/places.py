"""Places: the pages that the navigation leads to, in its order."""

from __future__ import annotations

from typing import NamedTuple


class Place(NamedTuple):
    """Entry of the navigation; `title` is translated."""

    path: str
    title: str


# In this order: Station, Runs, Units, Queue, Instruments, Sequences, Alerts; only those that exist.
PLACES = (
    Place("/", "Station"), Place("/runs", "Runs"), Place("/units", "Units"), Place("/queue", "Queue"),
    Place("/instruments", "Instruments"), Place("/sequences", "Sequences"), Place("/alerts", "Alerts"),
)  # fmt: skip
TITLES = ("Station", "Runs", "Units", "Queue", "Instruments", "Sequences", "Alerts")
