"""Queue: submit, order, hold, clone and cancel items."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Annotated, Any

from fastapi import APIRouter, Header, status
from pydantic import BaseModel, Field

from bench.station.queue.items import Item, Line, Submission
from bench.station.queue.table import Queue
from bench.station.view import ItemView, item_views
from bench.station.worker import Checked
from bench.web.access import Engineer, Operator, Person, Reader, Scope
from bench.web.services import Reason, Services, Station, plain

router = APIRouter(prefix="/api/v1", tags=["queue"])
Key = Annotated[str, Header(alias="Idempotency-Key", max_length=100)]


class Change(BaseModel):
    """Change of an item; `version` is that of the item that the sender has seen, null for any."""

    version: int | None = Field(None, ge=0)
    reason: Line = Field("", description="why, for the audit")


class Move(Change):
    """New place of an item."""

    before: str | None = Field(None, description="id of the item that it is to precede; null for the end")


class CheckedView(BaseModel):
    """Result of a check: warnings, and the problems that forbid a run."""

    expected_s: float
    warnings: list[str]
    problems: list[str]

    @classmethod
    def of(cls, checked: Checked) -> CheckedView:
        """Return the view of a result."""
        return cls(expected_s=checked.expected_s, warnings=list(checked.warnings), problems=list(checked.problems))


@router.get("/queue")
async def items(station: Station, _: Reader, *, all_: bool = False) -> list[ItemView]:
    """Return the items that run or wait, in order; with `all_` those of the past as well."""
    queue = station.daemon.queue
    return item_views(station.daemon, queue.items() if all_ else [*queue.occupying(), *queue.waiting()])


@router.get("/queue/{id_}")
async def item(station: Station, _: Reader, id_: str) -> Item:
    """Return an item."""
    return station.daemon.queue.item(id_)


@router.post("/check")
async def check(station: Station, _: Reader, submission: Submission) -> CheckedView:
    """Check a submission without queueing it."""
    return CheckedView.of(await station.daemon.checked(submission))


@router.post("/queue", status_code=status.HTTP_201_CREATED)
async def submit(
    station: Station, person: Operator, submission: Submission, key: Key = "", *, held: bool = False
) -> Item:
    """Check a submission and append it to the queue; a repeated request with the same key returns the same item."""

    def note(item: Item) -> None:
        station.audit.note(person, "submit", item.id, sequence=submission.sequence, bench=submission.bench)

    may_be_new = Scope.ENGINEER in person.scopes
    return await station.daemon.submit(
        submission, person.name, key=key, held=held, may_be_new=may_be_new, submitted=note
    )


@router.post("/queue/{id_}/hold")
async def hold(station: Station, person: Operator, id_: str, change: Change) -> Item:
    """Hold a waiting item."""
    return _changed(station, person, "hold", id_, change, lambda items: items.hold(id_, person.name, change.version))


@router.post("/queue/{id_}/release")
async def release(station: Station, person: Operator, id_: str, change: Change) -> Item:
    """Release a held item."""
    return _changed(station, person, "release", id_, change, lambda items: items.release(id_, change.version))


@router.post("/queue/{id_}/cancel")
async def cancel(station: Station, person: Operator, id_: str, change: Change) -> Item:
    """Cancel a waiting item."""
    return _changed(
        station, person, "cancel", id_, change, lambda items: items.cancel(id_, person.name, change.version)
    )


@router.post("/queue/{id_}/move")
async def move(station: Station, person: Operator, id_: str, change: Move) -> Item:
    """Move a waiting item before another one, or to the end."""
    with _noted(station, person, "move", id_, change, to_before=change.before or "the end"):
        return station.daemon.queue.move(id_, change.before, change.version)


@router.post("/queue/{id_}/clone", status_code=status.HTTP_201_CREATED)
async def clone(station: Station, person: Operator, id_: str) -> Item:
    """Append an item with the submission of another one."""

    def note(cloned: Item) -> None:
        station.audit.note(person, "clone", id_, after=cloned.id)

    may_be_new = Scope.ENGINEER in person.scopes
    return await station.daemon.clone(id_, person.name, may_be_new=may_be_new, submitted=note)


@router.post("/benches/{bench}/go-on", status_code=status.HTTP_204_NO_CONTENT)
async def go_on(station: Station, person: Engineer, bench: str, reason: Reason = "") -> None:
    """Begin items at a bench again, after somebody has looked at it."""
    station.daemon.settings.bench_file(bench)
    station.daemon.leases.expect(bench, person.name)
    before = station.daemon.queue.stopped(bench)
    with station.audit.noted(person, "go on", bench, before=before, reason=plain(reason)):
        station.daemon.queue.go_on(bench)
    station.daemon.scheduler.wake()


def _noted(
    station: Services, person: Person, action: str, id_: str, change: Change, **facts: str
) -> AbstractContextManager[dict[str, Any]]:
    before = station.daemon.queue.item(id_).state
    return station.audit.noted(person, action, id_, before=before, reason=change.reason, **facts)


def _changed(
    station: Services, person: Person, action: str, id_: str, change: Change, call: Callable[[Queue], Item]
) -> Item:
    """Change an item, with an entry of its state before and after."""
    with _noted(station, person, action, id_, change) as facts:
        changed = call(station.daemon.queue)
        facts["after"] = changed.state
        return changed
