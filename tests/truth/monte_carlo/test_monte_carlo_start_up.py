"""GUM supplement 1 for the start-up of inertial units: all inputs drawn, and pushed through the real reduction.

As in `test_monte_carlo.py` the scatter of the results has to be as large as their analytic uncertainties say. What was
left after compensation dies away with one of the time constants that the method takes: what others would make of it is
drawn by nobody, and left out of the uncertainty.
"""

from dataclasses import replace
from functools import lru_cache
from unittest import mock

import numpy as np
import pytest

from bench.methods.imu.method import IMU_START_UP
from bench.methods.imu.reduction import windows as imu_windows
from bench.methods.imu.reduction.attitudes import NAMES
from bench.methods.imu.reduction.table_errors import table_errors
from bench.methods.imu.start_up import run as imu_start_up
from bench.methods.imu.start_up.run import MODEL, reduce
from bench.metrology.acquisition import Turned, Window
from bench.metrology.calibration.temperature import Compensation
from bench.metrology.orientation import unit_axes
from bench.metrology.results.curves import Constant
from bench.metrology.run_data import ReleasedCalibration, RunData
from tests.support.monte_carlo import found_in, ratio, scatter_is_u, would_be_seen
from tests.truth.monte_carlo.test_monte_carlo_imu import (
    CHANNELS,
    EARTH_DPS,
    POINTS,
    THERMOMETERS,
    UNIT,
    Run,
    angles_of_attitudes,
    bench,
    window,
)

TRIALS = 120
K1, KG, NOISE_G, RANDOM_WALK = 11_300.0, 20_000.0, 2e-5, 1e-5  # of a mean over 1 s, in g and in °/s
KNOWN_MPS2, KNOWN_U_MPS2 = 9.79, 1e-4
SETTINGS = IMU_START_UP.settings.model_validate(
    {
        "time_constants": ["100 s", "300 s"],
        "misalignment": "0.5 mrad",
        "accelerometer_zero": "150 µg",
        "accelerometer_scale": "500 ppm",
        "gyro_zero": "0.18 °/h",
    }
).model_dump()
TAU_S = SETTINGS["time_constants_s"][1]
LIMITS = {"K0": 150e-6, "K1": 500e-6, "D0": 5e-5, "KG": 50e-6}
AT_POWER_ON = {quantity: 2 * limit for quantity, limit in LIMITS.items()}
POWER_ON_S, PASSES, EVERY_S, DWELL_S, RATE_DPS = (0.0, 0.2), 7, 13.0, 10.0, 30.0
CHANNELS_OF_THE_CALIBRATION = {
    name: Compensation(name, "pulse/s", "g", Constant(K1, "")) if name.startswith("acc")
    else Compensation(name, "pulse/s", "°/s", Constant(KG, ""))
    for name in CHANNELS
}  # fmt: skip
SUPPLIED = replace(
    UNIT, supply="psu",
    released=ReleasedCalibration(CHANNELS_OF_THE_CALIBRATION, KNOWN_MPS2, KNOWN_U_MPS2),
)  # fmt: skip


def left(quantity, since_s):
    return AT_POWER_ON[quantity] * np.exp(-since_s / TAU_S)


