"""Where guardians write in these tests, and the bench that they look after."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from bench.config.models import BenchFile
from bench.guardian import follow as module
from bench.guardian.follow import Follower, Following, guardian_of
from bench.runner.held import Owner
from drivers.transport.wires import RealWires
from tests.support.guarded import Ends, FakeChamber, at, guarded


@pytest.fixture(autouse=True)
def state(own_state) -> Path:
    """The records of this user."""
    return own_state


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


@pytest.fixture
def chamber(monkeypatch) -> FakeChamber:
    """The chamber of the bench, at 60 °C."""
    found = FakeChamber(at(60.0, 60.0))

    def device_of(role: str, entry: object, wires: object) -> FakeChamber:
        assert (role, getattr(entry, "driver", ""), type(wires)) == ("chamber", "watlow_f4t", RealWires)
        return found

    monkeypatch.setattr(module, "device_of", device_of)
    return found


@pytest.fixture
def clock(monkeypatch) -> list[float]:
    """The time of supervisions in s."""
    now = [0.0]

    class At:
        def elapsed_s(self) -> float:
            return now[0]

    monkeypatch.setattr(module, "Stopwatch", At)
    return now


@pytest.fixture
def follower(run, monkeypatch) -> Follower:
    monkeypatch.setattr(module, "_pause", lambda _s: None)
    return guardian_of(run, 7)


@pytest.fixture
def held(follower, bench, chamber, clock) -> Following:
    following = Following(follower, bench, [], ["chamber"])
    following._ends = Ends()
    return following


@pytest.fixture
def sent(follower, bench, chamber, clock) -> Following:
    """Supervision of a chamber that was commanded to 25 °C."""
    chamber.now = at(60.0, 25.0)
    following = Following(follower, bench, ["supply", "chamber"])
    following._ends = Ends()
    return following


@pytest.fixture
def others(monkeypatch) -> list[set[Owner]]:
    """Who else has the address, of each time that is asked; the last one remains."""
    found: list[set[Owner]] = [set()]
    monkeypatch.setattr(module, "owners", lambda _addresses: found.pop(0) if len(found) > 1 else found[0])
    return found
