"""Sentences of a run: what it does, how far it is, and what comes next."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from bench.app.request import RunRequest
from bench.config.load import find
from bench.figures.languages import language
from bench.station.prepare.plans import timeline_of
from bench.station.runs.live import LiveRun
from bench.store.reader import Event
from bench.store.runs import RunSummary
from bench.web.news import news
from bench.web.pages.readings import rows
from bench.web.pages.trends import Trend
from bench.web.sentence import doing, sentence_of, soaking

SOAK = "steps/cycle=1/temperature=-40/soak"


@pytest.fixture(scope="module")
def plan():
    request = RunRequest(
        sequence=str(find("tumble_static", "sequences")), bench=str(find("simulated", "config")), runs=Path("runs")
    )
    return timeline_of(request)


@pytest.fixture
def live(plan, tmp_path):
    found = LiveRun(RunSummary(tmp_path, "running", {"title": "Static temperature tumble", "units": []}))
    found.timeline = plan
    return found


def begin(live, step, at_s, now_s, **status):
    """Let a step be in progress since an instant of bench time."""
    live.events.append(Event(1, at_s, "step_begins", step, {}))
    live.state = live.state.__class__(under_way=(step,), done=5)
    live.status = {"now_s": now_s, "readings": {}, **status}


def test_a_soak_says_how_long_how_steady_and_what_is_next(live):
    begin(live, SOAK, 1000.0, 1000.0 + 23 * 60)
    found = sentence_of(live, steady=(0.6 / 3600, 0.12))
    assert found.now == (
        "Soaking at −40 °C, 23 min of at least 60 min, slope 0.6 °C/h (needs ≤ 1), range 0.12 °C (needs ≤ 0.2)"
    )
    assert found.then == "next: turn head to 1°"
    assert (found.state, found.step, found.total) == ("running", SOAK, 421)
    assert soaking(live) == ("unit_temperature", 600.0, 0.2, 1000.0)
    within = sentence_of(live, steady=(-0.00001 / 3600, 0.12), since="14:02")
    assert within.now == (
        "Soaking at −40 °C, 23 min of at least 60 min, within 0.2 °C since 14:02, slope 0.0 °C/h (needs ≤ 1)"
    )


def test_a_repeated_step_has_the_words_of_the_first(live):
    begin(live, f"{SOAK}~2", 0.0, 60.0)
    assert sentence_of(live).now.startswith("Soaking at −40 °C, 60 s of at least")


def test_a_ramp_shows_where_the_chamber_is(live):
    reading = {"quality": "valid", "value": -32.126, "unit": "°C"}
    begin(live, SOAK.replace("soak", "ramp"), 0.0, 9.0, readings={"chamber.process_value": reading})
    assert sentence_of(live).now == "Changing chamber to −40 °C, now −32.13 °C"


def test_the_same_in_chinese(live):
    begin(live, SOAK, 0.0, 60.0)
    with language("zh"):
        found = sentence_of(live)
    assert (found.now, found.then) == ("在 −40 °C 保温，已 60 s，至少 60 min", "下一步：分度头转至 1°")


def test_a_pause_is_shown_before_and_after_the_step_ends(live):
    begin(live, SOAK, 0.0, 9.0, holds=["operator"])
    assert sentence_of(live).state == "pauses"
    live.state = live.state.__class__(done=6, held=frozenset({"operator"}))
    found = sentence_of(live)
    assert (found.state, found.now) == ("paused", "Held before the next step: operator")


def test_a_question_comes_before_everything(live):
    begin(live, SOAK, 0.0, 9.0, holds=["operator"], questions=[{"step": SOAK, "text": "?"}])
    assert sentence_of(live).state == "asks"


def test_what_is_published_has_no_number_that_changes_meanwhile(live):
    begin(live, SOAK, 1000.0, 1000.0 + 23 * 60)
    assert doing(live) == {"en": "Soaking at −40 °C", "zh": "在 −40 °C 保温"}
    live.state = live.state.__class__(done=5)
    assert doing(live)["en"] == "Between two steps"
    live.status = {"holds": ["operator"]}
    assert doing(live)["zh"] == "在下一步骤之前保持：操作员"
    live.timeline = None
    assert doing(live) == {}


def test_a_run_without_a_plan_has_a_sentence_all_the_same(live):
    live.timeline = None
    assert sentence_of(live).now == "Connecting to the instruments"
    begin(live, "steps/unknown", 0.0, 9.0)
    found = sentence_of(live)
    assert (found.now, found.then, found.total) == ("steps/unknown", "", 0)


def test_a_reading_has_its_set_point_and_a_bad_one_says_why(live, plan):
    readings = {
        "unit_temperature": {"quality": "stale", "why": "has had no valid reading for 12 s"},
        "chamber.process_value": {"quality": "valid", "value": -39.98, "unit": "°C", "age_s": 1.0},
        "chamber.set_point": {"quality": "valid", "value": -40.0, "unit": "°C"},
        "head.angle": {"quality": "valid", "value": 1.0, "unit": "°"},
        "supply.voltage": {"quality": "valid", "value": 15.0, "unit": "V"},
        "source.current": {"quality": "valid", "value": 0.0, "unit": "A"},
    }
    begin(live, SOAK, 0.0, 9.0, readings=readings)
    planned = next(step for step in plan["steps"] if step["id"] == SOAK)
    units = {name: found.get("unit", "°C") for name, found in readings.items()}
    found = {row.name: row for row in rows(live, planned, Trend(units=units))}
    assert "chamber.set_point" not in found
    chamber, unit = found["chamber.process_value"], found["unit_temperature"]
    assert (chamber.label, chamber.value, chamber.target, chamber.why) == ("chamber", "−39.98", "−40.00", "")
    assert (unit.value, unit.target, unit.band) == ("–", "−40.00", "range ≤ 0.2")
    assert unit.why == "stale: has had no valid reading for 12 s"
    assert [found[name].target for name in ("head.angle", "supply.voltage", "source.current")] == [
        "1.000",
        "15.000",
        "",
    ]
    assert found["counter.x"].band == "not counting"


def test_news_are_in_words_newest_first_and_an_answer_names_its_person(plan):
    zero = datetime(2026, 1, 1, tzinfo=UTC)
    events = [
        Event(9, 80.0, "problem", SOAK, {"text": "{x} of the chamber"}),
        Event(8, 70.0, "command", "", {"command": "answer", "by": "anna", "answer": "done"}),
        Event(7, 60.0, "step_begins", SOAK, {}),
        Event(6, 50.0, "step_begins", "steps/cycle=1/temperature=-40/position=0/move", {}),
        Event(5, 40.0, "unheard_of", "", {}),
        Event(4, 30.0, "gaps", "", {"device": "counter", "channel": "x", "lost": 3}),
    ]
    found = news(events, zero, {step["id"]: step for step in plan["steps"]}, 4)
    assert [line.text for line in found] == [
        "{x} of the chamber", "answered by anna: done", "Soaking at −40 °C", "counter.x: 3 latches lost",
    ]  # fmt: skip
    assert [line.is_urgent for line in found] == [True, False, False, False]
    assert found[0].at == zero + timedelta(seconds=80)
