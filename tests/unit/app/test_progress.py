"""The one line that a person sees while a run goes on."""

from __future__ import annotations

import asyncio
import math
import sys
from datetime import UTC, datetime

import pytest

from bench.app.request import RunRequest, load_checked
from bench.clock import Clock
from bench.loop import run
from bench.quality import Invalid, Valid
from bench.runner.progress import TerminalProgress, _day_and_time


@pytest.fixture
def shown(tmp_path, capsys):
    """Progress of the smoke test at real time, a step of its teardown reached, with readings."""
    checked = load_checked(RunRequest("smoke"))
    progress = TerminalProgress(checked.plan, checked.bench, speed=1.0)

    async def begin() -> None:
        await asyncio.sleep(8540.0)  # a computer that has long been on
        progress.run_begins(tmp_path, checked.expected, Clock(datetime(2026, 1, 1, 23, 30, tzinfo=UTC)))

    run(begin(), math.inf)
    steps = list(checked.plan)
    progress.step_begins(steps[4], 4)
    progress.reading("chamber.air", Valid(8551.0, 20.123, 1))
    progress.reading("unit_temperature", Valid(8551.0, 25.0, 1))
    return progress


def test_the_line_has_step_end_and_readings_with_their_units_and_fits(shown):
    line = shown.line(120)
    assert "5/13 steps/temperature=20/position=0/acquire" in line
    assert " s to go" in line
    assert "unit_temperature 25 °C" in line
    for width in (45, 60, 80, 100):
        assert len(shown.line(width)) <= width


def test_bench_time_counts_from_the_beginning_of_the_run(shown):
    assert shown.now_s == 11.0


def test_on_a_narrow_terminal_the_end_of_a_long_step_is_kept(shown):
    assert "position=0/acquire" in shown.line(50)


def test_a_held_run_says_who_holds_it_until_it_goes_on(shown):
    shown.held("operator")
    assert shown.line(80).startswith("HELD by the operator")
    shown.held("")
    assert "HELD" not in shown.line(80)


@pytest.mark.parametrize(("later_s", "reported"), [(600, "01:10"), (23.5 * 3600, "Sat 00:30")])
def test_the_end_is_by_the_clock_of_the_bench_with_the_day_when_it_is_another(later_s, reported):
    now = datetime(2026, 1, 2, 0, 0, tzinfo=UTC)  # 01:00 on Friday in Berlin
    assert _day_and_time(now, later_s, "Europe/Berlin") == reported


def test_what_is_invalid_or_stale_is_shown_first_and_without_a_number(shown):
    shown.reading("unit_temperature", Invalid(8552.0, "was read as not-a-number", 3, "nan"))
    assert shown.live()[0] == "unit_temperature invalid: was read as not-a-number"
    shown.reading("unit_temperature", Valid(8553.0, 25.1, 4))
    assert shown.live()[0] == "unit_temperature 25.1 °C"
    shown.reading("chamber.air", Valid(8600.0, 20.0, 5))
    assert shown.live()[0] == "unit_temperature stale: 47 s old"


def test_on_a_terminal_a_bar_is_drawn_and_notices_stand_above_it(capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    checked = load_checked(RunRequest("smoke"))
    with TerminalProgress(checked.plan, checked.bench) as progress:
        progress.notice("Something happened.")
        progress.step_ended(next(iter(checked.plan)), 0)
    drawn = capsys.readouterr().err
    assert "0%" in drawn
    assert "opening the bench" in drawn
    assert "Something happened.\n" in drawn


def test_without_a_terminal_notices_are_lines(capsys):
    checked = load_checked(RunRequest("smoke"))
    with TerminalProgress(checked.plan, checked.bench) as progress:
        progress.notice("Something happened.")
    assert capsys.readouterr().err == "Something happened.\n"
