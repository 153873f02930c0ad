"""Counters whose bus, or whose counts, go wrong in the middle of an acquisition of a run."""

from pathlib import Path

import pytest

from bench.app.execute import RunResult
from bench.store.reader import RunReader
from drivers.dialects.can_counter.wire import decode_counts
from tests.support.flags import texts
from tests.support.laboratory import counter_form
from tests.support.runs import copy_bench, run_short

AT = "29 s"  # in the second of four acquisitions


def bad(folder: Path, *kinds: str) -> RunResult:
    faults = ", ".join(f"{{device: counter, kind: {kind}, at: {AT}}}" for kind in kinds)
    return run_short(folder / "runs", bench=copy_bench(folder / "config", faults=f"[{faults}]"), sequence="smoke")


def scale(result: RunResult) -> float:
    return next(finding.value for finding in result.results.units[0].findings if finding.quantity == "K1")


def lost(result: RunResult) -> int:
    with RunReader(result.path) as reader:
        block = reader.frames_by_step()["steps/temperature=20/position=180/acquire"]["counter"]
    return decode_counts(counter_form(), "x", block).lost


def noted(result: RunResult) -> list[str]:
    with RunReader(result.path) as reader:
        return [event.data["text"] for event in reader.events("device_note")]


def test_frames_that_are_lost_late_doubled_or_of_others_change_no_result(tmp_path: Path) -> None:
    kinds = ("lost_frames", "lost_bursts", "doubled_frames", "late_frames", "foreign_frames", "short_frames")
    clean, hurt = bad(tmp_path / "clean"), bad(tmp_path / "hurt", *kinds, "error_frames")
    assert hurt.outcome.how == "completed"
    assert scale(hurt) == pytest.approx(scale(clean), rel=2e-5), "a count, where the first or last latch did not come"
    assert lost(clean) == 0
    assert lost(hurt) > 0
    assert noted(clean) == []
    assert noted(hurt) == ["error frames on the bus: 1, protocol violation"]


def test_a_bus_that_goes_off_fails_the_step_and_what_was_measured_before_is_kept(tmp_path: Path) -> None:
    result = bad(tmp_path, "bus_off")
    assert result.outcome.how == "error"
    assert "/position=90/acquire: counter: the adapter is, or was, bus-off" in result.problems[0]
    with RunReader(result.path) as reader:
        assert len([event for event in reader.events("step_ended") if event.step.endswith("/acquire")]) == 1
        assert [event.step for event in reader.events("step_failed")] == ["steps/temperature=20/position=90/acquire"]
    assert "dwell 0 incomplete: 90, 180, 270" in texts(result.results.units[0].flags)


@pytest.mark.parametrize(
    ("kind", "flag"),
    [("swapped_frames", "impossible_rate"), ("stuck_count", "dead_band"), ("cleared_count", "impossible_rate")],
)  # fmt: skip
def test_counts_that_are_wrong_are_marked_and_not_used(tmp_path: Path, kind: str, flag: str) -> None:
    result = bad(tmp_path, kind)
    assert result.outcome.how == "completed"
    flags = texts(result.results.units[0].flags)
    marked = [each for each in flags if each.startswith("steps/temperature=20/position=90/acquire: ")]
    assert flag in " ".join(marked)
    assert not [finding for finding in result.results.units[0].findings if finding.quantity == "K0"]
