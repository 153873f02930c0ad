"""GUM supplement 1 for the range of gyros and accelerometers: all inputs drawn, and pushed through the real reduction.

As in `test_monte_carlo.py` the scatter of the results has to be as large as their analytic uncertainties say. Errors of
the bench are as large beside the noise as they must be to be seen, and not those of a bench. The points lie on the
curve: what they may depart from it by is drawn by nobody, and left out.
"""

from functools import lru_cache

import numpy as np
import pytest

from bench.methods.rate_table.method import ACCELEROMETER_RANGE, GYRO_RANGE
from bench.methods.rate_table.reduction.range import reduce_accelerometer, reduce_gyro
from bench.metrology.acquisition import Motion
from bench.metrology.bench_uncertainty import AxisRecord, BenchRecord
from bench.metrology.calibration.linearity import DEPARTURE
from tests.support.monte_carlo import found_in, ratio, scatter_is_u, would_be_seen
from tests.support.table_runs import acquired, data

TRIALS = 250
TICKS, LATCHES = 4_000, 1001
TIME_S = np.arange(LATCHES) * TICKS * 1e-6
REST_DEG = (0.0, 90.0, 180.0, 270.0)
G, G_U, TIME_BASE_U = 9.8, 3e-4, 3e-5
HARMONICS_U_DEG = (8e-4, 5e-4)
BENCH = BenchRecord(
    gravity_mps2=G, gravity_u_mps2=G_U, axes={"table": AxisRecord(harmonics_u_deg=HARMONICS_U_DEG)},
    x=(1.0, 0.0, 0.0), z=(0.0, 0.0, 1.0), level_deg=0.0, level_u_deg=1e-3, time_base_u=TIME_BASE_U, thermometers_u={},
)  # fmt: skip


def u_of_what_was_drawn(found, _):
    return float(np.linalg.norm([line.u for line in found.budget if line.source != DEPARTURE]))


class Errors:
    """Those of the bench in one draw."""

    def __init__(self, rng):
        self._harmonics_deg = np.array(HARMONICS_U_DEG)[:, np.newaxis] * rng.standard_normal((2, 2))
        self.clock = TIME_BASE_U * rng.standard_normal()
        self.gravity_mps2 = G + G_U * rng.standard_normal()
        self.tilt_rad = np.radians(BENCH.level_u_deg) * rng.standard_normal(2)

    def read_deg(self, true_deg):
        orders = np.outer([1, 2], np.radians(true_deg))
        return true_deg + self._harmonics_deg[:, 0] @ np.cos(orders) + self._harmonics_deg[:, 1] @ np.sin(orders)


def acquisition(rng, errors, noise, pulses_of, *, rate_dps=0.0, angle_deg=0.0, warm_c=20.0):
    """One record; `pulses_of` tells the pulses by the true angle (n,) and the true time (n,)."""
    true_s = TIME_S * (1 + errors.clock)
    turned_deg = angle_deg + rate_dps * true_s
    pulses = pulses_of(turned_deg, true_s)
    residue = np.copysign(rng.uniform(), pulses[-1])  # it has gone the same way before
    walk = np.concatenate([[0.0], np.cumsum(noise * np.sqrt(TICKS * 1e-6) * rng.standard_normal(LATCHES - 1))])
    motion = Motion("table", rate_dps) if rate_dps else None
    found = acquired(
        pulses + walk, errors.read_deg(turned_deg), motion=motion, bits=32,
        residue=residue, ticks=TICKS,
    )  # fmt: skip
    found.angles_deg["table"] = angle_deg
    found.temperatures_c["warm"][:] = warm_c
    return found


# Gyro

SCALE_PPD, FULL_DPS = 4000.0, 400.0
BIAS_DPS, SCALE_ERROR, ASYMMETRY, CUBIC = 0.05, 2e-4, 3e-5, -1e-4
GYRO_NOISE = 3.0  # pulses per √s
RATES_DPS = (50.0, -50.0, 130.0, -130.0, 250.0, -250.0, 400.0, -400.0)  # at the lowest no whole turn
GYRO = GYRO_RANGE.settings.model_validate(
    {"scale": "4000 pulse/°", "full_scale": "400 °/s", "clip": "420 °/s"}
).model_dump()


def gyro_error_dps(rate_dps):
    return rate_dps * (SCALE_ERROR + ASYMMETRY * np.sign(rate_dps) + CUBIC * (rate_dps / FULL_DPS) ** 2)


def gyro_run(rng, errors):
    def at(rate_dps, angle_deg=0.0):
        read_dps = BIAS_DPS + rate_dps + gyro_error_dps(rate_dps)
        return acquisition(
            rng, errors, GYRO_NOISE, lambda _, true_s: SCALE_PPD * read_dps * true_s, rate_dps=rate_dps,
            angle_deg=angle_deg,
        )  # fmt: skip

    rests = [[at(0.0, angle_deg) for angle_deg in REST_DEG] for _ in range(2)]
    return data(*rests[0], *map(at, RATES_DPS), *rests[1], bench=BENCH)


OF_THE_GYRO = {
    "rest_rate": lambda _: BIAS_DPS,
    "rate_error": lambda found: gyro_error_dps(found.at["rate_dps"]),
    "rate_error/relative": lambda found: gyro_error_dps(found.at["rate_dps"]) / abs(found.at["rate_dps"]),
    "scale_error": lambda _: SCALE_ERROR,
    "asymmetry": lambda _: ASYMMETRY,
    "nonlinearity/cubic": lambda _: CUBIC,
}


