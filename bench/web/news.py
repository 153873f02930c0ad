"""News of a run: entries of its journal that a person in front of the page wants to know, in words."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from datetime import datetime, timedelta
from typing import Any, NamedTuple

from markupsafe import Markup, escape

from bench.figures.languages import tr
from bench.figures.sayings import said
from bench.sequence.plan.dwells import first_visit
from bench.store.reader import Event
from bench.web.sentence import NOW, Facts, in_words

NEWS = {
    "run_begins": "run begins",
    "run_resumed": "run resumed",
    "held": "held by the {by}",
    "released": "released by the {by}",
    "asked": "question: {text}",
    "answered": "answered by {by}: {answer}",
    "unanswered": "question not answered",
    "problem": "{text}",
    "warning": "{text}",
    "step_failed": "step failed: {text}",
    "step_cut": "step interrupted",
    "left_out": "step left out",
    "device_left_out": "{device} is left out",
    "unit_dropped": "unit in place {place} takes no further part: {text}",
    "gaps": "{device}.{channel}: {lost} latches lost",
    "doubted": "{reading}: {why}",
    "fault": "{device}: {text}",
    "command": "{command} by {by}",
    "order": "order by {by}: {order}",
    "order_refused": "order by {by} refused: {text}",
    "order_made_safe": "{device} made safe after its order had failed",
    "power": "power supply of the computer: {state}",
    "clock_step": "the clock of the computer was set",
    "stalled": "the run stood still",
    "soak_credit": "part of the soak counts from before: {credit_s} s",
    "end_requested": "end requested: {text}",
    "made_safe": "made safe",
    "run_ended": "run ended",
}
URGENT = frozenset({"problem", "step_failed", "unit_dropped", "device_left_out", "fault", "stalled"})
SENTENCES = frozenset({"text", "why", "by", "problem"})  # values with words of the program
STATES = frozenset({"how", "state", "action", "wish", "command"})  # values that are one word of the program
OF_PEOPLE = frozenset({"asked", "answered", "command", "order"})  # entries with what people have said
LASTING = frozenset({"ramp", "soak", "wait", "wait_until", "set", "orient", "rotate", "oscillate"})


class Line(NamedTuple):
    """News: instant by the clock of the bench, text as HTML, step, and True if it needs a look."""

    at: datetime | None
    text: Markup
    step: str
    is_urgent: bool


class _Known(dict[str, Any]):
    def __missing__(self, key: str) -> str:
        return "?"


def news(events: Iterable[Event], zero: datetime | None, steps: Mapping[str, Facts], most: int) -> list[Line]:
    """Return the newest entries first; `zero` is the instant of bench time 0, `steps` the plan by ids."""
    found: list[Line] = []
    for event, text in _worded(events, steps):
        at = zero + timedelta(seconds=event.at_s) if zero is not None else None
        found.append(Line(at, text, event.step, event.kind in URGENT))
        if len(found) >= most:
            break
    return found


def _worded(events: Iterable[Event], steps: Mapping[str, Facts]) -> Iterator[tuple[Event, Markup]]:
    for event in events:
        kind = "answered" if event.data.get("command") == "answer" else event.kind
        if kind in NEWS:
            yield event, escape(tr(NEWS[kind])).format_map(_values(kind, event.data))
        elif event.kind == "step_begins":
            planned = steps.get(first_visit(event.step))
            if planned is not None and planned["facts"]["verb"] in LASTING:
                yield event, escape(in_words(NOW, planned))


def kind_in_words(kind: str) -> str:
    """Return the kind of an entry in words; the release of a hold is no release of a file."""
    return tr("hold released" if kind == "released" else kind.replace("_", " "))


def _values(kind: str, data: Mapping[str, Any]) -> _Known:
    """Return the values of an entry as HTML."""
    return _Known(
        {key: said(str(value)) if key in SENTENCES and kind not in OF_PEOPLE else value for key, value in data.items()}
    )
