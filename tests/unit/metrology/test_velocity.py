from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from bench.metrology.velocity import ChannelModel, VelocityRecord, compare_velocity, integrate

G_MPS2 = 9.80665
U = (0.2, 5e-6, 2e-7, 1e-4)  # of K1, K0, α and β
CORRELATION = np.eye(4)
CORRELATION[2, 3] = CORRELATION[3, 2] = -0.8
MODEL = ChannelModel(
    reference_c=30.0, scale_pps_per_g=11_300.0, bias_g=1e-3, scale_drift_per_c=1e-5, offset_drift_pps_per_c=4e-3,
    covariance=np.outer(U, U) * CORRELATION,
)  # fmt: skip
HOUR_S = np.arange(0.0, 3601, 10)


def counted(force_g, model=MODEL, *, time_s=HOUR_S, low_c=10.0, c_per_h=25.0):
    """An hour's ramp under one input, counted to the fraction of a pulse."""
    temperature_c = low_c + c_per_h * time_s / 3600
    away_c = temperature_c - model.reference_c
    nominal_pps = model.scale_pps_per_g * (force_g + model.bias_g)
    rate_pps = nominal_pps * (1 + model.scale_drift_per_c * away_c) + model.offset_drift_pps_per_c * away_c
    pulses = np.cumsum((rate_pps[1:] + rate_pps[:-1]) / 2 * np.diff(time_s))  # exact: the rate is straight, too
    return VelocityRecord(time_s, np.concatenate(([0.0], pulses)), time_s, temperature_c)


def only(model, **drift):
    """The channel with these drifts alone."""
    return replace(model.without_drift(), **drift)


# The value


@pytest.mark.parametrize("force_g", [1.0, -1.0, 0.577, 0.0, 12.0])
def test_the_model_takes_the_temperature_out(force_g):
    found = integrate(counted(force_g), MODEL, G_MPS2)
    assert found.velocity_mps == pytest.approx(force_g * G_MPS2 * HOUR_S, abs=2e-8 * max(abs(force_g), 1))
    assert found.force_g == pytest.approx(np.full(360, force_g), abs=1e-11)


def test_without_compensation_the_drift_is_integrated():
    found = compare_velocity(counted(1.0), MODEL, force_g=1.0, gravity_mps2=G_MPS2)
    slope_g_per_c = (11_300 * 1.001 * 1e-5 + 4e-3) / 11_300
    away_cs = np.cumsum((counted(1.0).temperature_c[1:] + counted(1.0).temperature_c[:-1]) / 2 - 30) * 10
    assert found.raw.error_mps == pytest.approx(G_MPS2 * slope_g_per_c * np.min(away_cs), rel=1e-6)
    assert found.raw.time_s == pytest.approx(20 / 25 * 3600, abs=10)  # at the reference temperature it turns round
    assert abs(found.compensated.error_mps) < 1e-7


def test_of_a_changing_input_every_pulse_counts_whatever_was_between_the_readings():
    rng = np.random.default_rng(1)
    pulses = np.concatenate(([0.0], np.cumsum(rng.integers(-50_000, 120_000, 360))))
    steady = VelocityRecord(HOUR_S, pulses, np.array([0.0]), np.array([30.0]))
    found = integrate(steady, MODEL, G_MPS2)
    assert found.velocity_mps == pytest.approx(G_MPS2 * (pulses / 11_300 - 1e-3 * HOUR_S), rel=1e-13, abs=1e-9)
    coarse = integrate(VelocityRecord(HOUR_S[::60], pulses[::60], np.array([0.0]), np.array([30.0])), MODEL, G_MPS2)
    assert coarse.velocity_mps == pytest.approx(found.velocity_mps[::60], rel=1e-13, abs=1e-9)


def test_the_temperature_is_straight_between_its_own_readings():
    model = only(MODEL, scale_drift_per_c=1e-3, offset_drift_pps_per_c=20.0)  # large, so that a wrong mean shows
    times_s, temperatures_c = np.array([-5.0, 3.0, 4.0, 12.0]), np.array([30.0, 50.0, 20.0, 26.0])
    record = VelocityRecord(np.array([0.0, 10.0]), np.array([0.0, 5e4]), times_s, temperatures_c)

    def force_g(at_s):
        away_c = np.interp(at_s, times_s, temperatures_c) - 30
        return (5e3 - 20.0 * away_c) / (1 + 1e-3 * away_c) / 11_300 - 1e-3

    expected_gs = sum(quad(force_g, *ends)[0] for ends in ((0, 3), (3, 4), (4, 10)))
    assert integrate(record, model, 1.0).velocity_mps[-1] == pytest.approx(expected_gs, rel=1e-8)
    assert integrate(record, model, 1.0).force_g == pytest.approx([expected_gs / 10], rel=1e-8)


