"""GUM supplement 1 for frequency responses: all inputs drawn, and pushed through the real reduction.

As in `test_monte_carlo.py` the scatter of the results has to be as large as their analytic uncertainties say. Errors of
the bench are as large beside the noise as they must be to be seen, and not those of a bench. The straight line between
two frequencies errs by what is no chance: the truth is on it, and it is left out of the uncertainty. The pulses go one
way only, so that the converter has no play.
"""

from functools import lru_cache

import numpy as np
import pytest

from bench.methods.rate_table.method import ACCELEROMETER_RESPONSE, GYRO_RESPONSE
from bench.methods.rate_table.reduction.response import reduce_accelerometer, reduce_gyro
from bench.methods.rate_table.reduction.response_findings import CHORD
from bench.methods.rate_table.reduction.response_points import bandwidth
from bench.metrology.acquisition import Motion
from bench.metrology.bench_uncertainty import AxisRecord, BenchRecord
from simulators.physics.dynamics import Dynamics
from tests.support.monte_carlo import found_in, ratio, scatter_is_u, would_be_seen
from tests.support.table_runs import acquired, data

TRIALS = 300
G, G_U, TIME_BASE_U, SKEW_U_S = 9.8, 3e-3, 3e-4, 1e-6
LEVEL_U_DEG, WOBBLE_U_DEG, HARMONICS_U_DEG, ENCODER_NOISE_DEG = 5e-4, 5e-4, (6e-3, 4e-3), 5e-4
BENCH = BenchRecord(
    gravity_mps2=G, gravity_u_mps2=G_U,
    axes={"table": AxisRecord(harmonics_u_deg=HARMONICS_U_DEG, wobble_u_deg=WOBBLE_U_DEG)}, x=(1.0, 0.0, 0.0),
    z=(0.0, 0.0, 1.0), level_deg=0.0, level_u_deg=LEVEL_U_DEG, time_base_u=TIME_BASE_U, thermometers_u={},
    encoder_skew_u_s=SKEW_U_S,
)  # fmt: skip


class Errors:
    """Those of the bench in one draw."""

    def __init__(self, rng):
        self._rng = rng
        self._harmonics_deg = np.array(HARMONICS_U_DEG)[:, np.newaxis] * rng.standard_normal((2, 2))
        self.clock, self.skew_s = TIME_BASE_U * rng.standard_normal(), SKEW_U_S * rng.standard_normal()
        self.gravity_mps2 = G + G_U * rng.standard_normal()
        self.tilt_rad = np.radians(LEVEL_U_DEG) * rng.standard_normal(2)
        self.wobble_rad = np.radians(WOBBLE_U_DEG) * rng.standard_normal(2)

    def read_deg(self, true_deg):
        orders = np.outer([1, 2], np.radians(true_deg))
        lasting = self._harmonics_deg[:, 0] @ np.cos(orders) + self._harmonics_deg[:, 1] @ np.sin(orders)
        return true_deg + lasting + ENCODER_NOISE_DEG * self._rng.standard_normal(len(true_deg))


def swing(rng, errors, noise, charge, frequency_hz, amplitude_dps, *, latches, ticks=1000, warm_c=20.0):
    """One record; `charge` tells the pulses by the phase of the cosine of the rate, the angle in rad and the time."""
    interval_s = ticks * 1e-6
    true_s = np.arange(latches) * interval_s * (1 + errors.clock)
    phase = 2 * np.pi * frequency_hz * true_s + rng.uniform(0, 2 * np.pi)
    reach_deg = amplitude_dps / (2 * np.pi * frequency_hz)
    later = 2 * np.pi * frequency_hz * errors.skew_s
    walk = np.cumsum(noise * np.sqrt(interval_s) * rng.standard_normal(latches))
    found = acquired(
        charge(phase, true_s) + walk, errors.read_deg(reach_deg * np.sin(phase + later)),
        motion=Motion("table", amplitude_deg=reach_deg, frequency_hz=frequency_hz), residue=rng.uniform(), ticks=ticks,
    )  # fmt: skip
    found.temperatures_c["warm"][:] = warm_c
    return found


