"""The angle that a move goes to, from where the last one went."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.sequence.steps.stimulus import THERE_DEG, TURN_DEG, Move
from drivers.schema.fields import DEFERRED

ANGLES = st.floats(-2000, 2000)


def move(**keys) -> Move:
    return Move.model_validate({"move": "head", **{key: text(value) for key, value in keys.items()}})


def text(value):
    return f"{value!r}°" if isinstance(value, float) else value


@pytest.mark.parametrize(
    ("way", "to_deg", "from_deg", "target_deg"),
    [
        ("as_written", 90.0, 1000.0, 90.0),
        ("as_written", 450.0, 0.0, 450.0),
        ("nearest", 90.0, 0.0, 90.0),
        ("nearest", 270.0, 0.0, -90.0),
        ("nearest", 0.0, 350.0, 360.0),
        ("nearest", 350.0, 0.0, -10.0),
        ("nearest", -10.0, 720.0, 710.0),
        ("nearest", 180.0, 0.0, 180.0),  # both ways are as long: up
        ("nearest", 0.0, 180.0, 360.0),
        ("increasing", 90.0, 0.0, 90.0),
        ("increasing", 90.0, 100.0, 450.0),
        ("increasing", 0.0, -5.0, 0.0),
        ("increasing", 0.0, 725.0, 1080.0),
        ("decreasing", 90.0, 100.0, 90.0),
        ("decreasing", 90.0, 0.0, -270.0),
        ("decreasing", 0.0, -5.0, -360.0),
        ("nearest", 90.0, 450.0, 450.0),
        ("increasing", 90.0, 450.0, 450.0),
        ("decreasing", 90.0, 450.0, 450.0),
        ("increasing", 0.0, 0.0003, 0.0),  # there already, but for an arc second
        ("decreasing", 0.0, -0.0003, 0.0),
        ("increasing", 0.0, 0.02, 360.0),
    ],
)
def test_an_angle_is_reached_by_its_way(way, to_deg, from_deg, target_deg):
    assert move(to=to_deg, way=way).target_deg(from_deg) == pytest.approx(target_deg, abs=1e-9)


@pytest.mark.parametrize(
    ("by_deg", "from_deg", "target_deg"), [(90.0, 0.0, 90.0), (-90.0, 30.0, -60.0), (720.0, 5.0, 725.0)]
)
def test_a_relative_move_goes_on_from_where_the_last_one_went(by_deg, from_deg, target_deg):
    assert move(by=by_deg).target_deg(from_deg) == target_deg


@pytest.mark.parametrize("keys", [{"to": "${a}"}, {"to": "${a}", "way": "nearest"}, {"by": "${a}"}])
def test_an_angle_that_is_not_known_yet_leads_nowhere(keys):
    step = Move.model_validate({"move": "head", **keys}, context=DEFERRED)
    assert math.isnan(step.target_deg(10.0))


@given(ANGLES, ANGLES, st.sampled_from(["nearest", "increasing", "decreasing"]))
def test_a_way_ends_at_the_angle_but_for_whole_turns_and_goes_no_longer_than_it_must(to_deg, from_deg, way):
    step = move(to=to_deg, way=way)
    target_deg = step.target_deg(from_deg)
    turns = (target_deg - step.to_deg) / TURN_DEG
    assert turns == pytest.approx(round(turns), abs=1e-9)
    way_deg = target_deg - from_deg
    low_deg, high_deg = {"nearest": (-180, 180), "increasing": (0, TURN_DEG), "decreasing": (-TURN_DEG, 0)}[way]
    assert low_deg - THERE_DEG <= way_deg <= high_deg + THERE_DEG


@given(ANGLES, ANGLES, st.sampled_from(["nearest", "increasing", "decreasing"]))
def test_a_move_done_twice_goes_nowhere_the_second_time(to_deg, from_deg, way):
    step = move(to=to_deg, way=way)
    there_deg = step.target_deg(from_deg)
    assert step.target_deg(there_deg) == pytest.approx(there_deg, abs=1e-6)
