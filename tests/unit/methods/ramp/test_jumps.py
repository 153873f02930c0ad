import numpy as np
import pytest

from bench.methods.ramp.reduction.jumps import find_jumps

N = 200
TIME = 10.0 * np.arange(N)


def noise(sd, seed=1):
    return sd * np.random.default_rng(seed).standard_normal(N)


def step(after, size):
    return np.where(np.arange(N) >= after, size, 0.0)


def found(value, time_s=TIME, **settings):
    settings = {"threshold": 60.0, **settings}
    return [(jump.after, jump.size) for jump in find_jumps(time_s, value, **settings)]


@pytest.mark.parametrize("size", [150.0, -150.0])
def test_a_step_on_a_ramp_is_found_where_it_is_and_with_its_sign(size):
    assert found(0.7 * TIME + step(90, size)) == [(90, pytest.approx(size, abs=1e-6))]


def test_noise_moves_a_step_by_a_sample_at_most():
    for seed in range(50):
        ((after, size),) = found(0.7 * TIME + step(90, 130.0) + noise(8, seed))
        assert abs(after - 90) <= 1
        assert size == pytest.approx(130, abs=40)


def test_a_step_below_the_threshold_is_none():
    assert found(step(90, 55.0) + noise(0.5)) == []
    assert len(found(step(90, 55.0) + noise(0.5), threshold=50.0)) == 1


@pytest.mark.parametrize(
    "curve",
    [
        5.0 * TIME,
        3e-4 * (TIME - 700) ** 2,
        1e-6 * (TIME - 1000) ** 3,
        300 * np.exp(-TIME / 240),
        400 * np.sin(TIME / 300),
        7.0 * np.abs(TIME - 1000) / 10,
    ],
    ids=["ramp", "parabola", "cube", "settling", "wave", "turn"],
)
def test_a_smooth_curve_has_no_step(curve):
    assert found(curve + noise(5)) == []


def test_noise_alone_has_no_step():
    # At 16 its fits step by more than the threshold now and then, but never beyond their own scatter.
    assert [found(noise(16, seed)) for seed in range(30)] == [[]] * 30


def test_one_wrong_sample_is_no_step():
    value = noise(3)
    value[100] += 400
    assert found(value) == []


def test_a_step_hides_its_smaller_neighbours():
    assert found(step(90, 100.0) + step(102, 180.0) + noise(0.1)) == [(102, pytest.approx(180, rel=0.2))]


def test_steps_farther_apart_are_both_found_in_the_order_of_time():
    assert found(step(60, 120.0) - step(120, 180.0)) == [(60, pytest.approx(120)), (120, pytest.approx(-180))]


def test_the_earlier_of_two_equal_steps_is_reported():
    value = step(90, 128.0) + step(98, 128.0)
    steps = found(value, window=4, threshold=100.0)
    assert [after for after, _ in steps] == [90]


@pytest.mark.parametrize(("after", "count"), [(7, 0), (8, 1), (192, 1), (193, 0)])
def test_a_step_needs_all_its_neighbours(after, count):
    assert len(found(step(after, 150.0))) == count


def test_a_smaller_window_sees_nearer_to_the_ends():
    assert [after for after, _ in found(step(3, 150.0), window=3)] == [3]


@pytest.mark.parametrize("n", [0, 1, 15])
def test_a_short_record_has_no_steps(n):
    assert find_jumps(TIME[:n], step(7, 150.0)[:n], threshold=60.0) == []


def test_uneven_sampling_of_a_ramp_is_no_step():
    keep = np.sort(np.random.default_rng(7).choice(N, 120, replace=False))
    assert found((5.0 * TIME)[keep], TIME[keep]) == []
    ((after, size),) = found((5.0 * TIME + step(90, 150.0))[keep], TIME[keep])
    assert keep[after - 1] < 90 <= keep[after]
    assert size == pytest.approx(150, abs=1e-6)
