"""The queue: order, durability, idempotency, and changes of items that have changed meanwhile."""

import os
import signal
import subprocess
import sys
import textwrap
from datetime import UTC, datetime, timedelta

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from bench.errors import InputError, InUseError, StaleError
from bench.station.queue.items import Item, ItemState, Submission
from bench.station.queue.schedule import OVERHEAD_S, expected, next_item
from bench.station.queue.table import Queue
from bench.station.storage.database import Database

NOW = datetime(2026, 11, 21, 20, 0, tzinfo=UTC)


@pytest.fixture
def queue(tmp_path):
    database = Database(tmp_path)
    yield Queue(database)
    database.close()


def wanted(sequence="smoke", **more):
    return Submission(sequence=sequence, bench="demo", **more)


def order(queue):
    return [each.submission.sequence for each in queue.waiting()]


def test_items_begin_in_the_order_of_submission_and_a_higher_priority_goes_first(queue):
    for name in ("first", "second"):
        queue.submit(wanted(name), "anna")
    queue.submit(wanted("urgent", priority=1), "anna")
    assert order(queue) == ["urgent", "first", "second"]


def test_a_submission_repeated_with_its_key_is_one_item(queue):
    first = queue.submit(wanted(), "anna", key="k1")
    assert queue.submit(wanted(), "anna", key="k1").id == first.id
    assert len(queue.waiting()) == 1
    with pytest.raises(InputError, match="another submission"):
        queue.submit(wanted("other"), "anna", key="k1")


def test_an_item_moves_before_another_with_its_priority_and_to_the_end(queue):
    a, b, c = (
        queue.submit(wanted(name, priority=priority), "anna") for name, priority in (("a", 2), ("b", 0), ("c", 0))
    )
    assert queue.move(c.id, a.id).priority == 2
    assert order(queue) == ["c", "a", "b"]
    queue.move(c.id, None)
    assert order(queue) == ["a", "b", "c"]
    with pytest.raises(StaleError):
        queue.move(b.id, b.id)


@given(st.lists(st.tuples(st.integers(0, 4), st.integers(-1, 4)), max_size=80))
@settings(max_examples=30, deadline=None)
def test_moves_give_the_order_of_a_list(tmp_path_factory, moves):
    database = Database(tmp_path_factory.mktemp("queue"))
    queue = Queue(database)
    ids = [queue.submit(wanted(f"s{number}"), "anna").id for number in range(5)]
    for which, before in moves:
        moved, target = sorted(ids)[which], None if before < 0 else sorted(ids)[before]
        if moved == target:
            continue
        queue.move(moved, target)
        ids.remove(moved)
        ids.insert(len(ids) if target is None else ids.index(target), moved)
    assert [each.id for each in queue.waiting()] == ids
    database.close()


def test_a_change_of_an_item_seen_in_an_older_version_is_refused(queue):
    item = queue.submit(wanted(), "anna")
    queue.hold(item.id, "anna", item.version)
    with pytest.raises(StaleError, match="changed meanwhile"):
        queue.cancel(item.id, "boris", item.version)
    assert queue.item(item.id).state is ItemState.HELD


def test_an_item_that_has_begun_cannot_be_cancelled_or_moved(queue):
    item = queue.submit(wanted(), "anna")
    queue.change(item.id, [ItemState.QUEUED], state=ItemState.RUNNING)
    for change in (lambda: queue.cancel(item.id, "anna"), lambda: queue.move(item.id, None)):
        with pytest.raises(StaleError):
            change()


@pytest.mark.parametrize("text", ["../smoke", "smoke/../x", "a b", "", "-x", "smoke\n", "ａ"])
def test_a_name_that_could_be_a_path_or_an_option_is_refused(text):
    with pytest.raises(ValidationError):
        wanted(text)


def test_a_value_cannot_become_an_option():
    options = wanted(order="--unattended", operator="-x", units={"a": "--help"}).options()
    assert options[:2] == ["--operator=-x", "--order=--unattended"]
    assert options[-1] == "--uut=a=--help"


def test_a_second_station_of_a_folder_is_refused(tmp_path, queue):
    with pytest.raises(InUseError, match="another station"):
        Database(tmp_path)


def test_the_first_item_that_may_begin_is_next(queue):
    queue.submit(wanted("later", not_before=NOW + timedelta(hours=1)), "anna")
    queue.submit(wanted("held"), "anna", held=True)
    queue.submit(wanted("now"), "anna")
    assert next_item(queue.waiting(), NOW).submission.sequence == "now"
    assert next_item(queue.waiting(), NOW + timedelta(hours=2)).submission.sequence == "later"


def item(number, state=ItemState.QUEUED, expected_s=3600.0, **more):
    made = {key: more.pop(key) for key in ("begun_at",) if key in more}
    return Item(
        id=str(number), number=number, state=state, priority=0, place=number, submission=wanted(**more),
        submitted_by="anna", submitted_at=NOW, expected_s=expected_s, **made,
    )  # fmt: skip


def test_begin_and_end_are_those_of_the_items_before():
    hour = timedelta(hours=1)
    found = expected(
        [
            item(1, ItemState.RUNNING, begun_at=NOW - hour / 2),
            item(2, speed="60"),
            item(3, ItemState.HELD),
            item(4, not_before=NOW + 5 * hour),
            item(5),
        ],
        NOW,
    )
    overhead = timedelta(seconds=OVERHEAD_S)
    assert found["1"].ends == NOW + hour / 2 + overhead
    assert (found["2"].begins, found["2"].ends) == (found["1"].ends, found["1"].ends + hour / 60 + overhead)
    assert "3" not in found
    assert found["4"].begins == NOW + 5 * hour
    assert found["5"].begins == found["4"].ends


def test_a_run_that_takes_longer_than_expected_ends_now_at_the_earliest():
    found = expected([item(1, ItemState.RUNNING, begun_at=NOW - timedelta(days=1))], NOW)
    assert found["1"].ends == NOW


@pytest.mark.lengthy
def test_kill_9_loses_no_item_that_was_answered(tmp_path):
    script = textwrap.dedent("""
        import sys
        from pathlib import Path
        from bench.station.storage.database import Database
        from bench.station.queue.items import Submission
        from bench.station.queue.table import Queue
        queue = Queue(Database(Path(sys.argv[1])))
        while True:
            item = queue.submit(Submission(sequence="smoke", bench="demo"), "anna")
            print(item.id, flush=True)
            queue.hold(item.id, "anna")
            queue.cancel(item.id, "anna")
    """)
    answered = []
    for _ in range(3):
        with subprocess.Popen(
            [sys.executable, "-c", script, str(tmp_path)], stdout=subprocess.PIPE, text=True
        ) as writer:
            answered += [writer.stdout.readline().strip() for _ in range(40)]
            os.kill(writer.pid, signal.SIGKILL)
    database = Database(tmp_path)
    known = {each.id for each in Queue(database).items()}
    assert len(answered) == 120
    assert set(answered) <= known
    database.close()
