import dataclasses
import itertools
import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.methods.tumble.reduction.solution import solve_tumble
from simulators.physics.integrator import Integrator
from simulators.physics.noise import Wander, at_ends
from simulators.units.accelerometer import Hysteresis, UnitTruth, draw_unit, noise_of
from simulators.units.course import straight
from simulators.units.unit_file import UnitFile
from tests.support.laboratory import Laboratory, place, unit

PERFECT = draw_unit(unit(), 1, "a")
FOUR = np.radians([0.0, 90, 180, 270])
S = 1e7  # pulse/s/A


def but(**changes: Any) -> UnitTruth:
    """A perfect unit of 1 mA/g, but for the terms given."""
    return dataclasses.replace(PERFECT, **changes)


def current_a(truth: UnitTruth, angle: np.ndarray, temperature_c: float = 20.0, across_g: float = 0.0) -> np.ndarray:
    force = np.sin(angle), np.cos(angle), np.full_like(angle, across_g)
    return truth.current_a(force, np.full_like(angle, temperature_c), np.zeros_like(angle))


def four_points(truth: UnitTruth, temperature_c: float = 20.0) -> tuple[float, float, float, float]:
    """K0 (g), K1 (A/g), misalignment (rad) and K2 (g/g²) from readings at 0°, 90°, 180° and 270°."""
    found = solve_tumble(FOUR, current_a(truth, FOUR, temperature_c))
    return found.k0_g, found.k1, found.misalignment_rad, found.k2_g_per_g2


# The accelerometer, one coefficient at a time


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, (0, 1e-3, 0, 0)),
        ({"bias": (8e-4, 0, 0, 0, 0)}, (8e-4, 1e-3, 0, 0)),
        ({"scale_a_per_g": 1.13e-3}, (0, 1.13e-3, 0, 0)),
        ({"k2": 2e-5}, (0, 1e-3, 0, 2e-5)),
        ({"k3": 5e-6}, (0, 1e-3 * (1 + 5e-6), 0, 0)),  # a four-point tumble sees K1 + K3
        ({"kip": 5e-6}, (0, 1e-3, 0, 0)),  # and no cross coupling, for either factor is 0
        ({"misalignment_o": 3e-4}, (0, 1e-3, 3e-4, 0)),
        ({"misalignment_p": -5e-4}, (0, 1e-3, 0, 0)),  # the output axis stays level
        ({"kio": 5e-6}, (0, 1e-3, 0, 0)),
    ],
)
def test_each_coefficient_has_its_textbook_effect_on_four_points(changes: Any, expected: Any) -> None:
    assert four_points(but(**changes)) == pytest.approx(expected, rel=1e-12, abs=1e-15)


def test_cross_couplings_and_misalignments_act_on_their_products() -> None:
    angle = np.radians([30.0, 45, 120])
    sine, cosine = np.sin(angle), np.cos(angle)
    across = current_a(but(kip=5e-6), angle) - 1e-3 * sine
    assert across == pytest.approx(1e-3 * 5e-6 * sine * cosine, rel=1e-9)
    across = current_a(but(kio=5e-6), angle, across_g=0.1) - 1e-3 * sine
    assert across == pytest.approx(1e-3 * 5e-6 * sine * 0.1, rel=1e-9)
    across = current_a(but(misalignment_p=-5e-4), angle, across_g=0.1) - 1e-3 * sine
    assert across == pytest.approx(1e-3 * 5e-4 * 0.1, rel=1e-9)
    cube = current_a(but(k3=5e-6), angle) - 1e-3 * sine
    assert cube == pytest.approx(1e-3 * 5e-6 * sine**3, rel=1e-7)


def test_bias_and_scale_are_polynomials_about_the_reference_temperature() -> None:
    truth = but(reference_c=25.0, bias=(1e-4, 1e-5, 2e-7, 3e-9, 4e-11), scale=(1.0, -6e-5, 2e-8, 3e-10, 4e-12))
    t = 40.0
    bias = 1e-4 + 1e-5 * t + 2e-7 * t**2 + 3e-9 * t**3 + 4e-11 * t**4
    scale = 1e-3 * (1 - 6e-5 * t + 2e-8 * t**2 + 3e-10 * t**3 + 4e-12 * t**4)
    assert four_points(truth, 65.0)[:2] == pytest.approx((bias, scale), rel=1e-12)
    assert four_points(truth, 25.0)[:2] == pytest.approx((1e-4, 1e-3), rel=1e-12)


def test_the_accelerometer_saturates_at_its_range() -> None:
    force = np.array([-30.0, -20, 19, 20, 21])
    rest = np.zeros_like(force)
    current = but(range_g=20.0).current_a((force, rest, rest), rest + 20, rest)
    assert current == pytest.approx([-0.02, -0.02, 0.019, 0.02, 0.02])


