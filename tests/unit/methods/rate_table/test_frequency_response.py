import numpy as np
import pytest
from scipy.optimize import brentq

from bench.methods.rate_table.reduction.response_points import bandwidth
from bench.methods.rate_table.reduction.sampling import averaging
from bench.methods.rate_table.reduction.two_sample import velocity_increments
from tests.support.m3_cases import second_order


def swept(response, f_hz):
    values = np.array([response(f) for f in f_hz])
    return f_hz, np.abs(values), np.degrees(np.unwrap(np.angle(values)))


def test_bandwidth_at_steps_of_1_hz_is_that_of_the_unit():
    response = second_order(78, 0.65)
    true_hz = brentq(lambda f: abs(response(f)) - np.sqrt(0.5), 50, 120)
    assert true_hz == pytest.approx(84.2595, abs=1e-4)
    found = bandwidth(*swept(response, np.arange(10.0, 101)))
    assert found.status == "ok"
    assert found.frequency_hz == pytest.approx(84.2573, abs=1e-4)
    assert found.phase_deg == pytest.approx(np.degrees(np.angle(response(true_hz))), abs=0.01)
    assert found.crossings == 1


def test_bandwidth_that_is_not_there():
    f_hz = np.arange(10.0, 20)
    assert bandwidth(f_hz, np.full(10, 0.9), np.zeros(10)).status == "not_reached"
    assert bandwidth(f_hz, np.full(10, 0.5), np.zeros(10)).status == "below_at_start"
    assert bandwidth(f_hz, np.full(10, 0.5), np.zeros(10)).frequency_hz is None
    assert bandwidth(f_hz[:0], f_hz[:0], f_hz[:0]).status is None


def test_the_first_of_several_crossings_counts():
    found = bandwidth(np.array([10.0, 20, 30, 40, 50]), np.array([1.0, 0.5, 0.8, 0.5, 0.1]), -np.arange(5.0))
    assert 10 < found.frequency_hz < 20
    assert found.crossings == 2


def test_a_gain_of_nothing_is_a_crossing_too():
    found = bandwidth(np.array([10.0, 20]), np.array([1.0, 0.0]), np.zeros(2))
    assert (found.status, found.frequency_hz) == ("ok", pytest.approx(10.0))


def test_a_mean_over_an_interval_has_the_factor_of_its_integral():
    f_hz, interval_s = 37.0, 0.004
    edge = 1j * 2 * np.pi * f_hz
    expected = (1 - np.exp(-edge * interval_s)) / (edge * interval_s)
    assert averaging(np.array([f_hz]), interval_s)[0] == pytest.approx(expected, rel=1e-12)


def increments(rate_start, rate_end, total_s):
    slope = (rate_end - rate_start) / total_s
    half = total_s / 2
    first = rate_start * half + slope * half**2 / 2
    return first, rate_start * total_s + slope * total_s**2 / 2 - first


def sensed(rate, slope, total_s, x_m, y_m):
    """∫ of -ω² x - dω/dt y and of -ω² y + dω/dt x over τ in 0..total_s, by quadrature that is exact for parabolas."""
    node, weight = np.polynomial.legendre.leggauss(8)
    tau = (node + 1) * total_s / 2
    w, change = rate(tau), slope(tau)
    weight = weight * total_s / 2
    return weight @ (-(w**2) * x_m - change * y_m), weight @ (-(w**2) * y_m + change * x_m)


@pytest.mark.parametrize(("start", "end"), [(0.05, 0.07), (-3.0, 2.0), (31.0, 31.0)])
def test_two_samples_are_exact_for_a_rate_that_is_linear_in_time(start, end):
    total_s, x_m, y_m = 0.01, 0.05, -0.031
    first, second = increments(start, end, total_s)
    found = velocity_increments(np.array([first]), np.array([second]), total_s=total_s, x_m=x_m, y_m=y_m)
    slope = (end - start) / total_s
    expected = sensed(lambda t: start + slope * t, lambda t: slope + 0 * t, total_s, x_m, y_m)
    assert [found[0][0], found[1][0]] == pytest.approx(expected, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(("f_hz", "factor"), [(10, 1.00033), (50, 1.0083), (100, 1.0343)])
def test_printed_transfer_of_two_samples_of_1_ms_on_a_sine(f_hz, factor):
    amplitude_rps, total_s, y_m = np.radians(3.0), 0.002, 0.05
    phase = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    angle = [-amplitude_rps / (2 * np.pi * f_hz) * np.cos(2 * np.pi * f_hz * t + phase) for t in (0, 0.001, 0.002)]
    found, _ = velocity_increments(angle[1] - angle[0], angle[2] - angle[1], total_s=total_s, x_m=0, y_m=y_m)
    rate = [amplitude_rps * np.sin(2 * np.pi * f_hz * t + phase) for t in (0, total_s)]
    true = -(rate[1] - rate[0]) * y_m
    assert found == pytest.approx(factor * true, abs=5e-5 * np.max(np.abs(true)))
