"""Specific force and velocity from counts: against rates that are integrated by quadrature, and many calibrations."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from bench.metrology.calibration.force_terms import ForceTerms
from bench.metrology.calibration.temperature import Compensation
from bench.metrology.motion_records import CountRecord
from bench.metrology.results.curves import Constant, KnotModel, TemperatureModel
from bench.metrology.velocity import Gravity, integrate, specific_forces

G = Gravity(9.80665)
TENTHS_S = np.arange(0.0, 60.05, 0.1)
K1, ALPHA, BETA, K0, K2, REFERENCE_C = 11_300.0, 1e-4, 0.5, 1e-3, 2e-4, 30.0
U = (0.2, 0.004, 0.0, 3e-3, 5e-6, 2e-6)  # of both coefficients of the scale, of the offset, of bias and quadratic term
ONE = np.eye(6)
ONE[0, 4] = ONE[4, 0] = -0.7
ONE[1, 3] = ONE[3, 1] = -0.8
VALID_C, RANGE_G = (0.0, 60.0), (0.0, 12.0)


def line(unit, at_reference, slope, u):
    return TemperatureModel("", "", "", unit, REFERENCE_C, 1.0, (at_reference, slope), u, valid_c=VALID_C)


def channel(k1=K1, k1_alpha=K1 * ALPHA, zero=0.0, beta=BETA, k0=K0, k2=K2):
    """The model of a channel over temperature and level, with its own uncertainties whatever the values are."""
    return Compensation(
        "x", "pulse/s", "g", line("pulse/s/g", k1, k1_alpha, U[:2]), line("pulse/s", zero, beta, U[2:4]),
        Constant(k0, "g", U[4]),
        force=ForceTerms(Constant(k2, "g/g²", U[5]), RANGE_G, correlation=tuple(map(tuple, ONE))),
    )  # fmt: skip


def force_g(time_s):
    return 1 + 4 * np.sin(np.pi * time_s / 60) ** 2


def warmed_c(time_s):
    return 25 + time_s / 5


def rate_pps(time_s, k1=K1):
    """The rate of the channel, written out for its own."""
    away_c, felt_g = warmed_c(time_s) - REFERENCE_C, force_g(time_s)
    return k1 * (1 + ALPHA * away_c) * (felt_g + K0 + K2 * (felt_g**2 - 1)) + BETA * away_c


def counted(rate=rate_pps, time_s=TENTHS_S):
    """What a converter counts: the exact integral of its rate."""
    each = [quad(rate, begin, end, epsabs=1e-11)[0] for begin, end in itertools.pairwise(time_s)]
    return record(time_s, np.concatenate(([0.0], np.cumsum(each))))


def record(time_s, cumulative, temperature_c=None):
    return CountRecord(time_s, warmed_c(time_s) if temperature_c is None else temperature_c, {"x": np.diff(cumulative)})


def velocity(of_record, known, gravity=G, noise_g=0.0):
    return integrate(specific_forces(of_record, {known.channel: known})[known.channel], gravity, noise_g)


@pytest.fixture(scope="module")
def exact():
    return counted()


# The value


def test_force_and_velocity_are_those_that_were_counted(exact):
    found = specific_forces(exact, {"x": channel()})["x"]
    middle_s = (TENTHS_S[1:] + TENTHS_S[:-1]) / 2
    assert found.force_g == pytest.approx(force_g(middle_s), abs=3e-5)  # its mean is not its middle
    true_mps = [G.mps2 * quad(force_g, 0, end, epsabs=1e-10)[0] for end in TENTHS_S[[1, 100, 600]]]
    assert integrate(found, G).velocity_mps[[1, 100, 600]] == pytest.approx(true_mps, rel=2e-8)


def test_a_negative_scale_factor_gives_the_same_velocity(exact):
    # The offset is that of the converter, and does not change its sign with the scale factor.
    turned = counted(lambda time_s: rate_pps(time_s, -K1), TENTHS_S[:101])
    known = channel(-K1, -K1 * ALPHA)
    assert turned.net_pulses["x"].sum() < 0
    assert velocity(turned, known).velocity_mps == pytest.approx(
        velocity(exact, channel()).velocity_mps[:101], rel=1e-9, abs=1e-9
    )


def test_temperature_between_readings_is_their_mean():
    known = channel(k0=0.0, k2=0.0)
    at_both_c = np.array([20.0, 60.0])
    found = specific_forces(record(np.array([0.0, 10.0]), np.array([0.0, 5e4]), at_both_c), {"x": known})["x"]
    assert found.force_g == pytest.approx([(5e3 - BETA * 10) / (K1 * (1 + ALPHA * 10))], rel=1e-12)


def test_out_of_range_the_curves_hold_or_nothing_is_known():
    time_s = np.arange(4.0)
    data = record(time_s, 1e4 * time_s, np.array([59.0, 59.5, 65.0, 50.0]))
    held = specific_forces(data, {"x": channel()})["x"]
    at_end = specific_forces(record(time_s, 1e4 * time_s, np.full(4, 60.0)), {"x": channel()})["x"]
    assert held.outside.tolist() == [False, True, False]
    assert held.force_g[1] == at_end.force_g[1]
    rejected = specific_forces(data, {"x": channel()}, "reject")["x"]
    assert np.isnan(rejected.force_g).tolist() == [False, True, False]
    assert np.isnan(integrate(rejected, G).velocity_mps).tolist() == [False, False, True, True]


def test_across_axes_each_sees_what_the_others_feel():
    true_g = np.array([3.0, -1.0, 0.5])
    cross = np.array([[0, 3e-3, -5e-3], [-4e-3, 0, 6e-3], [2e-3, 7e-3, 0]])
    names = ("acc_x", "acc_y", "acc_z")
    rates = K1 * (true_g + cross @ true_g + K2 * (true_g**2 - 1))
    time_s = np.arange(3.0)
    known = {
        name: Compensation(name, "pulse/s", "g", Constant(K1, "pulse/s/g", 0.0), force=ForceTerms(
            Constant(K2, "g/g²", 0.0), (-1.0, 1.0),
            {other: Constant(value, "rad", 0.0) for other, value in zip(names, row, strict=True) if value},
        ))
        for name, row in zip(names, cross.tolist(), strict=True)
    }  # fmt: skip
    pulses = {name: np.full(2, rate) for name, rate in zip(names, rates.tolist(), strict=True)}
    found = specific_forces(CountRecord(time_s, np.zeros(3), pulses), known)
    assert [found[name].force_g[0] for name in names] == pytest.approx(true_g, rel=1e-12)


def test_pulses_of_the_other_sign_leave_another_charge_in_the_converter():
    """One integrator: its charge is up to a pulse beyond the count, on the side of the last pulse."""
    plain = Compensation(
        "x", "pulse/s", "g", Constant(1.0, "pulse/s/g", 0.0), force=ForceTerms(Constant(0, ""), RANGE_G)
    )
    data = CountRecord(np.arange(6.0), np.zeros(6), {"x": np.array([5.0, 0, -3, 0, 4])})
    assert specific_forces(data, {"x": plain})["x"].force_g.tolist() == [5, 0, -4, 0, 5]
    silent = CountRecord(np.arange(3.0), np.zeros(3), {"x": np.zeros(2)})
    assert specific_forces(silent, {"x": plain})["x"].force_g.tolist() == [0, 0]


# Uncertainty


def test_the_uncertainty_of_a_velocity_is_that_of_many_calibrations(exact):
    rng = np.random.default_rng(20_240_607)
    covariance = np.outer(U, U) * ONE
    drawn = rng.multivariate_normal(np.zeros(6), covariance, size=800)
    centre = np.array([K1, K1 * ALPHA, 0.0, BETA, K0, K2])
    every = [velocity(exact, channel(*(centre + error).tolist())).velocity_mps for error in drawn]
    found = velocity(exact, channel())
    assert found.u_model_mps[1:] == pytest.approx(np.std(every, axis=0)[1:], rel=0.08)


def test_errors_of_knots_are_one_error_throughout():
    knots = KnotModel("", "", "", "pulse/s/g", (0.0, 60.0), (K1, K1), (1.13, 1.13))
    offset = KnotModel("", "", "", "pulse/s", (0.0, 60.0), (0.0, 0.0), (0.0, 0.226))
    terms = ForceTerms(Constant(0.0, "g/g²", 0.0), RANGE_G, bias_u_g=3e-5, scale_u=2e-4)
    known = Compensation("x", "pulse/s", "g", knots, offset, force=terms)
    time_s = np.arange(0.0, 101.0)
    found = velocity(record(time_s, 2 * K1 * time_s, np.full(101, 30.0)), known, Gravity(10.0, 1e-3))
    parts = np.array([2 * 1e-4, 1e-5, 3e-5, 2 * 2e-4, 2 * 1e-4])  # g: scale, offset, bias, scale, gravity
    assert found.u_model_mps == pytest.approx(10 * np.linalg.norm(parts) * time_s, rel=1e-9)


def test_counts_are_uncertain_at_both_ends_and_not_between(exact):
    charge, true_mps = (
        np.concatenate(([0.0], np.cumsum(exact.net_pulses["x"]))),
        velocity(exact, channel()).velocity_mps,
    )
    errors = [
        velocity(record(TENTHS_S, np.floor(charge + phase)), channel()).velocity_mps - true_mps
        for phase in np.random.default_rng(2).uniform(0, 1, 60)
    ]
    u = velocity(exact, channel()).u_count_mps
    assert u[0] == 0
    assert u[1:] == pytest.approx(np.full(600, 0.408 * G.mps2 / K1), rel=1e-2)
    assert np.std([each[1:50] for each in errors]) == pytest.approx(u[-1], rel=0.05)
    assert np.std([each[-50:] for each in errors]) == pytest.approx(u[-1], rel=0.05)


def test_noise_walks_with_the_root_of_time():
    rng = np.random.default_rng(5)
    white_g = 1e-3 * np.sqrt(0.5) / np.sqrt(0.1) * rng.standard_normal((400, 600))
    walked = G.mps2 * np.cumsum(white_g, axis=1) * 0.1
    found = velocity(record(TENTHS_S, K1 * TENTHS_S), channel(), noise_g=1e-3)
    assert found.u_noise_mps[[100, 600]] == pytest.approx(np.std(walked, axis=0)[[99, 599]], rel=0.12)
    assert found.u_mps[600] == np.sqrt(
        found.u_model_mps[600] ** 2 + found.u_count_mps[600] ** 2 + found.u_noise_mps[600] ** 2
    )


def test_an_acceleration_has_the_noise_and_the_count_of_its_interval(exact):
    found = specific_forces(exact, {"x": replace(channel(), force=ForceTerms(Constant(0, "g/g²", 0), RANGE_G))})["x"]
    calibration = np.sqrt(np.sum(np.square(found.errors), axis=0))
    alone = np.hypot(0.408 / K1 / 0.1, 1e-3 * np.sqrt(0.5 / 0.1))
    assert found.u_g(1e-3) == pytest.approx(np.hypot(calibration, alone), rel=2e-3)
    assert found.u_mps2(Gravity(10.0, 0.1)) == pytest.approx(np.hypot(10 * found.u_g(), 0.1 * found.force_g))


def test_a_channel_without_force_terms_is_refused(exact):
    with pytest.raises(ValueError, match="x has no force terms"):
        specific_forces(exact, {"x": replace(channel(), force=None)})
