"""GUM supplement 1 for the calibration of inertial units: all inputs drawn, and pushed through the real reduction.

As in `test_monte_carlo.py` the scatter of the results has to be as large as their analytic uncertainties say: on a
perfect bench, where noise and counting are all there is, and on one with every error that a certificate bounds.
"""

from functools import lru_cache
from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.methods.imu.method import IMU_CALIBRATION
from bench.methods.imu.reduction.attitudes import BODY_AXES, EARTH_RATE_DPS, NAMES
from bench.methods.imu.reduction.run import reduce
from bench.metrology.acquisition import Acquisition, Turned, Window
from bench.metrology.bench_uncertainty import AxisRecord, BenchRecord
from bench.metrology.orientation import unit_axes
from bench.metrology.run_data import RunData, UnitUnderTest

ARCSEC_DEG = 1 / 3600
POINTS = {"outer": (0.0, 0.0, 1.0), "middle": (0.0, 1.0, 0.0), "inner": (1.0, 0.0, 0.0)}
THERMOMETERS = {"ta": (0.1, 1e-3), "tg": (0.1, 1e-3)}
CHANNELS = {f"{sensor}_{axis}": f"{sensor}_{axis}" for sensor in ("acc", "gyro") for axis in "xyz"}
UNIT = UnitUnderTest("a", "S1", "", 0.0, "ta", channels=CHANNELS, gyro_temperature="tg")
LATITUDE_DEG = 34.25
EARTH_DPS = EARTH_RATE_DPS * np.array([0.0, np.cos(np.radians(LATITUDE_DEG)), np.sin(np.radians(LATITUDE_DEG))])

SET_C, DWELL_S, RATE_DWELL_S = (20.0, 50.0, 20.0, -20.0), 20.0, 12.0
RATES_DPS = (10.0, -10.0, 20.0, -20.0, 30.0, -30.0)
MISALIGNMENT = np.array([[1, 3e-4, -5e-4], [-4e-4, 1, 6e-4], [2e-4, 7e-4, 1]])
GYRO_MISALIGNMENT = np.array([[1, 5e-4, 2e-4], [-3e-4, 1, -6e-4], [4e-4, 1e-4, 1]])
G_SENSITIVITY = np.array([[0.1, 0.04, -0.03], [-0.05, 0.08, 0.02], [0.03, -0.02, 0.12]]) / 3600
K2 = np.array([35e-6, -3e-6, 5e-6])
NOISE_G, RANDOM_WALK = 2e-6 * np.sqrt(0.5), 0.01 / 60  # of a mean over 1 s, in g and in °/s


def bench(size):
    """A bench with the usual uncertainties, or, with size 0, a perfect one."""
    axis = {"zero_u_deg": 2, "harmonics_u_deg": (1, 1), "repeatability_u_deg": 0.25}
    u = {name: tuple(np.array(value) * ARCSEC_DEG * size) if isinstance(value, tuple) else value * ARCSEC_DEG * size
         for name, value in axis.items()}  # fmt: skip
    return BenchRecord(
        gravity_mps2=9.8, gravity_u_mps2=2e-4 * size, axes={role: AxisRecord(to, **u) for role, to in POINTS.items()},
        x=(1.0, 0.0, 0.0), z=(0.0, 0.0, 1.0), level_deg=0.0, level_u_deg=2 * ARCSEC_DEG * size,
        time_base_u=0.5e-6 * size, latitude_deg=LATITUDE_DEG, azimuth_u_deg=10 * ARCSEC_DEG * size,
        orthogonality_u_deg=2 * ARCSEC_DEG * size,
        thermometers_u={name: (offset * size, gain * size) for name, (offset, gain) in THERMOMETERS.items()},
    )  # fmt: skip


def window(angles_deg, **more):
    empty = {"counts": {}, "temperatures_c": {}, "temperatures_at_s": {}}
    fields = {"step": "s", "group": "g", "loops": {}, "begin_s": 0.0, "end_s": 1.0, "set_from_c": 20.0, "set_c": 20.0}
    return Acquisition(**{**empty, **fields, "angles_deg": angles_deg, **more})