def test_beyond_its_readings_the_temperature_stays():
    record = replace(counted(1.0), temperature_time_s=np.array([1800.0]), temperature_c=np.array([40.0]))
    found = integrate(record, only(MODEL, scale_drift_per_c=1e-5), G_MPS2)
    expected = G_MPS2 * (record.net_pulses / 11_300 / (1 + 1e-4) - 1e-3 * HOUR_S)
    assert found.velocity_mps == pytest.approx(expected, rel=1e-12, abs=1e-9)


def test_at_the_level_of_its_own_slope_every_shared_model_tells_the_same():
    slope_pps_per_c = 11_300 * 1.001 * 1e-5 + 4e-3
    record = counted(1.0)
    raw = integrate(record, only(MODEL, offset_drift_pps_per_c=slope_pps_per_c), G_MPS2)
    normalised = integrate(record, only(MODEL, scale_drift_per_c=slope_pps_per_c / (11_300 * 1.001)), G_MPS2)
    assert raw.velocity_mps == pytest.approx(G_MPS2 * HOUR_S, abs=1e-6)
    assert normalised.velocity_mps == pytest.approx(G_MPS2 * HOUR_S, abs=1e-6)


# Uncertainty


def test_the_uncertainty_of_the_model_is_that_of_many_calibrations():
    rng = np.random.default_rng(20_240_607)
    record = counted(0.577, time_s=np.arange(0.0, 3601, 200))
    drawn = rng.multivariate_normal(np.zeros(4), MODEL.covariance, size=1200)
    velocities = []
    for k1, k0, alpha, beta in drawn:
        model = replace(
            MODEL, scale_pps_per_g=11_300 + k1, bias_g=1e-3 + k0, scale_drift_per_c=1e-5 + alpha,
            offset_drift_pps_per_c=4e-3 + beta,
        )  # fmt: skip
        velocities.append(integrate(record, model, G_MPS2).velocity_mps)
    found = integrate(record, MODEL, G_MPS2)
    assert found.u_model_mps == pytest.approx(np.std(velocities, axis=0), rel=0.08, abs=1e-9)


@pytest.mark.parametrize("parameter", range(4))
def test_every_parameter_has_its_own_uncertainty(parameter):
    # The hot end and large drifts, so that no derivative is beneath the others.
    model = replace(MODEL, scale_drift_per_c=2e-3, offset_drift_pps_per_c=30.0)
    names = ("scale_pps_per_g", "bias_g", "scale_drift_per_c", "offset_drift_pps_per_c")
    unit = np.zeros(4)
    unit[parameter] = U[parameter]
    record = counted(0.577, low_c=40.0)

    def moved(by):
        more = {names[parameter]: getattr(model, names[parameter]) + by * U[parameter]}
        return integrate(record, replace(model, **more), G_MPS2).velocity_mps

    found = integrate(record, replace(model, covariance=np.diag(unit**2)), G_MPS2)
    assert found.u_model_mps == pytest.approx(np.abs(moved(0.5) - moved(-0.5)), rel=1e-5, abs=1e-9)


def test_the_uncertainty_of_the_model_grows_with_time_and_that_of_the_count_does_not():
    steady = replace(counted(1.0, c_per_h=0.0, low_c=40.0), temperature_c=np.full(361, 40.0))
    found = integrate(steady, MODEL, G_MPS2)
    assert found.u_model_mps == pytest.approx(found.u_model_mps[-1] * HOUR_S / 3600, rel=1e-9)
    assert (found.u_count_mps[0], found.u_model_mps[0]) == (0, 0)
    assert found.u_count_mps[1:] == pytest.approx(np.full(360, 0.408 * G_MPS2 / 11_300))
    assert found.u_mps[-1] == np.hypot(found.u_model_mps[-1], found.u_count_mps[-1])


def test_whole_pulses_are_off_by_as_much_as_told():
    rng = np.random.default_rng(2)
    exact, errors = counted(1.0), []
    for phase in rng.uniform(0, 1, 100):
        whole = replace(exact, net_pulses=np.floor(exact.net_pulses + phase))
        found = integrate(whole, MODEL, G_MPS2)
        errors.append(found.velocity_mps[1:] - G_MPS2 * HOUR_S[1:])
    assert np.max(np.abs(errors)) < 1.001 * G_MPS2 / 11_300
    assert np.std(errors) == pytest.approx(0.408 * G_MPS2 / 11_300, rel=0.1)


def test_without_compensation_the_drift_has_no_uncertainty_either():
    raw = MODEL.without_drift()
    assert (raw.scale_drift_per_c, raw.offset_drift_pps_per_c) == (0, 0)
    assert raw.covariance == pytest.approx(np.diag([U[0] ** 2, U[1] ** 2, 0, 0]))