@lru_cache
def gyros(count=TRIALS, seed=1):
    rng = np.random.default_rng(seed)
    runs = (gyro_run(rng, Errors(rng)) for _ in range(count))
    return found_in(((reduce_gyro(run, GYRO)[0], OF_THE_GYRO) for run in runs), u_of_what_was_drawn)


@pytest.mark.parametrize("quantity", OF_THE_GYRO)
def test_the_uncertainties_of_the_range_of_a_gyro_are_those_of_repeated_runs(quantity):
    rows = gyros()[quantity]
    assert scatter_is_u(rows), ratio(rows)


# Accelerometer

SCALE_PPS, FULL_G, RADIUS_M = 11_300.0, 20.0, 0.5
BIAS_G, K2, SCALE_U, PER_C_U = 1e-3, 2e-5, 3e-5, 6e-5
ACCELEROMETER_NOISE = 1.5  # pulses per √s
LOW_G, HIGH_G, WARMER_C = (0.55, 1.0), (5.0, 20.0), 0.3
ACCELEROMETER = ACCELEROMETER_RANGE.settings.model_validate(
    {"scale": "11300 pulse/s/g", "scale_u": "30 ppm", "scale_per_degree_u": "60 ppm/°C", "full_scale": "20 g",
     "clip": "21 g"}
).model_dump()  # fmt: skip


def centrifuge_dps(pull_g):
    return float(np.degrees(np.sqrt(pull_g * G / RADIUS_M)))


def centrifuge_run(rng, errors):
    scale = SCALE_PPS * (1 + SCALE_U * rng.standard_normal())
    per_c = PER_C_U * rng.standard_normal()

    def at(pull_g, sense=1, angle_deg=0.0, warmer_c=0.0):
        rate_dps = sense * centrifuge_dps(pull_g)
        pulled_g = np.radians(rate_dps) ** 2 * RADIUS_M / errors.gravity_mps2
        steady_g = BIAS_G + pulled_g * (1 + K2 * pulled_g)

        def pulses_of(turned_deg, true_s):
            angle, turning = np.radians(turned_deg), np.radians(rate_dps)
            wave = [np.sin(angle) - np.sin(angle[0]), np.cos(angle[0]) - np.cos(angle)] if turning else [0.0, 0.0]
            still = [np.cos(angle[0]), np.sin(angle[0])]
            tilted_gs = sum(
                tilt * (moved / turning if turning else at_rest * true_s)
                for tilt, moved, at_rest in zip(errors.tilt_rad, wave, still, strict=True)
            )
            return scale * (1 + per_c * warmer_c) * (steady_g * true_s + tilted_gs)

        return acquisition(
            rng, errors, ACCELEROMETER_NOISE, pulses_of, rate_dps=rate_dps, angle_deg=angle_deg, warm_c=20 + warmer_c
        )

    rests = [[at(0.0, angle_deg=angle_deg) for angle_deg in REST_DEG] for _ in range(2)]
    turning = [at(g, sense, warmer_c=WARMER_C * (g > 1)) for g in (*LOW_G, *HIGH_G) for sense in (1, -1)]
    return data(*rests[0], *turning, *rests[1], bench=BENCH)


LONGER = 1 + K2 * sum(g**3 for g in LOW_G) / sum(g**2 for g in LOW_G)  # the radius that the unit finds


def pull_error_g(found):
    pulled_g = np.radians(found.at["rate_dps"]) ** 2 * RADIUS_M / G
    return pulled_g * (1 + K2 * pulled_g - LONGER)


OF_THE_ACCELEROMETER = {
    "rest_output": lambda _: BIAS_G,
    "radius": lambda _: RADIUS_M * LONGER,
    "acceleration_error": pull_error_g,
    "acceleration_error/relative": lambda found: pull_error_g(found) / FULL_G,
    "scale_error": lambda _: 1 / LONGER - 1,
    "nonlinearity/quadratic": lambda _: K2 * FULL_G / LONGER**2,
}


@lru_cache
def centrifuges(count=TRIALS, seed=2):
    rng = np.random.default_rng(seed)
    runs = (centrifuge_run(rng, Errors(rng)) for _ in range(count))
    return found_in(
        ((reduce_accelerometer(run, ACCELEROMETER)[0], OF_THE_ACCELEROMETER) for run in runs), u_of_what_was_drawn
    )


@pytest.mark.parametrize("quantity", OF_THE_ACCELEROMETER)
def test_the_uncertainties_of_the_range_of_an_accelerometer_are_those_of_repeated_runs(quantity):
    rows = centrifuges()[quantity]
    assert scatter_is_u(rows), ratio(rows)


def test_every_finding_of_a_range_is_tried_but_the_count_of_saturated_points():
    rng = np.random.default_rng(3)
    for result, tried in (
        (reduce_gyro(gyro_run(rng, Errors(rng)), GYRO)[0], OF_THE_GYRO),
        (reduce_accelerometer(centrifuge_run(rng, Errors(rng)), ACCELEROMETER)[0], OF_THE_ACCELEROMETER),
    ):
        assert {found.quantity for found in result.findings} - {"saturated_points"} == set(tried)


def test_an_uncertainty_that_is_15_percent_off_is_seen():
    assert would_be_seen(centrifuges()["acceleration_error"])
