"""A channel calibrated on one ramp at 1 g, its velocity compensated on another ramp at another level (equations 2)."""

from dataclasses import replace

import numpy as np
import pytest

from bench.methods.channel.reduction.line import ChannelRecord, ChannelRules, reduce_run
from bench.metrology.calibration.force_terms import ForceTerms
from bench.metrology.calibration.temperature import Compensation
from bench.metrology.motion_records import CountRecord
from bench.metrology.results.curves import Constant, TemperatureModel
from bench.metrology.velocity import Gravity, integrate, specific_forces
from tests.support.m0_cases import COLUMNS, T_REF_C, Channel, ramp_c, run_columns

GRAVITY = Gravity(9.80665)
PURE = Channel(scale_per_c=1e-5, zero_pps=0.0)  # all of its drift in proportion to the level
RULES = ChannelRules(T_REF_C, counter_bits=32, max_rate_pps=256e3)
LEVEL_G, HOUR_S = 0.577, 3600.0


def calibrated(rng):
    """The normalised model of a run at 1 g, as M0 shares it with other levels."""
    columns = run_columns(rng, PURE, 1.0)
    run = reduce_run(ChannelRecord(*(columns[name] for name in COLUMNS)), RULES)
    scale = TemperatureModel(
        "", "", "", "pulse/s/g", T_REF_C, 1.0, (run.rate, run.slope_per_c),
        (run.u_rate, run.rate * run.u_relative_slope_per_c), valid_c=(10.0, 60.0),
    )  # fmt: skip
    return Compensation("x", "pulse/s", "g", scale, force=ForceTerms(Constant(0.0, "g/g²", 0.0), (0.0, 1.0)))


def cooled(rng):
    """Another run of an hour, from 55 °C to 30 °C, whose pulses are the only noise."""
    time_s, converter_c = ramp_c(low_c=55, high_c=30)
    columns = run_columns(rng, PURE, LEVEL_G, time_s=time_s, converter_c=converter_c, noise_counts=0.0)
    pulses = np.diff(columns["cum_pos"] - columns["cum_neg"]) % 2.0**32
    return CountRecord(time_s, columns["T_conv_C"], {"x": pulses})


def largest_error(record, known):
    """Largest error of the velocity over its uncertainty, and the error itself."""
    found = integrate(specific_forces(record, {"x": known})["x"], GRAVITY)
    away_mps = found.velocity_mps - GRAVITY.mps2 * LEVEL_G * (record.time_s - record.time_s[0])
    worst = int(np.argmax(np.abs(away_mps)))
    return float(away_mps[worst]), float(away_mps[worst] / found.u_mps[worst])


def test_compensated_velocity_is_right_within_its_uncertainty():
    rng, ratios = np.random.default_rng(20_240_607), []
    for _ in range(25):
        record, known = cooled(rng), calibrated(rng)
        at_reference = replace(known.scale, coefficients=(known.scale.coefficients[0], 0.0))
        raw_mps, _ = largest_error(record, replace(known, scale=at_reference))
        error_mps, ratio = largest_error(record, known)
        ratios.append(ratio)
        # 10 ppm/°C over a mean of 12.5 °C for an hour: 125 ppm of 20 km/s is 2.5 m/s.
        assert raw_mps == pytest.approx(LEVEL_G * GRAVITY.mps2 * HOUR_S * 125e-6, rel=0.02)
        assert abs(error_mps) < 0.05 * raw_mps
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.4