@lru_cache
def angles_of_attitudes():
    """Angles of the table for each of the 24 attitudes."""
    found = {}
    for turns in product((0.0, 90.0, 180.0, -90.0), repeat=3):
        angles_deg = dict(zip(POINTS, turns, strict=True))
        axes = unit_axes(window(angles_deg), UNIT, bench(0))
        found.setdefault(int(np.argmax(np.einsum("kij,ij->k", BODY_AXES, axes))), angles_deg)
    return [found[number] for number in range(len(NAMES))]


def constants(temperature_c):
    """Of x, y and z at a true temperature."""
    away_c = temperature_c - 20
    return {
        "K0": np.array([8e-4, -1.3e-3, 4e-4]) + np.array([10e-6, 12e-6, 8e-6]) * away_c + K2,
        "K1": np.full(3, 11_300.0) * (1 - 58e-6 * away_c),
        "D0": (np.array([1.0, -1.6, 0.7]) + np.array([0.02, -0.015, 0.025]) * away_c) / 3600,
        "KG": 4000.0 * (1 + np.array([60e-6, 55e-6, 64e-6]) * away_c),
    }


class Run:
    """A calibration on a bench with errors drawn, and the errors."""

    def __init__(self, rng, record, set_points=SET_C):
        self._rng, self.record, draw = rng, record, rng.standard_normal
        self._zero_deg = {role: axis.zero_u_deg * draw() for role, axis in record.axes.items()}
        self._harmonics_deg = {
            role: np.array(axis.harmonics_u_deg)[:, np.newaxis] * draw((2, 2)) for role, axis in record.axes.items()
        }
        self._apart_deg = {role: record.orthogonality_u_deg * draw(2) for role in ("middle", "inner")}
        self.base = Rotation.from_rotvec(
            np.radians([record.level_u_deg, record.level_u_deg, record.azimuth_u_deg]) * draw(3)
        )
        self.clock = record.time_base_u * draw()
        self._thermometers = {name: u * draw(2) for name, u in record.thermometers_u.items()}
        self.gravity_mps2 = record.gravity_mps2 + record.gravity_u_mps2 * draw()
        self.acquisitions = []
        for visit, set_c in enumerate(set_points):
            for axis in range(3):
                self._visit(f"steps/temperature={visit}", set_c, axis)

    def _visit(self, group, set_c, axis):
        angles = angles_of_attitudes()
        for number in range(8 * axis, 8 * axis + 8):
            orientation = self.axes(angles[number])
            self._count(
                f"{group}/{NAMES[number]}",
                group,
                set_c,
                angles[number],
                orientation[:, 2],
                orientation @ EARTH_DPS,
                DWELL_S,
            )
        angles_deg = angles[8 * axis]  # the axis up, on the outer axis of the table
        for rate_dps in RATES_DPS:
            up = self.axes(angles_deg) @ self.base.apply(POINTS["outer"])
            base_up = self.base.apply(POINTS["outer"])  # what is across it is gone after a whole turn
            span_s = np.ceil(abs(rate_dps) * RATE_DWELL_S / 360 - 1e-9) * 360 / abs(rate_dps)
            seen_dps, step = up * (base_up @ EARTH_DPS + rate_dps), f"{group}/{axis}/rate={rate_dps:g}"
            self._count(step, group, set_c, angles_deg, up * base_up[2], seen_dps, span_s, rate_dps)

    def axes(self, angles_deg):
        """The axes of the unit in the level frame, as the table with its errors has them."""
        turned = self.base
        for role, to in POINTS.items():
            points, turn = np.array(to), np.radians(angles_deg[role])
            if role in self._apart_deg:
                across = np.stack([points[[2, 0, 1]], points[[1, 2, 0]]])
                points = Rotation.from_rotvec(np.radians(self._apart_deg[role] @ across)).apply(points)
            shape = np.array([[np.cos(turn), np.sin(turn)], [np.cos(2 * turn), np.sin(2 * turn)]])
            error_deg = self._zero_deg[role] + np.sum(self._harmonics_deg[role] * shape)
            error_deg += self.record.axes[role].repeatability_u_deg * self._rng.standard_normal()
            turned = turned * Rotation.from_rotvec((turn + np.radians(error_deg)) * points)
        return turned.as_matrix().T

    def _count(self, step, group, set_c, angles_deg, force_g, rate_dps, span_s, turning_dps=None):
        unit, draw = constants(set_c), self._rng.standard_normal
        noise_g, noise_dps = NOISE_G / np.sqrt(span_s) * draw(3), RANDOM_WALK / np.sqrt(span_s) * draw(3)
        seen_g = unit["K0"] - K2 + MISALIGNMENT @ force_g + K2 * force_g**2 + noise_g
        seen_dps = unit["D0"] + GYRO_MISALIGNMENT @ rate_dps + G_SENSITIVITY @ force_g + noise_dps
        pulses = np.concatenate([unit["K1"] * seen_g, unit["KG"] * seen_dps]) * span_s
        counted, reported_s = np.floor(pulses + self._rng.uniform(size=6)), span_s * (1 + self.clock)
        begin_s = 60.0 * len(self.acquisitions)
        from_deg = angles_deg["outer"]
        self.acquisitions.append(
            window(
                angles_deg, step=step, group=group, begin_s=begin_s, end_s=begin_s + span_s, set_from_c=set_c,
                set_c=set_c, temperatures_at_s={name: np.zeros(1) for name in THERMOMETERS},
                temperatures_c={
                    name: np.array([set_c * (1 + gain) + offset_c])
                    for name, (offset_c, gain) in self._thermometers.items()
                },
                windows={
                    name: Window(net / reported_s, reported_s, span_s, ())
                    for name, net in zip(CHANNELS, counted, strict=True)
                },
                turned=None if turning_dps is None else Turned(
                    "outer", turning_dps, begin_s, from_deg, begin_s + span_s, from_deg + turning_dps * span_s
                ),
            )
        )  # fmt: skip

    def truth(self, finding):
        axis, quantity = "xyz".index(finding.at["axis"]), finding.quantity
        if "toward" in finding.at:
            matrix = {"misalignment": MISALIGNMENT, "gyro_misalignment": GYRO_MISALIGNMENT}.get(quantity, G_SENSITIVITY)
            return matrix[axis, "xyz".index(finding.at["toward"])]
        at_c = constants(finding.at["temperature_c"]) | {"K2": K2}
        return at_c["K1"][axis] / self.gravity_mps2 if quantity == "K1_si" else at_c[quantity][axis]


