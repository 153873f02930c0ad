"""Where records are kept that belong to no single run."""

from __future__ import annotations

import pytest

from bench.store.user_state import state_folder


def test_it_is_where_the_environment_says_and_only_for_the_user(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    assert state_folder() == tmp_path / "state" / "inertial-test-bench"
    assert state_folder().stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize("given", ["", "somewhere/below"])
def test_without_a_folder_of_the_environment_it_is_below_the_home(tmp_path, monkeypatch, given):
    monkeypatch.setenv("XDG_STATE_HOME", given)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert state_folder() == tmp_path / ".local" / "state" / "inertial-test-bench"
