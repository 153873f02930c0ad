"""The low pass of a sensor against its transfer function, however its time is cut."""

import numpy as np
import pytest

from simulators.physics.dynamics import Dynamics, Follower, look_at_s, mean_input


def averaged(dynamics, edges_s, frequency_hz):
    """The exact mean over each interval of the response to a cosine that has always been."""
    turn = 2j * np.pi * frequency_hz
    whole = dynamics.response(np.array([frequency_hz]))[0] * np.exp(turn * edges_s) / turn
    return np.real(np.diff(whole)) / np.diff(edges_s)


KINDS = (Dynamics(60, 0.7), Dynamics(60, 0.65, 2e-3), Dynamics(300, 0.7), Dynamics(20, 0.3))


@pytest.mark.parametrize("frequency_hz", [0.5, 10.13, 60.0, 120.0])
@pytest.mark.parametrize("dynamics", KINDS)
def test_a_sine_comes_out_as_the_transfer_function_says(dynamics, frequency_hz):
    uneven_s = 5e-4 + 5e-4 * np.random.default_rng(1).random(40)
    edges_s = np.cumsum(np.concatenate(([0.0], uneven_s, np.full(3000, 1e-3))))
    inputs = np.cos(2 * np.pi * frequency_hz * look_at_s(edges_s, dynamics.delay_s))
    follower, interval_s = Follower(dynamics), np.diff(edges_s)
    parts = [follower.mean(inputs[rows], interval_s[rows]) for rows in (slice(0, 700), slice(700, None))]
    settled = edges_s[1:] > edges_s[-1] - 0.5
    error = (np.concatenate(parts) - averaged(dynamics, edges_s, frequency_hz))[settled]
    assert np.max(np.abs(error)) < 2e-7


def test_it_begins_settled_and_stays_so():
    edges_s = np.linspace(0, 1, 1001)
    mean = Follower(Dynamics(60, 0.7)).mean(np.full((1000, 4), 3.0), np.diff(edges_s))
    assert mean == pytest.approx(np.full(1000, 3.0), abs=1e-10)


def test_over_long_intervals_it_averages_what_it_senses():
    edges_s = np.linspace(0, 10, 101)
    inputs = look_at_s(edges_s) ** 2
    follower = Follower(Dynamics(60, 0.7))
    assert follower.mean(inputs, np.diff(edges_s)) == pytest.approx(mean_input(inputs))
    assert mean_input(inputs)[-1] == pytest.approx((10**3 - 9.9**3) / 0.3)


@pytest.mark.parametrize("damping", [0.3, 0.65, 0.7071, 0.95])
def test_the_bandwidth_is_where_the_gain_has_fallen_to_half_the_power(damping):
    dynamics = Dynamics(60, damping, 1e-3)
    assert np.abs(dynamics.response(np.array([1e-6, 60.0]))) == pytest.approx([1, np.sqrt(0.5)])
