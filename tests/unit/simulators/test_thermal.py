import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from simulators.physics import thermal
from simulators.physics.thermal import ChamberPhysics, Thermal, UnitPhysics

CHAMBER = ChamberPhysics()
STILL = ChamberPhysics(limit_cycle_c=0.0)
UNIT = UnitPhysics(case_s=180, sensor_s=60, self_heating_c=5, thermometer_s=20)
IMU = UnitPhysics(case_s=900, sensor_s=240, self_heating_c=3, thermometer_s=20)
Command = tuple[float, Callable[[Thermal], None]]


def worked_out(
    commands: Sequence[Command],
    looks_s: Sequence[float],
    units: tuple[UnitPhysics, ...] = (UNIT,),
    chamber: ChamberPhysics = CHAMBER,
) -> np.ndarray:
    """Air, and sensor and thermometer of each unit, at the times of the looks."""
    world = Thermal(chamber, units, cycle_phase_rad=0.3)
    seen, waiting = [], list(commands)
    for at_s in looks_s:
        while waiting and waiting[0][0] <= at_s:
            world.advance(waiting[0][0])
            waiting.pop(0)[1](world)
        world.advance(at_s)
        of_units = [read(n) for n in range(len(units)) for read in (world.sensor_c, world.thermometer_c)]
        seen.append([world.air_c, *of_units])
    return np.array(seen)


# Beside a general solver


def test_ramps_kinks_and_power_steps_are_what_a_general_solver_finds() -> None:
    """Set points: 20 → 50 at 3 °C/min from 100 s, turned round at 400 s (35 °C) down to 30 °C, jump to 40 °C."""
    looks = [50.0, 100, 250, 399.999, 400, 500, 700, 701.5, 1000, 1200, 1300, 2000, 4000]
    found = worked_out(
        [
            (100, lambda world: world.ramp(50, 3 / 60)),
            (250, lambda world: world.power(0, True)),
            (400, lambda world: world.ramp(30, 1 / 60)),
            (1000, lambda world: world.ramp(40, math.inf)),
            (1200, lambda world: world.power(1, True)),
            (1300, lambda world: world.power(0, False)),
        ],
        looks,
        units=(UNIT, IMU),
    )
    corners = [0, 100, 250, 400, 700, 1000, 1200, 1300, 4000]  # at 700 s the second ramp has arrived

    def set_point(at_s: float) -> float:
        return float(np.interp(at_s, [0, 100, 400, 700, 1000, 1000], [20, 20, 35, 30, 30, 40]))

    def slopes(at_s: float, state: np.ndarray, middle_s: float) -> list[float]:
        air, air_rate, *chain = state
        omega, turn = 2 * math.pi / 360, 2 * math.pi / 90
        wanted = 40.0 if middle_s > 1000 else set_point(at_s)
        around = air + 0.2 * math.sqrt(2) * math.cos(turn * at_s + 0.3)
        heating = [5.0 if 250 < middle_s < 1300 else 0.0, 3.0 if middle_s > 1200 else 0.0]
        found = [air_rate, omega**2 * (wanted - air) - 2 * 0.5 * omega * air_rate]
        for unit, heated, (case, sensor, reading) in zip((UNIT, IMU), heating, (chain[:3], chain[3:]), strict=True):
            found += [
                (around - case + heated) / unit.case_s, (case - sensor) / unit.sensor_s,
                (sensor - reading) / unit.thermometer_s,
            ]  # fmt: skip
        return found

    state = np.array([20.0, 0] + [20.0] * 6)
    expected = {}
    for begin, end in itertools.pairwise(corners):
        inside = [at_s for at_s in looks if begin <= at_s < end] + [end]
        solved = solve_ivp(
            slopes, (begin, end), state, "DOP853", t_eval=inside, rtol=1e-12, atol=1e-12, args=((begin + end) / 2,)
        )
        for at_s, column in zip(inside, solved.y.T, strict=True):
            air, _, _, sensor, reading, _, second_sensor, second_reading = column
            around = air + 0.2 * math.sqrt(2) * math.cos(2 * math.pi / 90 * at_s + 0.3)
            expected[at_s] = [around, sensor, reading, second_sensor, second_reading]
        state = solved.y[:, -1]
    assert np.abs(found - np.array([expected[at_s] for at_s in looks])).max() < 1e-8


@pytest.mark.parametrize("part_of_a_s", [1e-3, 1.0, 100.0])
@pytest.mark.parametrize("unit", [UNIT, IMU, UnitPhysics(0.01, 0.002, 5, 0.05, board_s=300)], ids=str)
def test_the_exponential_is_that_of_scipy(unit, part_of_a_s) -> None:
    matrix = thermal._system(CHAMBER, (unit, unit)) * part_of_a_s
    found, expected = thermal.exponential(matrix), expm(matrix)
    assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()


def test_a_matrix_without_effect_has_unity_for_its_exponential() -> None:
    assert (thermal.exponential(np.zeros((3, 3))) == np.eye(3)).all()


def test_how_often_somebody_looks_changes_nothing() -> None:
    commands = [(60.0, lambda world: world.ramp(-40, 3 / 60)), (500.0, lambda world: world.power(0, True))]
    ends = [3600.0, 36_000.0]
    looks = sorted({*ends, *np.random.default_rng(4).integers(0, 36_000_000, 3000) / 1000})
    often = dict(zip(looks, worked_out(commands, looks), strict=True))
    assert np.abs(worked_out(commands, ends) - np.array([often[at_s] for at_s in ends])).max() < 1e-9