def straight_bandwidth(frequencies_hz, response):
    """Where a straight line through noiseless points falls to half the power, and its phase."""
    found = bandwidth(np.array(frequencies_hz), np.abs(response), np.degrees(np.unwrap(np.angle(response))))
    return found.frequency_hz, found.phase_deg


def u_of_what_was_drawn(found, result):
    """Without that of the straight line, also where it comes by way of the bandwidth."""
    lines = {line.source: line.u for line in found.budget if line.source != CHORD}
    if "bandwidth" in lines:
        (at,) = (each for each in result.findings if each.quantity == "bandwidth")
        of_band = {line.source: line.u for line in at.budget if line.source != "counter: time base"}
        drawn = [u for source, u in of_band.items() if source != CHORD]
        lines["bandwidth"] *= float(np.linalg.norm(drawn) / np.linalg.norm(list(of_band.values())))
    return float(np.linalg.norm(list(lines.values())))


# Gyro

SCALE_PPD, ONE_WAY, GYRO_DPS, GYRO_NOISE = 4000.0, 1.1e5, 20.0, 15.0  # pulses per √s
GYRO_HZ = (30.37, 57.37, 62.37)
SLOW = Dynamics(60.0, 0.65, 2e-3)
GYRO = GYRO_RESPONSE.settings.model_validate({"scale": "4000 pulse/°", "play": "0 pulse"}).model_dump()


def gyro_run(rng, errors):
    def at(hz):
        (response,) = SLOW.response(np.array([hz]))
        reach = GYRO_DPS / (2 * np.pi * hz) * SCALE_PPD

        def charge(phase, time_s):
            return reach * np.imag(response * np.exp(1j * phase)) + ONE_WAY * time_s

        return swing(rng, errors, GYRO_NOISE, charge, hz, GYRO_DPS, latches=501, ticks=2000)

    return data(*map(at, GYRO_HZ), bench=BENCH)


def of_response(frequencies_hz, response):
    """True values of what is found of noiseless responses."""
    at = dict(zip(frequencies_hz, response, strict=True))
    phase_deg = dict(zip(frequencies_hz, np.degrees(np.unwrap(np.angle(response))), strict=True))
    bandwidth_hz, there_deg = straight_bandwidth(frequencies_hz, response)
    return {
        "gain": lambda found: abs(at[found.at["frequency_hz"]]),
        "phase": lambda found: phase_deg[found.at["frequency_hz"]],
        "bandwidth": lambda _: bandwidth_hz,
        "phase_at_bandwidth": lambda _: there_deg,
    }


OF_THE_GYRO = of_response(GYRO_HZ, SLOW.response(np.array(GYRO_HZ)))


@lru_cache
def gyros(count=TRIALS, seed=1):
    rng = np.random.default_rng(seed)
    runs = (gyro_run(rng, Errors(rng)) for _ in range(count))
    return found_in(((reduce_gyro(run, GYRO)[0], OF_THE_GYRO) for run in runs), u_of_what_was_drawn)


@pytest.mark.parametrize("quantity", OF_THE_GYRO)
def test_the_uncertainties_of_the_response_of_a_gyro_are_those_of_repeated_runs(quantity):
    rows = gyros()[quantity]
    assert scatter_is_u(rows), ratio(rows)


# Accelerometer

SCALE_PPS, ONE_WAY_G, SCALE_U, PER_C_U, WARMER_C = 1e5, 3.0, 3e-4, 6e-5, 5.0
X_M, Y_M = 0.05, 0.06
ACCELEROMETER_NOISE = 2.0  # pulses per √s
LEVER_HZ, LEVER_DPS, ACCELEROMETER_DPS = 0.5, 100.0, 40.0
ACCELEROMETER_HZ = (30.37, 57.37, 62.37)
BEHIND = Dynamics(60.0, 0.7, 0.0)
ACCELEROMETER = ACCELEROMETER_RESPONSE.settings.model_validate(
    {
        "scale": "1e5 pulse/s/g",
        "scale_u": "300 ppm",
        "scale_per_degree_u": "60 ppm/°C",
        "lever_frequency": "0.5 Hz",
        "play": "0 pulse",
    }
).model_dump()