# The hysteresis, by hand


def hysteresis_ug(path_c: list[float], start_c: float = 20.0) -> list[float]:
    """±15 µg over thresholds of 5 and 10 °C, so 1 µg for each °C between the temperature and a play operator."""
    play = Hysteresis(but(hysteresis_g=15e-6, thresholds_c=(5.0, 10.0)), start_c)
    return [1e6 * play.bias_g(temperature_c) for temperature_c in path_c]


def test_the_hysteresis_follows_a_path_worked_by_hand() -> None:
    # temperature    22     27      30      28     15      5      12     20    30
    # y(5), y(10)  20 20  22 20   25 20   25 20  20 20   10 15  10 15  15 15  25 20
    # (T-y)1+(T-y)2  2+2    5+7    5+10    3+8   -5-5   -5-10   2-3    5+5  5+10
    path = [22.0, 27, 30, 28, 15, 5, 12, 20, 30]
    assert hysteresis_ug(path) == pytest.approx([4, 12, 15, 11, -10, -15, -1, 10, 15])


def test_a_cycle_closes_its_loop_and_the_branches_are_apart() -> None:
    cycle = [20.0, 40, 60, 40, 20, 0, 20, 40, 60]
    bias = hysteresis_ug(cycle)
    assert bias[2] == bias[8] == pytest.approx(15)
    assert (bias[1], bias[3]) == pytest.approx((15, -15)), "up and down branch at one temperature"


def test_steps_on_the_way_change_nothing_for_the_hysteresis() -> None:
    corners = [20.0, 37.3, 12.1, 25.4, 24.0, 60.0]
    fine = np.concatenate([np.linspace(a, b, 50) for a, b in itertools.pairwise(corners)])
    assert hysteresis_ug(fine.tolist())[49::50] == pytest.approx(hysteresis_ug(corners)[1:])


def test_no_thresholds_no_hysteresis() -> None:
    assert Hysteresis(but(hysteresis_g=1.0), 20.0).bias_g(50.0) == 0.0


# What changes with time, as the charge that a unit fires in its place


def file(**accelerometer: Any) -> UnitFile:
    return unit(accelerometer=accelerometer)


def bias_g(unit_file: UnitFile, *, warm_s: float, gate_s: float = 10.0) -> float:
    """The bias of a unit at 0 g, as its pulses say, `warm_s` after power-on at 1000 s."""
    lab = Laboratory(place(unit=unit_file))
    lab.wait(1000)
    lab.world.power("supply", True)
    lab.wait(warm_s)
    lab.world.before_change()
    lab.world.units["a"].charge_pulses(np.array([lab.world.now() - 1.0, lab.world.now()]))
    return lab.rate_pps(gate_s=gate_s) / (1e-3 * S)


def test_drift_grows_with_time_from_the_beginning_of_the_run() -> None:
    drifting = file(drift="864 µg/day")  # 10 ng/s
    assert bias_g(drifting, warm_s=5000, gate_s=10) == pytest.approx(1e-8 * 6005, rel=1e-9)


def test_warm_up_dies_away_from_power_on() -> None:
    warming = file(warm_up={"amplitude": "50 µg", "time_constant": "20 min"})
    for warm_s in (0.0, 1200.0, 7200.0):
        assert bias_g(warming, warm_s=warm_s, gate_s=1) == pytest.approx(
            50e-6 * math.exp(-(warm_s + 0.5) / 1200), rel=1e-6
        )


def test_a_unit_whose_temperature_moves_shows_its_rate() -> None:
    lab = Laboratory(place(unit=file(Kd="-10 µg·min/°C")))
    lab.world.power("supply", True)
    lab.world.ramp(200.0, 1 / 60)
    lab.wait(7200)
    lab.world.units["a"].charge_pulses(np.array([7199.0, 7200.0]))
    assert lab.rate_pps() / (1e-3 * S) == pytest.approx(-10e-6, rel=1e-6)


def test_noise_has_its_density_and_averages_as_white_noise_does() -> None:
    noise = noise_of(but(noise_density=2e-6), seed=3, place="a")
    tenths = noise.mean(np.full(200_000, 0.1))
    assert tenths.std() == pytest.approx(2e-6 * math.sqrt(0.5 / 0.1), rel=0.01)
    assert tenths.reshape(-1, 100).mean(axis=1).std() == pytest.approx(2e-6 * math.sqrt(0.5 / 10), rel=0.05)
    assert tenths.mean() == pytest.approx(0, abs=5 * tenths.std() / math.sqrt(200_000))


