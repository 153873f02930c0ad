"""The way of the air of a chamber to its safe set point, as looks far apart show it."""

from __future__ import annotations

import pytest

from drivers.kinds.chamber.arrival import Arrival
from drivers.kinds.chamber.description import FollowOptions, TemperatureRange
from drivers.values import ChamberState

FOLLOW, LIMITS = FollowOptions(), TemperatureRange.model_validate({"min": "-50 °C", "max": "100 °C"})
SAFE_C, EVERY_S = 25.0, 30.0


def arrival() -> Arrival:
    return Arrival(SAFE_C, FOLLOW, LIMITS)


def at(air_c: float, set_point_c: float = SAFE_C, target_c: float = SAFE_C) -> ChamberState:
    return ChamberState(air_c, set_point_c, target_c)


def first_problem(states: list[ChamberState]) -> tuple[float, str]:
    """When something is wrong first, and what; at the last look, and "" where nothing is."""
    watch, at_s = arrival(), 0.0
    for number, state in enumerate(states):
        at_s = number * EVERY_S
        if found := watch.problem(at_s, state):
            return at_s, found
    return at_s, ""


@pytest.mark.parametrize(("air_c", "set_point_c", "arrived"), [
    (25.0, 25.0, True), (27.9, 25.0, True), (28.1, 25.0, False), (25.0, 26.0, False), (22.0, 25.2, True),
])  # fmt: skip
def test_it_has_arrived_when_set_point_and_air_are_there(air_c, set_point_c, arrived):
    assert arrival().has_arrived(at(air_c, set_point_c)) is arrived


def test_air_that_comes_nearer_slowly_is_on_its_way():
    looks = round(3 * 3600 / EVERY_S)
    assert first_problem([at(60.0 - 0.12 * number * EVERY_S / 60) for number in range(looks)])[1] == ""


def test_air_that_stays_where_it_is_does_not_arrive():
    at_s, why = first_problem([at(60.0)] * 100)
    assert at_s == FOLLOW.over
    assert why == "the air has not come 1 °C closer to its set point within 10 min; it is at 60.0 °C"


def test_air_that_runs_away_does_not():
    assert "moves away" in first_problem([at(60.0 + number) for number in range(100)])[1]


def test_a_set_point_of_somebody_else_is_named():
    assert first_problem([at(60.0), at(60.0, 60.0, 70.0)]) == (
        EVERY_S, "the set point was changed by another master from 25 °C to 70 °C",
    )  # fmt: skip


def test_a_set_point_that_creeps_with_its_air_is_bounded_in_time():
    """Air that is always in the band of an active set point breaks no rule but that of time."""
    longest_s = arrival().longest_s(at(30.0))
    assert longest_s == 5 * FOLLOW.over + FOLLOW.settle
    creeping = [30.0 - 1e-4 * number for number in range(1000)]
    at_s, why = first_problem([at(air_c, air_c) for air_c in creeping])
    assert at_s == longest_s + EVERY_S
    assert "should have been at 25 °C by now" in why


def test_air_that_has_arrived_is_never_late():
    assert first_problem([at(25.0)] * 1000)[1] == ""
