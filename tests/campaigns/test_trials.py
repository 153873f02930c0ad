"""A sample of the trials of records; all of them are run by `python -m campaigns.trials --only record`."""

import pytest

from campaigns.trials import record


@pytest.fixture(autouse=True)
def ledger_of_its_own(tmp_path, monkeypatch):
    """Runs of one second have one name, and those of other tests may be among them."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "itb-state-records"))


def test_altered_records_are_never_called_as_written(tmp_path):
    row = record.altered(tmp_path, 8)
    assert row.ok, row.result


def test_killed_writers_lose_nothing_that_was_acknowledged(tmp_path):
    row = record.killed(tmp_path, 2)
    assert row.ok, row.result


def test_a_power_cut_loses_nothing_that_was_acknowledged(tmp_path):
    row = record.cut(tmp_path, 2)
    assert row.ok, row.result
