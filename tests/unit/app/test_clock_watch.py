"""Steps of the computer's clock, and its sleep, between two looks."""

from __future__ import annotations

import pytest

from bench.app.execute import execute
from bench.app.request import RunRequest, prepare
from bench.clock import ClockWatch
from bench.runner.quiet import Quiet
from bench.store.reader import RunReader
from tests.support.runs import ROOT, read_json


@pytest.mark.parametrize(
    ("wall_s", "boot_s", "awake_s", "found"),
    [
        (100.0, 100.0, 100.0, (0.0, 0.0)),
        (100.05, 100.0, 100.0, (0.0, 0.0)),  # made faster, to keep it in step
        (3700.0, 100.0, 100.0, (3600.0, 0.0)),
        (-3500.0, 100.0, 100.0, (-3600.0, 0.0)),
        (100.0, 100.0, 40.0, (0.0, 60.0)),
        (102.0, 100.0, 40.0, (2.0, 60.0)),
    ],
)
def test_what_happened_between_two_looks(monkeypatch, wall_s, boot_s, awake_s, found):
    now = [(1e9, 5.0, 5.0), (1e9 + wall_s, 5.0 + boot_s, 5.0 + awake_s)]
    monkeypatch.setattr(ClockWatch, "_now", staticmethod(lambda: now.pop(0)))
    assert ClockWatch().look() == pytest.approx(found)


def test_a_step_is_in_the_record_and_the_end_is_not_before_the_start(tmp_path, monkeypatch):
    class SetsTheClock(Quiet):
        def step_begins(self, *_):
            monkeypatch.setattr("bench.clock.time.time", lambda: real() - 7200)

    from bench.clock import time

    real, observer = time.time, SetsTheClock()
    result = execute(prepare(RunRequest("smoke", bench=str(ROOT / "config/simulated.yaml"), runs=tmp_path)), observer)
    (step,) = read_json(result, "manifest.json")["clock_steps"]
    assert step["set_by_s"] == pytest.approx(-7200, abs=1)
    with RunReader(result.path) as reader:
        assert [event.data["set_by_s"] for event in reader.events("clock_step")] == [step["set_by_s"]]
    assert any("The computer's clock was set by -7200.0 s." in text for text in observer.notices)
    manifest = read_json(result, "manifest.json")
    assert manifest["started"] <= manifest["ended"]
    assert "clock was set by -7200" in (result.path / "report.html").read_text("utf-8")
