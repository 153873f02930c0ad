"""Queue: what runs and waits at each bench, in which order, and why it waits."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Form, Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response

from bench.station.queue.items import Item, ItemState
from bench.station.view import ItemView, item_views, run_view
from bench.web.access import Operator, Person, Reader
from bench.web.api import queue as api
from bench.web.pages.render import page
from bench.web.pages.results_shown import clock, mark, state_in_words
from bench.web.services import Services, Station

router = APIRouter(include_in_schema=False)
PAST = 20
Version = Annotated[int | None, Form(ge=0)]
Words: dict[str, Any] = {"clock": clock, "mark": mark, "state_in_words": state_in_words}
OVER = (ItemState.ENDED, ItemState.REFUSED, ItemState.CANCELLED)


@router.get("/queue")
async def queue_page(request: Request, station: Station, _: Reader) -> HTMLResponse:
    """Return the page of the queue."""
    past = sorted(station.daemon.queue.items(*OVER), key=lambda item: item.number, reverse=True)[:PAST]
    return page(request, "queue.html.j2", place="/queue", benches=_benches(station), past=past, **Words)


def _benches(station: Services) -> list[dict[str, object]]:
    queue, daemon = station.daemon.queue, station.daemon
    occupying, waiting = item_views(daemon, queue.occupying()), item_views(daemon, queue.waiting())
    own = {each.item.run for each in occupying}
    by_hand = [run_view(each) for name, each in daemon.live.runs.items() if name not in own]
    return [
        {
            "name": name,
            "title": title,
            "stopped": queue.stopped(name),
            "running": _of(name, occupying),
            "by_hand": [run for run in by_hand if daemon.bench_of(run.run) == name],
            "waiting": _of(name, waiting),
        }
        for name, title in daemon.settings.titles.items()
    ]


def _of(bench: str, items: list[ItemView]) -> list[ItemView]:
    return [each for each in items if each.item.submission.bench == bench]


@router.get("/queue/{id_}")
async def item_page(request: Request, station: Station, _: Reader, id_: str) -> Response:
    """Return the page of an item until its run begins, then go to that of the run."""
    item = station.daemon.queue.item(id_)
    if item.run:
        return RedirectResponse(f"/runs/{item.run}", 303)
    (view,) = item_views(station.daemon, [item])
    stopped = station.daemon.queue.stopped(item.submission.bench)
    return page(
        request, "item.html.j2", place="/queue", view=view, stopped=stopped, is_over=item.state in OVER, **Words
    )


@router.post("/queue/{id_}/{action}")
async def change(
    station: Station, person: Operator, id_: str, action: Literal["hold", "release", "cancel", "clone", "up", "down"],
    version: Version = None,
) -> Response:  # fmt: skip
    """Change an item, as its page has shown it."""
    seen = api.Change(version=version)
    if action == "hold":
        await api.hold(station, person, id_, seen)
    elif action == "release":
        await api.release(station, person, id_, seen)
    elif action == "cancel":
        await api.cancel(station, person, id_, seen)
    elif action == "clone":
        await api.clone(station, person, id_)
    else:
        await _step(station, person, station.daemon.queue.item(id_), -1 if action == "up" else 1, version)
    return RedirectResponse("/queue", 303)


async def _step(station: Services, person: Person, item: Item, by: int, version: int | None) -> None:
    """Move a waiting item by one place within its bench; at the end of the list nothing changes."""
    waiting = [each.id for each in station.daemon.queue.waiting(item.submission.bench)]
    if item.id not in waiting:
        await api.move(station, person, item.id, api.Move(version=version))  # refuses, with the reason
        return
    at = waiting.index(item.id)
    others = [each for each in waiting if each != item.id]
    to = max(0, min(len(others), at + by))
    if to != at:
        before = others[to] if to < len(others) else None
        await api.move(station, person, item.id, api.Move(before=before, version=version))
