"""Filters of runs: a run must match every one."""

from datetime import date

import pytest

from bench.station.view import RunFilter, found_runs
from bench.store.runs import list_runs
from tests.support.stored_results import finding, instant, stored


@pytest.fixture
def runs(tmp_path):
    stored(tmp_path, instant(2020), [finding(0.0)], order="K-77")
    stored(tmp_path, instant(2021), [finding(2.0, verdict="FAIL")], uut="QF-2", bench="Bench B")
    stored(tmp_path, instant(2022), [], uut="QF-22", state="aborted", verdict="ABORTED")
    return list(list_runs(tmp_path))


@pytest.mark.parametrize(
    ("wanted", "years"),
    [
        ({}, ["2020", "2021", "2022"]),
        ({"unit": "QF-2"}, ["2021"]),
        ({"text": "qf-2"}, ["2021", "2022"]),
        ({"text": "k-77 tumble"}, ["2020"]),
        ({"bench": "Bench B"}, ["2021"]),
        ({"state": "aborted"}, ["2022"]),
        ({"verdict": "PASS"}, ["2020"]),
        ({"since": date(2021, 1, 1)}, ["2021", "2022"]),
        ({"since": date(2020, 1, 2), "until": date(2021, 1, 1)}, ["2021"]),
        ({"before": "2021"}, ["2020"]),
        ({"verdict": "FAIL", "bench": "Bench A"}, []),
    ],
)
def test_a_run_is_found_by(runs, wanted, years):
    assert [each.run[:4] for each in found_runs(runs, RunFilter(**wanted), 10)] == years


def test_no_more_are_found_than_asked_for(runs):
    assert len(found_runs(runs, RunFilter(), 2)) == 2
