"""Three actors at one queue, processes of runs that begin late or never, and a station that dies."""

import pytest
from hypothesis import settings

from tests.support.queue_history import faults_of_items
from tests.support.queue_machine import QueueMachine

QueueMachine.TestCase.settings = settings(max_examples=60, stateful_step_count=30, deadline=None)
TestHistories = pytest.mark.lengthy(QueueMachine.TestCase)


def item(number, state="queued", version=0, run=""):
    return {"id": str(number), "number": number, "state": state, "version": version, "run": run}


@pytest.mark.parametrize(
    ("now", "fault"),
    [
        ([], "is gone"),
        ([item(1, "held", 1)], "in version 2, and is in version 1"),
        ([item(1, "queued", 2)], "is queued in the same version"),
        ([item(1, "held", 2), item(1, "held", 2)], "listed 2 times"),
        ([item(1, "held", 3)], ""),
        ([item(1, "ended", 5, "r")], ""),
    ],
)
def test_an_item_is_there_once_as_it_was_answered_or_later(now, fault):
    found = " ".join(faults_of_items({"1": item(1, "held", 2)}, now))
    assert fault in found
    assert bool(fault) == bool(found)


def test_an_item_that_was_cancelled_or_runs_is_not_queued_again():
    for state in ("cancelled", "running"):
        assert list(faults_of_items({"1": item(1, state, 2)}, [item(1, "queued", 3)]))
    assert list(faults_of_items({"1": item(1, "running", 2, "r")}, [item(1, "ended", 3, "s")]))