@pytest.mark.parametrize("block_s", [0.1, 1.0, 10.0])
def test_the_wander_has_its_size_and_forgets_in_ten_seconds(block_s: float) -> None:
    noise = noise_of(but(instability_g=0.5e-6), seed=3, place="a")
    values = np.array([noise.mean(np.array([block_s]))[0] for _ in range(40_000)])
    assert values.std() == pytest.approx(0.5e-6, rel=0.1)
    after_ten_s = round(10 / block_s)
    assert np.corrcoef(values[:-after_ten_s], values[after_ten_s:])[0, 1] == pytest.approx(math.exp(-1), abs=0.1)


def test_the_bias_wanders_on_while_nobody_looks() -> None:
    noise, second = noise_of(but(instability_g=0.5e-6), seed=3, place="a"), np.array([1.0])
    looks = []
    for _ in range(4000):
        looks.append(noise.mean(second)[0])
        noise.pass_over(9.0)
    values = np.array(looks)
    assert values.std() == pytest.approx(0.5e-6, rel=0.1)
    assert np.corrcoef(values[:-1], values[1:])[0, 1] == pytest.approx(math.exp(-1), abs=0.1)


def test_noise_belongs_to_seed_and_place() -> None:
    truth, interval_s = but(noise_density=2e-6, instability_g=1e-6), np.full(5, 0.1)
    first = noise_of(truth, 3, "a").mean(interval_s)
    assert first.tolist() == noise_of(truth, 3, "a").mean(interval_s).tolist()
    assert first.tolist() != noise_of(truth, 3, "b").mean(interval_s).tolist()
    assert first.tolist() != noise_of(truth, 4, "a").mean(interval_s).tolist()


# The converter


def rate_pps(truth: UnitTruth, *current: float) -> list[float]:
    return truth.rate_pps(np.array(current)).tolist()


def test_a_perfect_converter_is_a_line() -> None:
    assert rate_pps(PERFECT, -0.02, -1e-6, 0, 1e-6, 0.02) == pytest.approx([-200_000, -10, 0, 10, 200_000])


def test_the_two_polarities_differ_by_the_asymmetry() -> None:
    assert rate_pps(but(asymmetry=2e-4), 1e-3, -1e-3) == pytest.approx([10_001, -9_999])


def test_the_nonlinearity_is_a_share_of_full_scale() -> None:
    bent = but(nonlinearity=1e-4, full_scale_a=0.025)
    assert rate_pps(bent, 0.025, 0.0125, -0.025) == pytest.approx([250_000 + 25, 125_000 + 6.25, -250_000 - 25])


def test_zero_and_temperature_coefficients_are_about_25_degrees() -> None:
    drifting = {"zero_pps": 2.0, "zero_drift_pps": 0.004, "alpha": 1e-5}
    assert rate_pps(but(**drifting, converter_c=25), 0, 1e-3) == pytest.approx([2, 10_002])
    assert rate_pps(but(**drifting, converter_c=35), 0, 1e-3) == pytest.approx([2.04, 10_003.04])


def test_inside_the_dead_band_nothing_fires_and_above_it_the_rate_is_unchanged() -> None:
    dead = but(dead_band_a=20e-9)  # 0.2 pulse/s
    assert rate_pps(dead, -21e-9, -19e-9, 0, 19e-9, 21e-9) == pytest.approx([-0.21, 0, 0, 0, 0.21])
    shifted = but(dead_band_a=20e-9, zero_pps=0.15)
    assert rate_pps(shifted, -34e-9, -36e-9, 4e-9, 6e-9) == pytest.approx([0, -0.21, 0, 0.21])


def test_the_converter_saturates_at_its_highest_rate() -> None:
    assert rate_pps(but(max_rate_pps=150_000.0), 0.016, -0.016, 0.014) == [150_000, -150_000, 140_000]


# The integrator


def exact_counts(pulses: list[Fraction], residue: Fraction) -> list[tuple[int, int]]:
    """One pulse at a time: a + or a - whenever the charge has reached one."""
    positive = negative = 0
    found = []
    for step in pulses:
        residue += step
        while residue >= 1:
            residue, positive = residue - 1, positive + 1
        while residue <= -1:
            residue, negative = residue + 1, negative + 1
        found.append((positive, negative))
    return found


# Multiples of 1/64 are exact in binary, so that no rounding hides a pulse that is lost.
SIXTY_FOURTHS = st.integers(-300, 300).map(lambda n: n / 64)
PULSES = st.one_of(
    st.lists(SIXTY_FOURTHS, min_size=1, max_size=40),
    st.lists(SIXTY_FOURTHS.map(abs), min_size=1, max_size=40),
    st.lists(SIXTY_FOURTHS.map(lambda x: -abs(x)), min_size=1, max_size=40),
)