class Watch:
    """A unit from power-on, on a bench with errors drawn."""

    def __init__(self, rng):
        self._rng, self.table = rng, Run(rng, bench(1), ())
        self._known_mps2 = KNOWN_MPS2 + KNOWN_U_MPS2 * rng.standard_normal()
        self._misaligned = np.eye(3) + SETTINGS["misalignment_rad"] * rng.standard_normal((3, 3)) * (1 - np.eye(3))
        self.acquisitions = []
        for _ in range(PASSES):
            for axis in range(3):
                up, down = 8 * axis, 8 * axis + 7
                self._rest(up)
                for rate_dps in (RATE_DPS, -RATE_DPS):
                    self._turn(up, axis, rate_dps)
                self._rest(down)

    def _rest(self, attitude):
        orientation = self.table.axes(angles_of_attitudes()[attitude])
        self._read(attitude, orientation[:, 2], self._misaligned @ orientation @ EARTH_DPS, DWELL_S)

    def _turn(self, attitude, axis, rate_dps):
        up = self.table.base.apply(POINTS["outer"])
        self._read(attitude, np.zeros(3), np.eye(3)[axis] * (up @ EARTH_DPS + rate_dps), 360 / abs(rate_dps), rate_dps)

    def _read(self, attitude, force_g, rate_dps, span_s, turning_dps=None):
        begin_s = EVERY_S * len(self.acquisitions) + 5.0
        since_s = begin_s + span_s / 2 - np.mean(POWER_ON_S)
        draw, ratio_of_g = self._rng.standard_normal, self.table.gravity_mps2 / self._known_mps2
        seen_g = force_g * ratio_of_g * (1 + left("K1", since_s)) + left("K0", since_s)
        seen_dps = rate_dps * (1 + left("KG", since_s)) + left("D0", since_s)
        noisy_g, noisy_dps = NOISE_G / np.sqrt(span_s) * draw(3), RANDOM_WALK / np.sqrt(span_s) * draw(3)
        pulses = np.concatenate([K1 * (seen_g + noisy_g), KG * (seen_dps + noisy_dps)]) * span_s
        reported_s = span_s * (1 + self.table.clock)
        counted = np.floor(pulses + self._rng.uniform(size=6))
        turned = None if turning_dps is None else Turned(
            "outer", turning_dps, begin_s, 0.0, begin_s + span_s, turning_dps * span_s
        )  # fmt: skip
        self.acquisitions.append(
            window(
                angles_of_attitudes()[attitude], step=f"steps/{len(self.acquisitions)}/{NAMES[attitude]}",
                group="steps/cold", begin_s=begin_s, end_s=begin_s + span_s, turned=turned,
                on_since_s={"psu": POWER_ON_S}, temperatures_c={name: np.array([20.0]) for name in THERMOMETERS},
                temperatures_at_s={name: np.zeros(1) for name in THERMOMETERS},
                windows={
                    name: Window(net / reported_s, reported_s, span_s, ())
                    for name, net in zip(CHANNELS, counted, strict=True)
                },
            )
        )  # fmt: skip


def truths(data):
    """True values of what is found, from the first to the last reading of their kind and axis."""
    middle_s = {each.step: (each.begin_s + each.end_s) / 2 - np.mean(POWER_ON_S) for each in data.acquisitions}
    found = {}
    for quantity in AT_POWER_ON:
        found[f"{quantity}/power_on"] = lambda each, quantity=quantity: left(
            quantity, min(middle_s[step] for step in each.steps)
        )
        found[f"{quantity}/warm"] = lambda each, quantity=quantity: left(
            quantity, max(middle_s[step] for step in each.steps)
        )
        settled_s = TAU_S * np.log(AT_POWER_ON[quantity] / LIMITS[quantity])
        found[f"{quantity}/settling"] = lambda _, settled_s=settled_s: settled_s
    return found


def known_axes(acquisition, *_):
    """The attitudes are the same in every draw, and with them what the errors of the table do."""
    return _axes_at(tuple(acquisition.angles_deg.values()))


def known_table_errors(windows, *_):
    return _table_errors_at(tuple(tuple(each.angles_deg.values()) for each in windows))


@lru_cache
def _table_errors_at(angles_deg):
    return table_errors([window(dict(zip(POINTS, each, strict=True))) for each in angles_deg], UNIT, bench(1))


@lru_cache
def _axes_at(angles_deg):
    return unit_axes(window(dict(zip(POINTS, angles_deg, strict=True))), UNIT, bench(0))


def u_of_what_was_drawn(found, _):
    return float(np.linalg.norm([line.u for line in found.budget if line.source != MODEL]))


@lru_cache
def trials(count=TRIALS, seed=1):
    rng, found = np.random.default_rng(seed), []
    with (
        mock.patch.object(imu_windows, "unit_axes", known_axes),
        mock.patch.object(imu_start_up, "table_errors", known_table_errors),
    ):
        for _ in range(count):
            watch = Watch(rng)
            data = RunData("start_up", (SUPPLIED,), tuple(watch.acquisitions), watch.table.record)
            found.append((reduce(data, SETTINGS)[0], truths(data)))
    return found_in(found, u_of_what_was_drawn)


QUANTITIES = tuple(f"{quantity}/{what}" for quantity in AT_POWER_ON for what in ("power_on", "warm", "settling"))


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_the_uncertainties_of_a_start_up_are_those_of_repeated_ones(quantity):
    rows = trials()[quantity]
    assert len(rows) == 3 * TRIALS
    assert scatter_is_u(rows), ratio(rows)


def test_every_finding_of_a_start_up_is_tried():
    assert set(trials()) == set(IMU_START_UP.quantities)


def test_an_uncertainty_that_is_15_percent_off_is_seen():
    assert would_be_seen(trials()["K1/warm"])
