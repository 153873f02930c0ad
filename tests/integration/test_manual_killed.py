"""A session of manual control over wires that is killed while an output is on: the guardian makes the bench safe."""

from __future__ import annotations

import json

import pytest

from bench.runner.tell import send_command
from bench.store.latch import latch
from bench.store.runs import summary
from tests.support.energised import SAFE, Process, wires
from tests.support.guardians import guardian_of, has_ended, has_made_safe, until
from tests.support.runs import ROOT

pytestmark = [pytest.mark.integration, pytest.mark.slow]
WITHIN_S = 20.0
ON = {"set": "supply", "voltage": "15 V", "current_limit": "120 mA", "output": "on"}


def test_a_killed_session_leaves_a_safe_bench_and_it_is_on_record(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with wires(tmp_path / "served") as bench:
        text = (ROOT / "sequences/manual.yaml").read_text("utf-8")
        session = Process(bench.bench, tmp_path / "session", text=text)
        session.until_step("steps/custom")
        path, guardian = session.path, guardian_of(session.process.pid)
        assert path is not None
        assert send_command(path, "order", order=json.dumps(ON), by="anna") == "steps/order=1"
        until(lambda: bench.state_of("supply") is True, WITHIN_S)
        session.process.kill()
        session.process.wait(5)
        until(lambda: has_made_safe(path) or has_ended(guardian), WITHIN_S)
        assert bench.state() == SAFE
        found = latch(summary(path))
        assert found is not None
        assert "the process of the run has died" in found.why
        assert {"order", "step_begins"} <= session.kinds()
