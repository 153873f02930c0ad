"""The course of a chamber after a run, look by look."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.config.bench import load_bench
from bench.guardian.course import GONE_S, Course
from drivers.values import ChamberState
from tests.support.runs import copy_bench

SHIPPED = Path(__file__).parents[3] / "config/simulated.yaml"
SAFE_C, HOT_C = 25.0, 60.0


def course(tmp_path: Path, hold: str = "") -> Course:
    edited = copy_bench(tmp_path, ("safe: {temperature: 25 °C}", f"safe: {{temperature: 25 °C{hold}}}"))
    bench = load_bench(edited).bench
    return Course(bench.devices["chamber"], 0.0, held=bool(hold))


def state(air_c: float, target_c: float = SAFE_C) -> ChamberState:
    return ChamberState(air_c, target_c, target_c)


def events(of: Course) -> list[str]:
    return [each.event for each in of.noted]


def test_air_that_is_there_has_arrived_at_once(tmp_path):
    found = course(tmp_path)
    found.seen(1.0, state(25.1))
    assert events(found) == ["arrived"]
    assert found.is_over


def test_air_that_comes_nearer_arrives_hours_later(tmp_path):
    found = course(tmp_path)
    for minute in range(200):
        if found.is_over:
            break
        found.seen(60.0 * minute, state(max(SAFE_C, HOT_C - 0.5 * minute)))
    assert events(found) == ["arrived"], found.noted
    assert minute == pytest.approx(64, abs=5)  # within the band of 3 °C


def test_air_that_stays_away_has_not_arrived(tmp_path):
    found = course(tmp_path)
    for minute in range(24 * 60):
        if found.is_over:
            break
        found.seen(60.0 * minute, state(HOT_C))
    assert events(found) == ["not_arrived"]
    assert found.noted[0].why


def test_a_set_point_that_somebody_changed_has_not_arrived(tmp_path):
    found = course(tmp_path)
    found.seen(0.0, state(HOT_C))
    found.seen(30.0, state(HOT_C, target_c=80.0))
    assert events(found) == ["not_arrived"]
    assert "the set point was changed by another master from 25 °C to 80 °C" in found.noted[0].why


def test_a_chamber_that_is_gone_for_long_has_not_arrived(tmp_path):
    found = course(tmp_path)
    found.seen(0.0, state(HOT_C))
    found.unseen(GONE_S - 1, "no answer")
    assert not found.is_over
    found.unseen(GONE_S + 1, "no answer")
    assert events(found) == ["not_arrived"]
    assert "could not be read for 10 min: no answer" in found.noted[0].why


def test_a_bench_that_another_program_has_is_handed_over(tmp_path):
    found = course(tmp_path)
    found.hand_over("bench run has taken the bench")
    assert events(found) == ["handed_over"]
    assert found.is_over


def test_a_hold_ends_at_its_time_and_then_the_air_is_on_its_way(tmp_path):
    found = course(tmp_path, ", hold: 30 min")
    assert found.hold_ends_s == 1800.0
    for at_s in range(0, 1800, 30):
        found.seen(float(at_s), state(HOT_C, target_c=HOT_C))
        assert not found.hold_is_over
    found.seen(1800.0, state(HOT_C, target_c=HOT_C))
    assert found.hold_is_over == "the hold time has expired"
    found.commanded(1801.0)
    found.seen(1802.0, state(SAFE_C))
    assert events(found) == ["held", *["reading"] * 60, "hold_ends", "commanded", "arrived"]


def test_each_look_at_a_held_chamber_tells_whether_its_controller_is_switched_off(tmp_path):
    found = course(tmp_path, ", hold: 30 min")
    found.seen(0.0, ChamberState(HOT_C, HOT_C, HOT_C, 35.0))
    found.seen(30.0, ChamberState(HOT_C, HOT_C, HOT_C, 0.0))
    assert [each.from_safe_c for each in found.noted] == [35.0, 0.0]


def test_a_hold_of_a_chamber_that_is_not_in_order_is_over_at_once(tmp_path):
    found = course(tmp_path, ", hold: 30 min")
    found.seen(0.0, state(HOT_C, target_c=HOT_C))
    found.seen(30.0, state(HOT_C, target_c=75.0))
    assert found.hold_is_over == "another master changed the set point from 60 °C to 75 °C"


def test_a_hold_that_cannot_be_looked_at_ends_by_its_time(tmp_path):
    found = course(tmp_path, ", hold: 30 min")
    found.unseen(1000.0, "no answer")
    assert not found.hold_is_over
    assert [(each.event, each.why) for each in found.noted] == [("not_seen", "no answer")]
    found.unseen(1800.0, "no answer")
    assert found.hold_is_over == "the hold time has expired"
    found.unseen(1800.0 + GONE_S + 1, "no answer")
    assert "COULD NOT BE MADE SAFE" in found.noted[-1].why
