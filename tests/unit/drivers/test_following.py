"""When a chamber does not do what a chamber in order does; and that no healthy one is told so, at its limits either."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import pytest

from drivers.kinds.chamber.description import FollowOptions, TemperatureRange
from drivers.kinds.chamber.following import FollowWatch
from simulators.physics.thermal import ChamberPhysics, Thermal
from simulators.units.unit_file import stream

LIMITS = TemperatureRange.model_validate({"min": "-50 °C", "max": "100 °C"})
EVERY_S = 10.0
Look = tuple[float, float, float]


def watch(**options: float) -> FollowWatch:
    return FollowWatch(FollowOptions().model_copy(update=options), LIMITS)


def reported(looks: Iterable[Look], **options: float) -> tuple[float, str] | None:
    """When a watch that took these looks (time, air, set point) first said something, and what."""
    by = watch(**options)
    found = ((at_s, by.problem(at_s, air_c, set_c, commanded=True)) for at_s, air_c, set_c in looks)
    return next(((at_s, text) for at_s, text in found if text), None)


def looks(air: Callable[[float], float], set_point: Callable[[float], float], hours: float) -> list[Look]:
    times = [EVERY_S * number for number in range(int(hours * 3600 / EVERY_S))]
    return [(at_s, air(at_s), set_point(at_s)) for at_s in times]


def test_air_that_stands_outside_the_band_is_told_after_the_time_for_the_gain() -> None:
    assert reported(looks(lambda _: 23.1, lambda _: 20.0, 2)) == (
        600.0, "the air has not come 1 °C closer to its set point within 10 min"
    )  # fmt: skip
    assert reported(looks(lambda _: 23.1, lambda _: 20.0, 2), band=3.2) is None


@pytest.mark.parametrize(("rate_c_per_h", "problem"), [(6.5, False), (5.5, True)])
def test_air_that_comes_nearer_by_the_gain_in_time_is_left_to_come(rate_c_per_h: float, problem: bool) -> None:
    found = reported(looks(lambda at_s: -40 + rate_c_per_h * at_s / 3600, lambda _: 60.0, 6), settle=1e6)
    assert (found is not None) == problem


def test_a_heater_that_dies_in_a_soak_is_told_the_time_for_the_gain_after_the_air_has_left_the_band() -> None:
    found = reported(looks(lambda at_s: 60 - max(0.0, at_s - 3600) / 60, lambda _: 60.0, 3))
    assert found is not None
    assert 3600 + 180 + 600 <= found[0] <= 3600 + 180 + 600 + 2 * EVERY_S


@pytest.mark.parametrize(("set_c", "rate_c_per_min", "passed_c"), [(85.0, 5.0, 8.0), (-40.0, -2.0, 8.0)])
def test_air_that_runs_away_under_power_is_told_at_once(set_c: float, rate_c_per_min: float, passed_c: float) -> None:
    found = reported(looks(lambda at_s: set_c + rate_c_per_min * at_s / 60, lambda _: set_c, 1))
    assert found is not None
    assert "the air moves away from its set point" in found[1]
    assert found[0] <= passed_c / abs(rate_c_per_min) * 60 + 2 * EVERY_S


def test_towards_the_room_the_air_has_the_time_for_the_gain_as_past_an_open_door() -> None:
    def air(at_s: float) -> float:
        return 45 - 12 * min(1.0, max(0.0, at_s - 600) / 120) * (at_s < 600 + 540)

    assert reported(looks(air, lambda _: 45.0, 2)) is None


def test_air_that_swings_in_and_out_of_the_band_has_not_settled_in_time() -> None:
    found = reported(looks(lambda at_s: 60 + 4 * math.sin(at_s / 100), lambda _: 60.0, 3))
    assert found is not None
    assert found[1] == "the air has not settled within 3 °C of its set point for 60 min"
    assert 3600 < found[0] < 3600 + 400


def test_a_disturbance_after_it_had_settled_takes_its_time_too() -> None:
    def air(at_s: float) -> float:
        return 60 + 4 * math.sin(at_s / 100) * (5 * 3600 < at_s < 5.9 * 3600)

    assert reported(looks(air, lambda _: 60.0, 8)) is None


def test_one_impossible_look_is_no_more_than_a_bad_answer_and_two_are_told() -> None:
    def air(at_s: float) -> float:
        return 320.0 if at_s in (100.0, 200.0, 210.0) else 20.0

    found = reported(looks(air, lambda _: 20.0, 1))
    assert found == (210.0, "the process value is far beyond the -50 to 100 °C of the bench")


def test_until_it_was_commanded_the_air_may_be_anywhere_within_the_limits() -> None:
    by = watch()
    assert not any(by.problem(float(at_s), 90.0, 20.0, commanded=False) for at_s in range(0, 7200, 10))
    assert not any(by.problem(float(at_s), 90.0, 20.0, commanded=True) for at_s in range(7200, 7800, 10))


def test_nobody_knows_what_the_air_did_while_nobody_looked() -> None:
    assert reported([(0.0, 30.0, 60.0), (601.0, 30.0, 60.0), (1200.0, 30.0, 60.0)]) is None
    assert reported([(0.0, 30.0, 60.0), (600.0, 30.0, 60.0)]) is not None


def test_a_set_point_that_goes_over_to_the_other_side_begins_the_time_anew() -> None:
    assert reported([(at_s, 40.0, 60.0 if at_s < 590 else 20.0) for at_s in range(0, 1180, 10)]) is None


# Chambers in order

FASTEST_C_PER_MIN = 5.0


def healthy(seed: int) -> tuple[ChamberPhysics, list[tuple[float, float, float]]]:
    """A chamber and its ramps: target, rate in °C/min, and how long it rests afterwards."""
    random = stream(seed, "a chamber in order")
    physics = ChamberPhysics(
        start_c=20.0, natural_period_s=random.uniform(120, 1200), damping=random.uniform(0.35, 1.5),
        limit_cycle_c=random.uniform(0, 0.5), limit_cycle_period_s=random.uniform(30, 300),
    )  # fmt: skip
    ramps = [
        (random.uniform(-50, 100), random.choice([0.2, 1.0, FASTEST_C_PER_MIN]), random.choice([0.0, 60.0, 5400.0]))
        for _ in range(10)
    ]
    return physics, ramps


def looked_at(physics: ChamberPhysics, ramps: Iterable[tuple[float, float, float]]) -> Iterable[Look]:
    thermal, at_s = Thermal(physics, (), 0.3), 0.0
    for target_c, rate_c_per_min, rest_s in ramps:
        end_s = at_s + abs(target_c - thermal.set_point_c) / rate_c_per_min * 60 + rest_s
        thermal.ramp(target_c, rate_c_per_min / 60)
        while at_s < end_s:
            at_s += EVERY_S
            thermal.advance(at_s)
            yield at_s, thermal.air_c, thermal.set_point_c


def test_a_hundred_ramps_of_chambers_slow_and_fast_heavy_and_light_are_no_fault() -> None:
    for seed in range(10):
        assert reported(looked_at(*healthy(seed))) is None, f"seed {seed}"
