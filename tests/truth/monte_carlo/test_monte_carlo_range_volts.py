"""GUM supplement 1 for ranges by a voltmeter: few readings to a turn, on a table that turns unevenly and wobbles.

As in `test_monte_carlo_range.py`, whose accelerometer and bench these are, with the volts that it makes.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from bench.methods.rate_table.method import ACCELEROMETER_RANGE
from bench.methods.rate_table.reduction.range import reduce_accelerometer
from bench.metrology.acquisition import Motion
from bench.metrology.bench_uncertainty import AxisRecord
from tests.support.monte_carlo import found_in, ratio, scatter_is_u
from tests.support.table_runs import READ, TIME_S, data, read
from tests.truth.monte_carlo import test_monte_carlo_range as counted
from tests.truth.monte_carlo.test_monte_carlo_range import HARMONICS_U_DEG, K2, OF_THE_ACCELEROMETER, RADIUS_M

TRIALS = 100
BY_WEIGHTS = "nonlinearity/quadratic"
V_PER_G, NOISE_V = 0.226, 2e-6
GAIN_U, OFFSET_U_V, WOBBLE_U_DEG = 1e-5, 1e-6, 4e-4
EVERY_S, APERTURE_S = 0.1, 0.05
READ_S = np.arange(0.06, 2.9, EVERY_S)
INSIDE = (np.arange(40) + 0.5) / 40 - 0.5  # of an aperture
RIPPLE, ORDERS = 1e-4, np.array([1, 2, 24])
BENCH = replace(
    counted.BENCH, axes={"table": AxisRecord(harmonics_u_deg=HARMONICS_U_DEG, wobble_u_deg=WOBBLE_U_DEG)},
    voltmeters_u={"dvm": (GAIN_U, OFFSET_U_V)},
)  # fmt: skip
ACCELEROMETER = ACCELEROMETER_RANGE.settings.model_validate(
    {"scale": "226 mV/g", "scale_u": "30 ppm", "scale_per_degree_u": "60 ppm/°C", "full_scale": "20 g", "clip": "21 g"}
).model_dump()


class Errors(counted.Errors):
    """Those of the bench in one draw, its voltmeter and its table among them."""

    def __init__(self, rng):
        super().__init__(rng)
        self.gain, self.offset_v = GAIN_U * rng.standard_normal(), OFFSET_U_V * rng.standard_normal()
        self.wobble_rad = np.radians(WOBBLE_U_DEG) * rng.standard_normal(2)
        self.phases = rng.uniform(0, 2 * np.pi, 3)

    def waves(self, even_deg):
        """Angles of the orders of the ripple, (3, ...)."""
        return np.multiply.outer(ORDERS, np.radians(even_deg)) + self.phases.reshape(-1, *np.ones_like(even_deg.shape))

    def turned_deg(self, even_deg):
        ahead = np.degrees(RIPPLE / ORDERS)
        return even_deg + np.tensordot(ahead, np.sin(self.waves(even_deg)), 1)

    def tilted_g(self, angle):
        """What a tilt of the axis, and one that comes once a turn, make of gravity."""
        comes = self.wobble_rad[0] * np.cos(angle) + self.wobble_rad[1] * np.sin(angle)
        return self.tilt_rad[0] * np.cos(angle) + self.tilt_rad[1] * np.sin(angle) + comes * np.cos(angle)


def centrifuge_run(rng, errors):
    scale = V_PER_G * (1 + counted.SCALE_U * rng.standard_normal())

    def at(pull_g, sense=1, angle_deg=0.0):
        rate_dps = sense * counted.centrifuge_dps(pull_g)
        even_deg = angle_deg + rate_dps * np.add.outer(READ_S, APERTURE_S * INSIDE) * (1 + errors.clock)
        angle = np.radians(errors.turned_deg(even_deg))
        true_dps = rate_dps * (1 + RIPPLE * np.sum(np.cos(errors.waves(even_deg)), axis=0))
        pulled_g = np.radians(true_dps) ** 2 * RADIUS_M / errors.gravity_mps2
        felt_g = counted.BIAS_G + pulled_g * (1 + K2 * pulled_g) + errors.tilted_g(angle)
        volts = scale * np.mean(felt_g, axis=-1) * (1 + errors.gain) + errors.offset_v
        latched_deg = errors.turned_deg(angle_deg + rate_dps * TIME_S * (1 + errors.clock))
        motion = Motion("table", rate_dps) if rate_dps else None
        found = read(
            READ_S * (1 + 2e-5), volts + NOISE_V * rng.standard_normal(len(READ_S)), errors.read_deg(latched_deg),
            motion=motion,
        )  # fmt: skip
        found.angles_deg["table"] = angle_deg
        found.temperatures_c["warm"][:] = 20
        return found

    rests = [[at(0.0, angle_deg=angle_deg) for angle_deg in counted.REST_DEG] for _ in range(2)]
    turning = [at(g, sense) for g in (*counted.LOW_G, *counted.HIGH_G) for sense in (1, -1)]
    return data(*rests[0], *turning, *rests[1], unit=READ, bench=BENCH)


@lru_cache
def centrifuges(count=TRIALS):
    rng = np.random.default_rng(4)
    runs = (centrifuge_run(rng, Errors(rng)) for _ in range(count))
    return found_in(
        ((reduce_accelerometer(run, ACCELEROMETER)[0], OF_THE_ACCELEROMETER) for run in runs),
        counted.u_of_what_was_drawn,
    )


@pytest.mark.parametrize("quantity", [each for each in OF_THE_ACCELEROMETER if each != BY_WEIGHTS])
def test_the_uncertainties_of_a_range_by_volts_are_those_of_repeated_runs(quantity):
    rows = centrifuges()[quantity]
    assert scatter_is_u(rows), ratio(rows)


def test_what_points_weighted_by_their_own_scatter_tell_is_a_tenth_less_certain_than_it_says():
    """Some 17 degrees of freedom tell the scatter of a point, and so its weight, which errs with it."""
    assert 0.9 < ratio(centrifuges()[BY_WEIGHTS]) < 1.25
