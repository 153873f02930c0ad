"""Causes of alerts: journals and ends of runs, also of while the station was down, items, benches, disk, due dates."""

import asyncio
import shutil
from datetime import timedelta

import pytest

from bench.clock import wall_utc
from bench.engine.state import RunState
from bench.station.alerts import causes
from bench.station.alerts.kinds import Kind
from bench.station.queue.items import ItemState, Submission
from bench.station.runs.live import LiveRun
from bench.store.reader import Event
from bench.store.runs import summary
from tests.support.in_process import inside, settings_of

NOWHERE = "json://127.0.0.1:9/x"


@pytest.fixture
def settings(tmp_path):
    found = settings_of(tmp_path, phone=NOWHERE)
    found.runs.mkdir()
    return found


def looked(settings, act, rounds=False):
    """Alerts after a look at a station on which something was done, oldest first, and the titles of their messages."""

    async def main():
        async with inside(settings) as (daemon, _):
            daemon.live.looks = 1
            act(daemon)
            for name in ("alerts", *(["alert rounds"] if rounds else [])):
                await daemon.parts[name].look()
            found = daemon.alerts.table.newest(99)[::-1]
            return found, [daemon.alerts.text(each).title.partition(": ")[2] for each in found]

    return asyncio.run(main())


def since_ever(daemon):
    """As a station that has had alerts for years."""
    with daemon.database.transaction() as tables:
        tables.execute("UPDATE alert_since SET at = '2000-01-01T00:00:00+00:00'")


def told(daemon, run, *events, questions=()):
    """Tell the parts of entries of a journal, as the live view does."""
    live = LiveRun(run)
    live.state = RunState(questions=questions)
    for seq, (kind, step, data) in enumerate(events, 2):
        for call in daemon.live.on_event:
            call(live, Event(seq, 1.0, kind, step, data))


LONG_AGO = "20260101T000000Z_smoke"  # before the first alert, unlike a smoke run that has ended in this very second


def run_in(settings, smoke, name=LONG_AGO, **manifest):
    run = summary(shutil.copytree(smoke.path, settings.runs / name, dirs_exist_ok=True))
    return run.__class__(
        run.path, run.state, {**run.manifest, "request": {"bench": str(settings.benches["demo"])}, **manifest}
    )


def test_entries_of_a_journal_that_a_person_must_know_of(settings, smoke_run):
    entries = [
        ("asked", "s1", {"text": "Turn the cube", "expected": "ok"}), ("problem", "", {"text": "too hot"}),
        ("held", "", {"by": "interlock hot"}), ("held", "", {"by": "pause"}), ("step_begins", "s2", {}),
        ("device_left_out", "", {"device": "chamber", "text": "no answer"}),
    ]  # fmt: skip
    found, titles = looked(settings, lambda daemon: told(daemon, run_in(settings, smoke_run), *entries))
    assert [(each.cause.kind, each.times) for each in found] == [
        (Kind.QUESTION, 1), (Kind.ALARM, 1), (Kind.ALARM, 1), (Kind.DEVICE_LOST, 1),
    ]  # fmt: skip
    assert titles[0] == "demo: the run asks: Turn the cube"
    assert titles[2] == "demo: interlock hot holds the run"
    assert found[2].due - found[1].due == timedelta(minutes=10)


def test_an_answer_acknowledges_its_question_alone(settings, smoke_run):
    entries = [
        ("asked", "s1", {"text": "Ready?"}),
        ("answered", "s1", {"answer": "yes"}),
        ("asked", "s2", {"text": "?"}),
    ]
    found, _ = looked(settings, lambda daemon: told(daemon, run_in(settings, smoke_run), *entries))
    assert [each.by for each in found] == ["answer", ""]


def test_a_journal_that_is_read_again_after_a_start_has_no_second_alerts_and_old_ones_are_marked(settings, smoke_run):
    run = run_in(settings, smoke_run)
    entries = [("asked", "s1", {"text": "Ready?"}), ("problem", "", {"text": "too hot"})]
    first, _ = looked(settings, lambda daemon: told(daemon, run, *entries[:1], questions=("s1",)))
    again, titles = looked(settings, lambda daemon: told(daemon, run, *entries, questions=("s1",)))
    assert [each.id for each in again[:1]] == [each.id for each in first]
    assert [each.cause.historical for each in again] == [False, True]
    assert titles[1].endswith("(while the station was down)")


def test_a_run_that_ended_while_the_station_was_down_has_one_alert_and_those_of_before_have_none(settings, smoke_run):
    run_in(settings, smoke_run)
    assert looked(settings, lambda _: None)[0] == []
    for _ in range(2):
        found, titles = looked(settings, since_ever)
        assert [(each.cause.kind, each.cause.historical) for each in found] == [(Kind.END, True)]
    assert titles[0].endswith("has ended: PASS (while the station was down)")


