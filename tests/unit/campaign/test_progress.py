"""Progress of a campaign, and its likely end."""

from datetime import UTC, datetime, timedelta

import pytest

from bench.campaign import progress
from bench.campaign.progress import Pace, Progress
from bench.campaign.tasks import Result, Task
from bench.clock import Stopwatch

NOW = datetime(2026, 1, 1, 12, 0, tzinfo=UTC)


@pytest.fixture
def now(monkeypatch):
    """A present instant, 100 s after the begin of the campaign."""
    monkeypatch.setattr(progress, "wall_utc", lambda: NOW)
    monkeypatch.setattr(Stopwatch, "elapsed_s", lambda _: 100.0)


def tasks(*sorts):
    return [Task(f"{number}", "m:f", {}, sort) for number, sort in enumerate(sorts)]


def known(took_s):
    def find(task):
        found = took_s.get(task.key)
        return None if found is None else Result(task.key, task.digest, "", 1, "", found, "", "")

    return find


@pytest.mark.usefixtures("now")
def test_the_end_is_by_how_long_tasks_of_each_sort_take_and_by_how_many_are_done_at_a_time():
    pace = Pace()
    for took_s in (10.0, 190.0):  # two workers for 100 s
        pace.add(took_s)
    every = tasks("short", "long", "short", "short", "long")
    found = pace.progress(every, known({"0": 10.0, "1": 190.0}), 2)
    assert (found.finished, found.tasks, found.workers) == (2, 5, 2)
    assert found.ends == NOW + timedelta(seconds=(10 + 10 + 190) / 2)


def test_the_end_stays_while_nothing_arrives_and_is_not_in_the_past(monkeypatch):
    elapsed_s = [100.0]
    monkeypatch.setattr(Stopwatch, "elapsed_s", lambda _: elapsed_s[0])
    monkeypatch.setattr(progress, "wall_utc", lambda: NOW + timedelta(seconds=elapsed_s[0]))
    pace, every = Pace(), tasks("a", "a")
    pace.add(100.0)
    for elapsed_s[0], end_s in ((100.0, 200.0), (150.0, 200.0), (300.0, 300.0)):
        assert pace.progress(every, known({"0": 100.0}), 1).ends == NOW + timedelta(seconds=end_s)


@pytest.mark.usefixtures("now")
def test_without_a_result_of_this_session_there_is_no_end():
    assert Pace().progress(tasks("a", "a"), known({"0": 3.0}), 2).ends is None


@pytest.mark.usefixtures("now")
def test_a_failure_is_counted_apart_and_a_missing_worker_is_told():
    every = tasks("a", "a")
    failed = Result("0", every[0].digest, "", None, "no space", 1.0, "", "")
    found = Pace().progress(every, lambda task: failed if task is every[0] else None, 0)
    assert found == Progress(0, 1, 2, 0, None)
    assert "0 of 2 done, 1 failed, no worker: waiting for one" in found.in_words()


@pytest.mark.usefixtures("now")
def test_an_end_on_another_day_has_its_date():
    local = NOW.astimezone()
    assert Progress(1, 0, 2, 2, NOW).in_words().endswith(f"2 workers, end about {local:%H:%M}")
    later = (NOW + timedelta(days=2)).astimezone()
    assert Progress(1, 0, 2, 2, NOW + timedelta(days=2)).in_words().endswith(f"{later:%Y-%m-%d %H:%M}")
