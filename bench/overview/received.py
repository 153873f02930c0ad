"""Messages of stations as they are kept: the facts that are shown, each bounded."""

from __future__ import annotations

from datetime import datetime
from typing import NamedTuple

from bench.figures.languages import ENGLISH, LANGUAGES
from bench.overview.facts import FARTHEST_END, Facts

KEPT = 5  # of questions, problems, alarms and results
OTHERS = tuple(each for each in LANGUAGES if each != ENGLISH)


class State(NamedTuple):
    """State of a bench as it was published; `came` is when it was received."""

    came: datetime
    title: str
    at: datetime | None
    zone: str
    url: str
    recorded: str
    run: str
    sequence: str
    run_title: str
    units: tuple[str, ...]
    operator: str
    sentence: str
    sentences: dict[str, str]
    started: datetime | None
    done: int
    total: int
    ends: datetime | None
    held_by: tuple[str, ...]
    problems: tuple[str, ...]
    stopped: str
    waiting: int


class Question(NamedTuple):
    """Open question."""

    text: str
    expected: str


class Questions(NamedTuple):
    """Open questions of a bench; `came` is when the first of them was received."""

    came: datetime
    at: datetime | None
    run: str
    questions: tuple[Question, ...]


class Reading(NamedTuple):
    """Reading of a chamber in °C; `value` is None unless it is valid."""

    came: datetime
    value: float | None
    unit: str


class Alarm(NamedTuple):
    """Entry of a journal that needs a person."""

    id: str
    came: datetime
    at: datetime | None
    run: str
    text: str


class Result(NamedTuple):
    """End of a run; `came` is when it was first received."""

    id: str
    came: datetime
    run: str
    title: str
    units: tuple[str, ...]
    outcome: str
    verdict: str
    ended: datetime | None


def state_of(facts: Facts, now: datetime) -> State:
    """Return the state of a bench."""
    return State(
        now, facts.text("title", 100), facts.instant("at", now), facts.zone("zone"), facts.address("url"),
        facts.text("bench"), facts.text("run"), facts.text("sequence", 100), facts.text("run_title"),
        facts.texts("units", 8, 64), facts.text("operator", 64), facts.text("sentence", 300),
        facts.by_name("sentences", OTHERS, 300), facts.instant("started", now),
        facts.whole("done"), facts.whole("total"), facts.instant("ends", now, FARTHEST_END),
        facts.texts("held_by", KEPT), facts.texts("problems", KEPT, 300), facts.text("stopped", 300),
        facts.whole("waiting"),
    )  # fmt: skip


def questions_of(facts: Facts, before: Questions | None, now: datetime) -> Questions | None:
    """Return the open questions; None if there are none. `before` are those that were open before."""
    asked = tuple(
        Question(each.text("text", 500), each.text("expected", 200)) for each in facts.parts("questions", KEPT)
    )
    if not asked:
        return None
    run = facts.text("run")
    same = before is not None and before.run == run and before.questions == asked
    return Questions(before.came if same and before is not None else now, facts.instant("at", now), run, asked)


def alarm_of(facts: Facts, now: datetime) -> Alarm:
    """Return an alarm."""
    return Alarm(
        facts.text("id", 220), now, facts.instant("at", now), facts.text("run"),
        facts.text("text", 500) or facts.text("kind", 64),
    )  # fmt: skip


def result_of(facts: Facts, now: datetime) -> Result:
    """Return the end of a run."""
    return Result(
        facts.text("id", 220), now, facts.text("run"), facts.text("title"), facts.texts("units", 8, 64),
        facts.text("outcome", 40), facts.text("verdict", 40), facts.instant("ended", now),
    )  # fmt: skip