@pytest.mark.parametrize(
    ("manifest", "has_program", "kind", "by_program"),
    [
        ({"simulated": [], "verdict": "FAIL"}, True, Kind.END, True),
        ({"simulated": [], "verdict": "PASS"}, True, Kind.END, False),
        ({"simulated": [], "verdict": "PASS", "request": {"unattended": True}}, True, Kind.END, True),
        ({"simulated": ["head"], "verdict": "FAIL"}, True, Kind.END, False),
        ({"simulated": [], "verdict": "FAIL"}, False, Kind.END, False),
    ],
)
def test_ends_that_the_program_of_a_bench_file_reports(settings, smoke_run, manifest, has_program, kind, by_program):
    cause = causes.of_end(run_in(settings, smoke_run, **manifest), "demo", has_program=has_program, historical=False)
    assert (cause.kind, cause.by_program) == (kind, by_program)


@pytest.mark.parametrize("state", ["failed", "error", "aborted", "interrupted", "damaged"])
def test_every_other_end_is_a_safe_stop_with_its_reason(settings, smoke_run, state):
    run = run_in(settings, smoke_run, problems=["the chamber does not answer"])
    cause = causes.of_end(run.__class__(run.path, state, run.manifest), "demo", has_program=False, historical=False)
    assert (cause.kind, cause.values["text"]) == (Kind.SAFE_STOP, "the chamber does not answer")


def test_items_that_were_refused_or_do_not_begin_and_benches_that_are_stopped(settings):
    def act(daemon):
        one, two, three = (daemon.queue.submit(Submission(sequence="smoke", bench="demo"), "anna") for _ in range(3))
        waiting = [ItemState.QUEUED]
        daemon.queue.change(one.id, waiting, state=ItemState.REFUSED, reason="mine.yaml:3:1", ended_at=wall_utc())
        daemon.queue.change(two.id, waiting, state=ItemState.HELD, reason="its process did not begin")
        daemon.queue.hold(three.id, "anna")
        daemon.queue.stop("demo", "x: the run is damaged")

    found, titles = looked(settings, act)
    assert titles == [
        "demo: no further item begins: x: the run is damaged", "demo: item 1 (smoke) was refused: mine.yaml:3:1",
        "demo: item 2 (smoke) is held: its process did not begin",
    ]  # fmt: skip
    assert found[2].due > found[1].due


def test_a_bench_that_a_run_has_stopped_is_in_the_alert_of_the_run(settings, smoke_run):
    run = run_in(settings, smoke_run)
    (run.path / "manifest.json").write_text("{}")  # which is damaged by that

    def act(daemon):
        since_ever(daemon)
        daemon.queue.stop("demo", f"{run.id}: the run is damaged")

    found, _ = looked(settings, act)
    assert [each.cause.kind for each in found] == [Kind.SAFE_STOP]


def test_a_low_disk_due_calibrations_and_the_digest_once_a_day(tmp_path, smoke_run, monkeypatch):
    alerts = {"disk_free_gb": 1e9, "digest": "00:00", "calibration_due_within_days": 36500}
    settings = settings_of(tmp_path, alerts, phone=NOWHERE)
    settings.runs.mkdir()
    run_in(settings, smoke_run, smoke_run.path.name)
    for _ in range(2):
        found, titles = looked(settings, lambda daemon: None, rounds=True)
    kinds = [each.cause.kind for each in found]
    assert kinds.count(Kind.DIGEST) == kinds.count(Kind.DISK_LOW) == 1
    digest = found[kinds.index(Kind.DIGEST)]
    assert digest.cause.values["ran"].startswith("1 PASS")
    assert "less than 1e+09 GB" in titles[kinds.index(Kind.DISK_LOW)]


def test_the_link_of_a_run_with_a_hostile_name_stays_in_its_line(settings, smoke_run):
    run = run_in(settings, smoke_run)
    hostile = run.__class__(run.path.with_name("x\r\ny z"), run.state, run.manifest)

    async def main():
        async with inside(settings) as (daemon, _):
            daemon.live.looks = 1
            told(daemon, hostile, ("problem", "", {"text": "too hot\r\nBcc: x"}))
            await daemon.parts["alerts"].look()
            return daemon.alerts.text(daemon.alerts.table.newest(1)[0]).body

    body = asyncio.run(main())
    assert body.splitlines()[0] == "demo: too hot Bcc: x"
    assert body.splitlines()[2] == "runs/x%0D%0Ay%20z"


def test_calibrations_are_named_with_their_dates_and_again_when_they_are_past_due():
    today = wall_utc().date()
    due = {"head": today + timedelta(days=5), "counter": today - timedelta(days=1)}
    first = causes.of_calibrations("a", due, today)
    assert first.values["text"] == f"counter was due on {due['counter']}; head is due on {due['head']}"
    assert causes.of_calibrations("a", due, today + timedelta(days=1)).key == first.key
    assert causes.of_calibrations("a", due, today + timedelta(days=6)).key != first.key
    assert causes.of_calibrations("a", {}, today) is None