def accelerometer_run(rng, errors, lever_latches=1001):
    scale, per_c = SCALE_PPS * (1 + SCALE_U * rng.standard_normal()), PER_C_U * rng.standard_normal()

    def at(hz, amplitude_dps, warmer_c=0.0, **record):
        once, twice = BEHIND.response(np.array([hz, 2 * hz]))
        rate, turning = np.radians(amplitude_dps), 2 * np.pi * hz
        reach = rate / turning

        def charge(phase, time_s):
            tangential = -Y_M * rate * np.real(once * np.exp(1j * phase))
            centripetal = -X_M * rate**2 / 2 * (time_s + np.imag(twice * np.exp(2j * phase)) / (2 * turning))
            # Of the tilts what goes with the angle, and with its square; the channel is fast beside the slow swing.
            to_angle, to_square = errors.tilt_rad[0] + errors.wobble_rad[0], errors.tilt_rad[1]
            angle_s = -reach / turning * np.real(np.exp(1j * phase))
            square_s = -(reach**2) / (4 * turning) * np.imag(np.exp(2j * phase))
            doubled = square_s * (to_square / 2 + errors.wobble_rad[1])
            sensed = (tangential + centripetal) / errors.gravity_mps2 + to_angle * angle_s + doubled
            return scale * (1 + per_c * warmer_c) * (sensed + ONE_WAY_G * time_s)

        return swing(rng, errors, ACCELEROMETER_NOISE, charge, hz, amplitude_dps, warm_c=20 + warmer_c, **record)

    lever = at(LEVER_HZ, LEVER_DPS, latches=lever_latches, ticks=20_000)
    return data(
        lever, *(at(hz, ACCELEROMETER_DPS, WARMER_C, latches=501, ticks=2000) for hz in ACCELEROMETER_HZ), bench=BENCH
    )


def of_accelerometer():
    low, *response = BEHIND.response(np.array([LEVER_HZ, *ACCELEROMETER_HZ]))
    twice = BEHIND.response(np.array([2 * LEVER_HZ]))[0]
    relative = np.array(response) / abs(low)
    arms = {"lever_arm/x": lambda _: X_M * abs(twice), "lever_arm/y": lambda _: Y_M * abs(low)}
    return of_response(ACCELEROMETER_HZ, relative) | arms


OF_THE_ACCELEROMETER = of_accelerometer()


@lru_cache
def accelerometers(count=TRIALS, lever_latches=1001, seed=2):
    rng = np.random.default_rng(seed)
    runs = (accelerometer_run(rng, Errors(rng), lever_latches) for _ in range(count))
    found = ((reduce_accelerometer(run, ACCELEROMETER)[0], OF_THE_ACCELEROMETER) for run in runs)
    return found_in(found, u_of_what_was_drawn)


@pytest.mark.parametrize("quantity", OF_THE_ACCELEROMETER)
def test_the_uncertainties_of_the_response_of_an_accelerometer_are_those_of_repeated_runs(quantity):
    rows = accelerometers()[quantity]
    assert scatter_is_u(rows), ratio(rows)


def test_every_finding_of_a_response_is_tried():
    rng = np.random.default_rng(3)
    for result, tried in (
        (reduce_gyro(gyro_run(rng, Errors(rng)), GYRO)[0], OF_THE_GYRO),
        (reduce_accelerometer(accelerometer_run(rng, Errors(rng)), ACCELEROMETER)[0], OF_THE_ACCELEROMETER),
    ):
        other_way = {"gain/two_sample"}  # the same data as one of the gains
        assert {found.quantity for found in result.findings} - other_way == set(tried)


def test_an_uncertainty_that_is_15_percent_off_is_seen():
    assert would_be_seen(gyros()["phase"])
