"""Courses of zero and scale after power-on, and from when on they stay within a limit."""

from unittest import mock

import numpy as np
import pytest

from bench.methods.imu.start_up import courses as start_up
from bench.methods.imu.start_up.courses import fit_courses, settling
from bench.metrology.least_squares import NotDetermined

TAUS_S = (300.0, 900.0, 2700.0)
AT_S = np.arange(10.0, 3600.0, 50.0)
DRIVE = np.where(np.arange(len(AT_S)) % 2, -1.0, 1.0)


def zero(at_s):
    return 1e-5 + 5e-5 * np.exp(-at_s / 1200)


def scale(at_s):
    return 1 + 2e-5 * np.exp(-at_s / 900)


def test_zero_and_scale_come_apart_though_both_change_between_readings():
    courses = fit_courses(AT_S, zero(AT_S) + DRIVE * scale(AT_S), DRIVE, TAUS_S)
    grid_s = courses.grid_s
    assert (grid_s[0], grid_s[-1]) == (0.0, AT_S[-1])
    assert courses.of("zero", grid_s) == pytest.approx(zero(grid_s), abs=1e-6)
    assert courses.of("scale", grid_s) == pytest.approx(scale(grid_s), abs=1e-6)
    assert courses.points("zero") == pytest.approx(zero(AT_S), abs=1e-6)
    assert courses.points("scale") == pytest.approx(scale(AT_S), abs=1e-6)


def test_the_weights_of_the_readings_are_what_one_of_them_does_to_a_course():
    values = zero(AT_S) + DRIVE * scale(AT_S)
    at_s = np.array([0.0, 1000.0])
    before = fit_courses(AT_S, values, DRIVE, TAUS_S)
    values[7] += 1e-3
    after = fit_courses(AT_S, values, DRIVE, TAUS_S)
    for part in ("zero", "scale"):
        assert (after.of(part, at_s) - before.of(part, at_s)) / 1e-3 == pytest.approx(before.weights(part, at_s)[:, 7])


def test_readings_at_one_drive_or_too_few_determine_nothing():
    with pytest.raises(NotDetermined):
        fit_courses(AT_S, zero(AT_S), np.ones_like(AT_S), TAUS_S)
    with pytest.raises(NotDetermined):
        fit_courses(AT_S[:7], zero(AT_S[:7]), DRIVE[:7], TAUS_S)


GRID_S = np.arange(0.0, 3601.0)
NOTHING = np.zeros_like(GRID_S)


def test_a_course_stays_within_its_limit_from_its_last_entry_on():
    found = settling(GRID_S, 5e-5 * np.exp(-GRID_S / 1200), NOTHING, 3e-5)
    assert found.at_s == pytest.approx(1200 * np.log(5 / 3), abs=0.1)
    assert (found.u_s, found.to_the_end, found.from_the_start) == (0.0, False, False)


def test_an_entry_after_which_it_leaves_again_does_not_count_and_either_side_does():
    swinging = -np.sin(GRID_S / 3600 * 3 * np.pi)  # outside ±0.5 three times
    assert settling(GRID_S, swinging, NOTHING, 0.5).at_s == pytest.approx(3600 / 3 * (2 + 5 / 6), abs=1)


def test_its_uncertainty_moves_the_time_by_the_slope():
    found = settling(GRID_S, 1 - GRID_S / 3600, np.full_like(GRID_S, 0.01), 0.5)
    assert (found.at_s, found.u_s) == pytest.approx((1800.0, 36.0), abs=0.01)


def test_what_never_leaves_has_settled_at_power_on_and_what_never_enters_has_not():
    inside, outside = (settling(GRID_S, NOTHING + off, NOTHING, 0.5) for off in (0.1, 0.9))
    assert (inside.at_s, inside.from_the_start, inside.to_the_end) == (0.0, True, False)
    assert (outside.at_s, outside.from_the_start, outside.to_the_end) == (3600.0, False, True)


def test_what_is_hardly_within_may_be_outside_after_all():
    found = settling(GRID_S, 0.49 + 0.1 * np.exp(-GRID_S / 300), np.full_like(GRID_S, 0.02), 0.5)
    assert found.at_s == pytest.approx(300 * np.log(10), abs=1)
    assert found.u_s > 1000


def settled(noise, limit, trials=200):
    """Errors, uncertainties, and whether the range held the truth, of courses of 1200 s that start at 1.5 limits."""
    rng, true_s, rows = np.random.default_rng(1), 1200 * np.log(1.5), []
    for _ in range(trials):
        values = 1.5 * limit * np.exp(-AT_S / 1200) + noise * rng.standard_normal(len(AT_S))
        courses = fit_courses(AT_S, values, DRIVE, TAUS_S)
        u = noise * np.linalg.norm(courses.weights("zero", courses.grid_s), axis=-1)
        found = settling(courses.grid_s, courses.of("zero", courses.grid_s), u, limit)
        if not found.to_the_end:
            held = found.interval_s.low <= true_s <= found.interval_s.high
            rows.append((found.at_s - true_s, found.u_s, held))
    assert len(rows) > 0.9 * trials
    errors_s, u_s, held = np.array(rows).T
    return float(np.sqrt(np.mean((errors_s / u_s) ** 2))), float(np.mean(np.abs(errors_s) > 3 * u_s)), held.mean()


@pytest.mark.lengthy
@pytest.mark.parametrize(("noise", "least"), [(0.03, 0.9), (1.0, 0.5)])
def test_where_the_readings_hardly_tell_it_neither_uncertainty_nor_range_are_too_small(noise, least):
    """At a noise of 1 the course is known to half of its limit at its end."""
    rms, far, held = settled(noise, 1.0)
    assert least < rms < 1.2
    assert far <= 0.025
    assert held >= 0.93


@pytest.mark.lengthy
def test_an_uncertainty_by_the_slope_would_be_seen_where_the_course_is_flat():
    with mock.patch.object(start_up, "_normal_draws", return_value=np.array([-1.0, 1.0])):
        rms, _, _ = settled(1.0, 1.0)
    assert rms > 1.35


def test_the_range_goes_from_the_soonest_entry_to_the_latest_and_tells_when_the_readings_end_before():
    falling, wide = 1 - GRID_S / 3600, np.full_like(GRID_S, 0.01)
    found = settling(GRID_S, falling, wide, 0.5)
    assert (found.interval_s.low, found.interval_s.high) == pytest.approx((1800 - 70.6, 1800 + 70.6), abs=0.1)
    assert (found.interval_s.from_scatter, found.perhaps_to_the_end) == (0.0, False)
    open_end = settling(GRID_S, falling, 30 * wide, 0.5)
    assert (open_end.interval_s.high, open_end.perhaps_to_the_end, open_end.to_the_end) == (3600.0, True, False)
    assert open_end.interval_s.from_scatter == pytest.approx(0.1 * 3600, rel=0.1)  # 0.5 is beyond 1.67 u