@lru_cache
def trials(number, size):
    """Errors and uncertainties at all set points, by quantity, (n, 2)."""
    rng, settings = np.random.default_rng(1), IMU_CALIBRATION.settings.model_validate({}).model_dump()
    found = {}
    for _ in range(number):
        run = Run(rng, bench(size))
        (result,) = reduce(RunData("imu", (UNIT,), tuple(run.acquisitions), run.record), settings)
        for each in result.findings:
            if "visit" in each.at:
                found.setdefault(each.quantity, []).append((each.value - run.truth(each), each.u))
    return {quantity: np.array(rows) for quantity, rows in found.items()}


QUANTITIES = ("K0", "K1", "K1_si", "K2", "misalignment", "D0", "KG", "g_sensitivity", "gyro_misalignment")


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_on_a_perfect_bench_noise_and_counting_are_all_there_is(quantity):
    """At the lowest rate a turn takes three times as long as at the highest, whose readings scatter most."""
    scatter, u = np.sqrt(np.mean(trials(25, 0)[quantity] ** 2, axis=0))
    assert scatter == pytest.approx(u, rel=0.1)


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_on_a_full_bench_every_error_of_it_is_in_the_budgets(quantity):
    scatter, u = np.sqrt(np.mean(trials(40, 1)[quantity] ** 2, axis=0))
    assert scatter == pytest.approx(u, rel=0.25), "few independent errors are common to all findings of a run"
