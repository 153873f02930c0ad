"""Where guardians write in these tests, and the bench that they look after."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from bench.config.models import BenchFile
from tests.support.guarded import guarded


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch) -> Path:
    """The records of this user."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state" / "inertial-test-bench"


@pytest.fixture
def run(tmp_path) -> Path:
    """The directory of a run."""
    folder = tmp_path / "a run"
    folder.mkdir()
    return folder


@pytest.fixture
def bench(tmp_path) -> BenchFile:
    """The bench, of which nothing answers by itself; its alert program writes its title and text to a file."""
    told = tmp_path / "told.txt"
    return guarded(tmp_path, f"alert: {{exec: [/bin/sh, -c, 'echo \"$0\" >> {told}; cat >> {told}']}}\n")


@pytest.fixture
def told(tmp_path):
    """Return what the alert program has told a person."""
    path = tmp_path / "told.txt"
    return lambda: path.read_text("utf-8") if path.exists() else ""


@pytest.fixture
def entries(run):
    """Return the entries of a file of the run, without what every entry has."""

    def read(file: str) -> list[dict[str, Any]]:
        lines = (run / file).read_text("utf-8").splitlines() if (run / file).exists() else []
        every = {"at", "boot", "up_s", "run"}
        return [{key: value for key, value in json.loads(line).items() if key not in every} for line in lines]

    return read
