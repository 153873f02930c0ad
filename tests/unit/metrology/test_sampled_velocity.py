"""Specific force and velocity from samples: against outputs integrated by quadrature, and from drawn codes."""

import numpy as np
import pytest
from scipy.integrate import quad

from bench.metrology.calibration.force_terms import ForceTerms
from bench.metrology.calibration.temperature import Compensation
from bench.metrology.motion_records import CountRecord, SampleRecord
from bench.metrology.results.curves import Constant
from bench.metrology.velocity import Gravity, integrate, specific_forces

G = Gravity(10.0)
K1, ZERO, EVERY_S = 400.0, 20.0, 0.1  # per g; of 0 g
TIME_S = EVERY_S * np.arange(601)
U = (0.02, 0.4)  # of scale and offset


def known(k1=K1, step=0.0, sample="mean", u=U):
    return Compensation(
        "x", "code", "g", Constant(k1, "code/g", u[0]), Constant(ZERO, "code", u[1]),
        force=ForceTerms(Constant(0.0, "g/g²", 0.0), (-1.0, 12.0), sample=sample, step=step),
    )  # fmt: skip


def force_g(time_s):
    return 1 + 4 * np.sin(np.pi * time_s / 20) ** 2


def means(k1=K1):
    """Samples that are means over the time before them, the first one too."""
    each = [quad(force_g, at_s - EVERY_S, at_s, epsabs=1e-12)[0] / EVERY_S for at_s in TIME_S]
    return ZERO + k1 * np.array(each)


def record(samples, time_s=TIME_S, *, averaged=True):
    return SampleRecord(time_s, np.zeros(len(time_s)), {"x": np.asarray(samples)}, averaged)


def found(of_record, calibration):
    return specific_forces(of_record, {"x": calibration})["x"]


@pytest.mark.parametrize("k1", [K1, -K1])
@pytest.mark.parametrize("averaged", [True, False], ids=["mean", "instant"])
def test_the_velocity_is_the_integral_of_the_specific_force(averaged, k1):
    samples = means(k1) if averaged else ZERO + k1 * force_g(TIME_S)
    force = found(record(samples, averaged=averaged), known(k1))
    true_mps = [G.mps2 * quad(force_g, 0, end, epsabs=1e-10)[0] for end in TIME_S[[1, 33, 600]]]
    assert integrate(force, G).velocity_mps[[1, 33, 600]] == pytest.approx(true_mps, abs=3e-5)


def test_a_mean_that_is_taken_for_the_output_at_its_time_is_seen():
    """Half of an interval late: 0.05 s at up to 0.6 g/s."""
    true_mps = G.mps2 * quad(force_g, 0, 5, epsabs=1e-10)[0]
    wrong = integrate(found(record(means(), averaged=False), known()), G).velocity_mps[50]
    assert abs(wrong - true_mps) > 0.5


def test_instants_at_unequal_times_are_integrated_too():
    jitter = np.random.default_rng(1).uniform(-0.02, 0.02, len(TIME_S))
    time_s = TIME_S + np.concatenate(([0.0], jitter[1:-1], [0.0]))
    force = found(record(ZERO + K1 * force_g(time_s), time_s, averaged=False), known())
    assert integrate(force, G).velocity_mps[-1] == pytest.approx(G.mps2 * quad(force_g, 0, 60)[0], abs=2e-4)


def test_errors_of_the_calibration_are_those_of_counts():
    samples, pulses = means(), means()[1:] * EVERY_S
    counted = found(CountRecord(TIME_S, np.zeros(601), {"x": pulses}), known())
    of_samples = integrate(found(record(samples), known()), G)
    assert of_samples.u_model_mps == pytest.approx(integrate(counted, G).u_model_mps, rel=1e-3)
    force_gs, elapsed_s = quad(force_g, 0, 60)[0], 60.0
    expected = np.hypot(U[0] / K1 * force_gs, U[1] / K1 * elapsed_s) * G.mps2
    assert of_samples.u_mps[-1] == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("averaged", [True, False], ids=["mean", "instant"])
def test_a_lost_sample_is_bridged_and_its_uncertainty_is_that_of_the_difference(averaged):
    ramp = ZERO + K1 * 0.1 * (TIME_S[:30] - (EVERY_S / 2 if averaged else 0))
    keep = np.delete(np.arange(30), [10, 11])
    force = found(record(ramp[keep], TIME_S[keep], averaged=averaged), known(u=(0.0, 0.0)))
    velocity = integrate(force, G)
    assert velocity.velocity_mps[-1] == pytest.approx(G.mps2 * 0.1 * TIME_S[29] ** 2 / 2, rel=2e-2)
    lost_s, difference_g = 2 * EVERY_S, 0.1 * 3 * EVERY_S
    assert velocity.u_mps[8:11] == pytest.approx([0, 0, G.mps2 * lost_s * difference_g / 12**0.5], rel=1e-6)
    assert velocity.u_mps[-1] == velocity.u_mps[10]


def test_after_many_lost_samples_no_velocity_is_known():
    keep = np.delete(np.arange(60), np.arange(20, 35))
    force = found(record(means()[keep], TIME_S[keep]), known())
    assert np.isnan(force.force_g).tolist() == [False] * 19 + [True] + [False] * 24
    assert np.isnan(integrate(force, G).velocity_mps).tolist() == [False] * 20 + [True] * 25


@pytest.mark.parametrize(("noise", "steps"), [(0.0, 1.0), (1.0, 0.0)], ids=["one step", "dithered"])
def test_rounding_at_rest_is_one_error_of_the_record_without_noise(noise, steps):
    """Without noise all codes are on one step."""
    draws = np.random.default_rng(3)
    calibration = known(step=1.0, u=(0.0, 0.0))
    ratios = []
    for _ in range(100):
        exact = ZERO + K1 * draws.uniform(0.9, 1.1)
        codes = np.rint(exact + noise * draws.standard_normal(301))
        force = found(record(codes, TIME_S[:301]), calibration)
        velocity = integrate(force, G, noise_g=noise / K1 * (2 * EVERY_S) ** 0.5)
        error = velocity.velocity_mps[-1] - G.mps2 * (exact - ZERO) / K1 * 30.0
        ratios.append(error / velocity.u_mps[-1])
        whole = G.mps2 / K1 / 12**0.5
        assert velocity.u_model_mps[-1] == pytest.approx(steps * whole * 30.0, abs=0.02 * whole * 30.0)
    assert 0.8 < np.sqrt(np.mean(np.square(ratios))) < 1.2


def test_the_temperature_of_a_mean_is_that_of_its_middle():
    warm = SampleRecord(np.arange(3.0), np.array([10.0, 20.0, 40.0]), {"x": np.zeros(3)}, averaged=True)
    assert warm.output_c("x").tolist() == [10, 15, 30]
    instants = SampleRecord(warm.time_s, warm.temperature_c, warm.samples, averaged=False)
    assert instants.output_c("x").tolist() == [10, 20, 40]


def test_two_samples_are_an_interval():
    for averaged in (True, False):
        force = found(record(ZERO + K1 * np.array([1.0, 1.0]), TIME_S[:2], averaged=averaged), known())
        assert force.force_g == pytest.approx([1.0])
