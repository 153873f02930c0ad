"""Order of a queue: which item is next at a bench, and when each is expected to begin and end."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime, timedelta
from typing import NamedTuple

from bench.station.queue.items import Item, ItemState

FASTEST = 1000.0  # bench seconds per second assumed of a simulated run at full speed
OVERHEAD_S = 5.0  # from the start of the process to the first step, and from the last one to the report


class Expected(NamedTuple):
    """Estimated instants of the begin and the end of an item."""

    begins: datetime
    ends: datetime


def next_item(waiting: Iterable[Item], now: datetime) -> Item | None:
    """Return the first queued item that may begin now; one that must wait for its instant lets others pass."""
    return next((each for each in waiting if each.state is ItemState.QUEUED and not _is_early(each, now)), None)


def _is_early(item: Item, now: datetime) -> bool:
    return item.submission.not_before is not None and item.submission.not_before > now


def wall_s(item: Item) -> float:
    """Return the expected duration of an item in s of real time."""
    speed = {None: 1.0, "max": FASTEST}.get(item.submission.speed)
    return OVERHEAD_S + item.expected_s / (float(item.submission.speed or 1) if speed is None else speed)


def expected(items: Sequence[Item], now: datetime, ends: Mapping[str, datetime] | None = None) -> dict[str, Expected]:
    """Return when the items of one bench begin and end, by id; held items have no instant.

    `items` are in order, those that run first. `ends` are better estimates for runs in progress.
    """
    found: dict[str, Expected] = {}
    free = now
    for item in items:
        if item.state in (ItemState.STARTING, ItemState.RUNNING):
            begun = item.begun_at or now
            end = (ends or {}).get(item.id) or begun + timedelta(seconds=wall_s(item))
            found[item.id] = Expected(begun, max(end, now))
        elif item.state is ItemState.QUEUED:
            begins = max(free, item.submission.not_before or free)
            found[item.id] = Expected(begins, begins + timedelta(seconds=wall_s(item)))
        else:
            continue
        free = max(free, found[item.id].ends)
    return found
