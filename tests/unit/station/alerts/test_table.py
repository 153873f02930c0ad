"""Alerts on the disk: each cause once, storms in one, retries, escalation, and what is left after a process died."""

from datetime import UTC, datetime, timedelta

import pytest
from pydantic import SecretStr

from bench.errors import InputError
from bench.station.alerts import table as module
from bench.station.alerts.kinds import Cause, Kind
from bench.station.alerts.settings import Route, RouteEntry
from bench.station.alerts.table import AlertTable
from bench.station.storage.database import Database

MINUTE = timedelta(minutes=1)
NOW = datetime(2026, 11, 26, 2, 0, tzinfo=UTC)


@pytest.fixture
def database(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "wall_utc", lambda: NOW)
    database = Database(tmp_path)
    yield database
    database.close()


def routes(**entries):
    return {name: Route(name, entry, SecretStr(f"json://{name}")) for name, entry in entries.items()}


def alarm(number, run="r1", **more):
    return Cause(**{
        "kind": Kind.ALARM, "key": f"{run}#{number}", "subject": run, "text": "alarm",
        "values": {"bench": "a", "text": f"interlock {number}"}, "bench": "a", **more,
    })  # fmt: skip


def table_of(database, **entries):
    return AlertTable(database, routes(**(entries or {"phone": RouteEntry()})))


def test_a_cause_has_one_alert_however_often_it_is_found(database):
    table = table_of(database)
    for _ in range(3):
        table.add([alarm(1)], NOW)
    assert [each.times for each in table.newest(9)] == [1]


def test_a_storm_is_one_alert_at_once_and_one_with_a_count_after_ten_minutes(database):
    table = table_of(database)
    for second in range(500):
        table.add([alarm(second)], NOW + timedelta(seconds=second))
    later, first = table.newest(9)
    assert (first.times, first.due, later.times, later.due) == (1, NOW, 499, NOW + 10 * MINUTE)
    table.sent(table.next_due("phone", NOW))
    assert table.next_due("phone", NOW + 9 * MINUTE) is None
    assert table.next_due("phone", NOW + 10 * MINUTE).alert == later.id


def test_runs_and_kinds_do_not_wait_for_each_other(database):
    table = table_of(database)
    table.add([alarm(1), alarm(1, "r2"), alarm(2, kind=Kind.DEVICE_LOST)], NOW)
    assert {each.due for each in table.newest(9)} == {NOW}


def test_within_any_ten_minutes_one_alert_of_a_kind_of_a_run_is_sent(database):
    table, sent = table_of(database), []
    for minute in range(60):
        now = NOW + minute * MINUTE
        table.add([alarm(minute)], now)
        while (delivery := table.next_due("phone", now)) is not None:
            table.sent(delivery)
            sent.append(minute)
    assert sent == [0, 10, 20, 30, 40, 50]


def test_what_is_answered_before_it_is_sent_is_not_sent(database):
    table = table_of(database)
    table.add([alarm(1, kind=Kind.QUESTION, step="s1"), alarm(2, kind=Kind.QUESTION, step="s2")], NOW)
    table.answered("r1", "s1", NOW)
    assert table.next_due("phone", NOW) is None
    table.answered("r1", "s2", NOW)
    assert table.next_due("phone", NOW + 10 * MINUTE) is None
    assert {each.by for each in table.newest(9)} == {"answer"}
    # The next question does not wait longer because of one that was never sent.
    table.add([alarm(3, kind=Kind.QUESTION, step="s3")], NOW)
    assert table.next_due("phone", NOW + 10 * MINUTE) is not None


def test_the_questions_of_a_run_that_has_ended_are_closed(database):
    table = table_of(database)
    table.add([alarm(1, kind=Kind.QUESTION, step="s1")], NOW)
    table.answered("r1", None, NOW)
    assert table.open() == 0


def test_pauses_double_until_an_hour_has_passed_and_then_it_has_failed(database):
    table = table_of(database)
    table.add([alarm(1)], NOW)
    now, pauses = NOW, []
    while (delivery := table.next_due("phone", now)) is not None:
        table.begin(delivery)
        table.not_sent(delivery, "refused", now, again=False)
        (left,) = table.deliveries(delivery.alert)
        pauses.append((left.due - now).total_seconds())
        now = left.due
    assert pauses[:8] == [10, 20, 40, 80, 160, 320, 600, 600]
    assert left.state == "failed"
    assert now - NOW <= 70 * MINUTE


def test_a_failing_alert_lets_newer_ones_pass(database):
    table = table_of(database)
    table.add([alarm(1)], NOW)
    old = table.next_due("phone", NOW)
    table.begin(old)
    table.not_sent(old, "refused", NOW, again=False)
    table.add([alarm(1, "r2")], NOW + MINUTE)
    assert table.next_due("phone", NOW + MINUTE).alert != old.alert


def test_an_alert_that_nobody_acknowledges_goes_to_the_next_route_and_no_further(database):
    table = table_of(
        database, phone=RouteEntry(next="chief"), chief=RouteEntry(events=(Kind.DIGEST,), next="phone"),
        office=RouteEntry(),
    )  # fmt: skip
    table.add([alarm(1), alarm(2, kind=Kind.END)], NOW)
    table.escalate(15 * MINUTE, NOW + 14 * MINUTE)
    assert table.next_due("chief", NOW + 14 * MINUTE) is None
    for _ in range(2):
        table.escalate(15 * MINUTE, NOW + 15 * MINUTE)
    found = table.next_due("chief", NOW + 15 * MINUTE)
    assert (table.alert(found.alert).cause.kind, found.after) == (Kind.ALARM, "phone")
    assert [each.route for each in table.deliveries(found.alert)] == ["phone", "office", "chief"]


def test_an_acknowledged_alert_goes_no_further(database):
    table = table_of(database, phone=RouteEntry(next="chief"), chief=RouteEntry(events=(Kind.DIGEST,)))
    table.add([alarm(1)], NOW)
    (alert,) = table.newest(9)
    assert table.acknowledge(alert.id, "anna", NOW).by == "anna"
    assert table.acknowledge(alert.id, "boris", NOW + MINUTE).by == "anna"
    table.escalate(15 * MINUTE, NOW + 60 * MINUTE)
    assert table.next_due("phone", NOW + 60 * MINUTE) is None
    assert table.next_due("chief", NOW + 60 * MINUTE) is None
    with pytest.raises(InputError, match="no alert 'x'"):
        table.acknowledge("x", "anna", NOW)


def test_what_was_being_sent_when_the_process_died_is_sent_again_and_marked(database, monkeypatch):
    table = table_of(database)
    table.add([alarm(1)], NOW)
    table.begin(table.next_due("phone", NOW))
    later = NOW + timedelta(hours=3)
    monkeypatch.setattr(module, "wall_utc", lambda: later)
    again = table_of(database)
    found = again.next_due("phone", later)
    assert found.again
    assert found.since == later  # it has its whole hour
    again.not_sent(found, "refused", later, again=False)
    assert again.next_due("phone", later + MINUTE).again


def test_an_end_that_the_program_of_the_bench_reports_is_not_sent_to_the_same_person(database):
    table = table_of(database, phone=RouteEntry(same_person_as=("a",)), office=RouteEntry())
    table.add([alarm(1, kind=Kind.SAFE_STOP, by_program=True), alarm(2)], NOW)
    by_kind = {each.cause.kind: [way.route for way in table.deliveries(each.id)] for each in table.newest(9)}
    assert by_kind == {Kind.SAFE_STOP: ["office"], Kind.ALARM: ["phone", "office"]}
