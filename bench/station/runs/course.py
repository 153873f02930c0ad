"""Course of a run: its steps over time, and what happened besides, from its journal."""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import datetime

from pydantic import BaseModel, ConfigDict, Field

from bench.errors import StoreError
from bench.store.reader import Event
from bench.store.runs import RunSummary
from bench.store.tail import Tail

EVENTS_MOST, AT_ONCE = 50_000, 5000
NOTED_MOST = 200
PARTS = 3  # of the id of a step that name a passage: phase, and two loops or groups
ENDS = ("step_ended", "step_failed", "step_cut")
USUAL = frozenset({"step_begins", "step_ended", "identified"})


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True)


class Stretch(_Model):
    """Steps of one verb, one after the other, within a passage; times in s of bench time since the begin."""

    verb: str
    begin_s: float
    end_s: float


class Passage(_Model):
    """Part of the plan, such as one temperature."""

    name: str = Field(description="first parts of the ids of its steps")
    begin_s: float
    end_s: float
    steps: int
    stretches: list[Stretch]


class Noted(_Model):
    """Entry of the journal other than the begin and end of steps."""

    seq: int
    at_s: float
    kind: str
    step: str
    text: str


class Course(_Model):
    """Passages of a run in their order, and what else was noted. `problem` says why there are none."""

    begins: datetime | None = None
    total_s: float = 0.0
    passages: list[Passage] = []
    noted: list[Noted] = []
    problem: str = ""


def course_of(run: RunSummary) -> Course:
    """Return the course of a run, finished or not."""
    try:
        with Tail(run.path) as tail:
            begins, events = tail.begins(), list(_events(tail))
    except StoreError as problem:
        return Course(problem=str(problem))
    if not events:
        return Course(problem="the run has no journal yet")
    first_s = begins[1] if begins is not None else events[0].at_s
    passages: list[Passage] = []
    for name, verb, begin_s, end_s in _steps(events):
        _add(passages, name, Stretch(verb=verb, begin_s=begin_s - first_s, end_s=end_s - first_s))
    noted = [
        Noted(seq=each.seq, at_s=each.at_s - first_s, kind=each.kind, step=each.step, text=_text(each))
        for each in events
        if each.kind not in USUAL
    ]
    return Course(
        begins=begins[0] if begins is not None else None, total_s=events[-1].at_s - first_s, passages=passages,
        noted=noted[:NOTED_MOST],
    )  # fmt: skip


def _events(tail: Tail) -> Iterator[Event]:
    after = 0
    while after < EVENTS_MOST and (found := tail.events(after, AT_ONCE)):
        yield from found
        after = found[-1].seq


def _steps(events: list[Event]) -> Iterator[tuple[str, str, float, float]]:
    """Yield passage, verb, begin and end of each step in the order of their begin; one in progress ends now."""
    ends_s = {each.step: each.at_s for each in events if each.kind in ENDS}
    for each in events:
        if each.kind == "step_begins":
            *passage, verb = each.step.split("/")
            yield "/".join(passage[:PARTS]), verb.partition("#")[0], each.at_s, ends_s.get(each.step, events[-1].at_s)


def _add(passages: list[Passage], name: str, stretch: Stretch) -> None:
    """Append a stretch to the last passage, or to a new one; to the last stretch if its verb is the same."""
    if not passages or passages[-1].name != name:
        passages.append(Passage(name=name, begin_s=stretch.begin_s, end_s=stretch.end_s, steps=1, stretches=[stretch]))
        return
    last = passages[-1]
    before = last.stretches[-1]
    end_s = max(last.end_s, stretch.end_s)
    if before.verb == stretch.verb:
        joined = [*last.stretches[:-1], before.model_copy(update={"end_s": max(before.end_s, stretch.end_s)})]
    else:
        joined = [*last.stretches, stretch]
    passages[-1] = last.model_copy(update={"end_s": end_s, "steps": last.steps + 1, "stretches": joined})


def _text(event: Event) -> str:
    parts = (f"{key}: {each if isinstance(each, str) else json.dumps(each)}" for key, each in event.data.items())
    return "; ".join(parts)[:500]