def test_a_look_between_two_milliseconds_sees_the_nearest() -> None:
    world = Thermal(CHAMBER, (UNIT,), 0.0)
    world.ramp(50, 3 / 60)
    world.advance(10.0004)
    before = world.air_c
    assert world.now_s == 10.0
    world.advance(10.0)  # time that has been worked out stays so
    assert world.air_c == before
    world.advance(10.0006)
    assert world.now_s == 10.001


def test_more_intervals_than_are_kept_are_still_right(monkeypatch) -> None:
    monkeypatch.setattr(thermal, "PROPAGATORS_KEPT", 10)
    commands = [(0.0, lambda world: world.ramp(50, 3 / 60))]
    looks = np.cumsum(np.arange(1, 101) / 10).tolist()
    assert worked_out(commands, looks)[-1] == pytest.approx(worked_out(commands, looks[-1:])[0], abs=1e-9)


# The set point


def test_the_set_point_ramps_and_arrives() -> None:
    world = Thermal(STILL, (), 0.0)
    world.advance(30)
    world.ramp(50, 3 / 60)
    world.advance(90)
    assert world.set_point_c == pytest.approx(23)
    world.ramp(20, 1 / 60)
    world.advance(150)
    assert world.set_point_c == pytest.approx(22), "a new ramp starts from the active set point"
    world.advance(400)
    assert world.set_point_c == 20
    world.ramp(20, 1 / 60)
    world.advance(500)
    assert world.set_point_c == 20


def test_a_ramp_that_ends_between_milliseconds_arrives() -> None:
    world = Thermal(STILL, (), 0.0)
    world.ramp(20.0001, 3 / 60 / 7)
    assert 0.0139 < 0.0001 / (3 / 60 / 7) < 0.0141
    world.advance(0.02)
    assert world.set_point_c == 20.0001


# What a night depends on


def test_long_after_everything_the_unit_is_warmer_than_the_air_by_its_own_heat() -> None:
    after = worked_out([(0, lambda world: world.ramp(60, 3 / 60)), (0, lambda world: world.power(0, True))], [1e5],
                       chamber=STILL)  # fmt: skip
    assert after[0] == pytest.approx([60, 65, 65], abs=1e-9)
    off = worked_out([(0, lambda world: world.power(0, True)), (5e4, lambda world: world.power(0, False))], [1e5],
                     chamber=STILL)  # fmt: skip
    assert off[0] == pytest.approx([20, 20, 20], abs=1e-9)


def test_the_heat_of_one_unit_is_not_that_of_another() -> None:
    after = worked_out([(0, lambda world: world.power(1, True))], [1e5], units=(UNIT, IMU), chamber=STILL)
    assert after[0] == pytest.approx([20, 20, 20, 23, 23], abs=1e-9)


def test_the_air_overshoots_a_step_of_ten_degrees_by_about_one_and_a_half() -> None:
    looks = np.arange(0, 3600.0, 5)
    jump = worked_out([(0, lambda world: world.ramp(30, math.inf))], looks, chamber=STILL)
    assert jump[:, 0].max() - 30 == pytest.approx(10 * math.exp(-math.pi * 0.5 / math.sqrt(1 - 0.25)), rel=1e-3)
    ramped = worked_out([(0, lambda world: world.ramp(30, 3 / 60))], looks, chamber=STILL)
    assert 0.9 < ramped[:, 0].max() - 30 < 1.1, "less when it is ramped"
    assert 29.99 < ramped[:, 1].max() < 30.05, "and hardly at all in the unit"


def test_the_limit_cycle_has_the_given_size_and_reaches_the_sensor_smoothed() -> None:
    seen = worked_out([], np.arange(36_000, 36_000 + 900, 0.5))
    assert np.std(seen[:, 0]) == pytest.approx(0.2, rel=1e-6)
    assert seen[:, 0].mean() == pytest.approx(20, abs=1e-9)
    turn = 2 * math.pi / 90
    passed = 1 / math.hypot(1, turn * 180) / math.hypot(1, turn * 60)
    assert np.std(seen[:, 1]) == pytest.approx(0.2 * passed, rel=1e-6)
    assert np.std(seen[:, 2]) == pytest.approx(0.2 * passed / math.hypot(1, turn * 20), rel=1e-6)


def test_the_limit_cycle_does_not_grow_in_a_week() -> None:
    world = Thermal(CHAMBER, (UNIT,), 0.0)
    for _ in range(7 * 86_400 // 10):
        world.advance(world.now_s + 10)
    last = []
    for _ in range(90):
        world.advance(world.now_s + 1)
        last.append(world.air_c)
    assert np.std(last) == pytest.approx(0.2, rel=1e-6)


def test_the_rate_of_the_sensor_is_its_slope() -> None:
    world = Thermal(STILL, (UNIT, IMU), 0.0)
    world.ramp(50, 3 / 60)
    world.advance(300)
    before, slope = world.sensor_c(1), world.sensor_rate_c_per_s(1)
    world.advance(300.002)
    assert (world.sensor_c(1) - before) / 0.002 == pytest.approx(slope, rel=1e-4)


def test_no_time_has_no_propagator() -> None:
    with pytest.raises(ValueError, match="no time passes"):
        thermal._power([np.eye(2)], 0)