@given(st.lists(PULSES, min_size=1, max_size=6), st.integers(-63, 63).map(lambda n: n / 64))
def test_blocks_of_any_sizes_and_signs_fire_what_single_pulses_would(blocks: list[list[float]], residue: float) -> None:
    integrator, found = Integrator(residue, 0, 0), []
    for block in blocks:
        positive, negative = integrator.count(np.array(block))
        found += zip(positive.tolist(), negative.tolist(), strict=True)
    assert found == exact_counts([Fraction(step) for block in blocks for step in block], Fraction(residue))
    assert (integrator.positive, integrator.negative) == found[-1]


def test_no_pulses_leave_everything_as_it_is() -> None:
    integrator = Integrator(0.5, 7, 9)
    positive, negative = integrator.count(np.array([]))
    assert (positive.tolist(), negative.tolist()) == ([], [])
    assert integrator.count(np.array([0.0, 0.0]))[0].tolist() == [7, 7]
    assert integrator.count(np.array([0.5]))[0].tolist() == [8]


def test_a_rate_that_falls_into_the_dead_band_within_a_block_loses_nothing() -> None:
    integrator = Integrator(0.0, 0, 0)
    assert integrator.count(np.array([5.25, 0.0]))[0].tolist() == [5, 5]
    assert integrator.count(np.array([0.0, -5.25]))[1].tolist() == [0, 5]


@given(
    rate_pps=st.one_of(st.floats(-30, 30), st.integers(-5, 5).map(lambda n: 10 * n + 1e-4)),
    blocks=st.lists(st.integers(1, 400), min_size=1, max_size=20),
)
def test_a_constant_rate_counts_the_same_however_time_is_cut(rate_pps: float, blocks: list[int]) -> None:
    """Latches of 0.1 s; 10, 20, … pulse/s and a little more beat slowly with them."""
    whole, parts = Integrator(0.3, 0, 0), Integrator(0.3, 0, 0)
    total = sum(blocks)
    at_once = np.subtract(*whole.count(np.full(total, rate_pps * 0.1)))
    in_parts = np.concatenate([np.subtract(*parts.count(np.full(size, rate_pps * 0.1))) for size in blocks])
    assert np.abs(at_once - in_parts).max() <= 1
    assert np.abs(at_once - (0.3 + rate_pps * 0.1 * np.arange(1, total + 1))).max() <= 1 + 1e-6


def test_counts_never_go_back_when_current_swings_through_zero() -> None:
    integrator = Integrator(0.0, 0, 0)
    swing = 3 * np.sin(np.arange(10_000) / 50)
    positive, negative = integrator.count(swing)
    assert np.diff(positive).min() == np.diff(negative).min() == 0
    assert np.abs((positive - negative) - swing.cumsum()).max() <= 1 + 1e-9


@pytest.mark.parametrize("frequency_hz", [30.37, 100.37])
def test_a_swing_between_latches_counts_as_far_as_it_goes(frequency_hz: float) -> None:
    """As when it is followed forty times as finely; to an extreme that is a little short, pulses would be missing."""
    time_s = np.arange(40 * 5000 + 1) / 40_000
    charge = 14.0 * np.sin(2 * np.pi * frequency_hz * time_s) + 6.0 * time_s
    finely, at_latches = Integrator(0.3, 0, 0), Integrator(0.3, 0, 0)
    expected = np.subtract(*finely.count(np.diff(charge)))[39::40]
    found = np.subtract(*at_latches.count_through_turns(np.diff(charge[::40])))
    assert np.mean(found != expected) < 1e-3


@pytest.mark.parametrize("corners_s", [[0.0, 9.0], [0.0, 0.05, 2.0, 2.0001, 7.5, 9.0]])
def test_values_between_corners_lie_on_straight_lines(corners_s: list[float]) -> None:
    """Also where no time is between two corners, and where one is at a time."""
    at_s, corners = np.arange(91) / 10, np.array(corners_s)
    values = np.random.default_rng(1).normal(size=(3, len(corners)))
    expected = [np.interp(at_s, corners, row) for row in values]
    assert straight(corners, values, at_s) == pytest.approx(np.array(expected), abs=1e-12)


def test_a_wander_does_not_depend_on_how_long_the_blocks_are() -> None:
    by_second, at_once = (Wander(1.0, np.random.default_rng(5)) for _ in range(2))
    intervals_s = np.full(100, 0.1)
    expected = np.concatenate([at_ends([by_second], part_s)[0] for part_s in np.split(intervals_s, 10)])
    assert at_ends([at_once], intervals_s)[0] == pytest.approx(expected, abs=1e-12)
    assert np.ptp(expected) > 0.1
