"""A channel calibrated on one ramp at 1 g, its velocity compensated on another ramp at another level (equations 2)."""

import numpy as np
import pytest

from bench.methods.channel.reduction.line import ChannelRecord, ChannelRules, reduce_run
from bench.metrology.velocity import ChannelModel, VelocityRecord, compare_velocity
from tests.support.m0_cases import COLUMNS, T_REF_C, Channel, ramp_c, run_columns

G_MPS2 = 9.80665
PURE = Channel(scale_per_c=1e-5, zero_pps=0.0)  # all of its drift in proportion to the level
RULES = ChannelRules(T_REF_C, counter_bits=32, max_rate_pps=256e3)


def calibrated(rng):
    """The normalised model of a run at 1 g, as M0 shares it with other levels."""
    columns = run_columns(rng, PURE, 1.0)
    run = reduce_run(ChannelRecord(*(columns[name] for name in COLUMNS)), RULES)
    u = np.array([run.u_rate, 0.0, run.u_relative_slope_per_c, 0.0])
    return ChannelModel(
        reference_c=T_REF_C, scale_pps_per_g=run.rate, bias_g=0.0, scale_drift_per_c=run.relative_slope_per_c,
        offset_drift_pps_per_c=0.0, covariance=np.diag(u**2),
    )  # fmt: skip


def cooled(rng, level_g):
    """Another run of an hour, from 55 °C to 30 °C, whose pulses are the only noise."""
    time_s, converter_c = ramp_c(low_c=55, high_c=30)
    columns = run_columns(rng, PURE, level_g, time_s=time_s, converter_c=converter_c, noise_counts=0.0)
    pulses = np.diff(columns["cum_pos"] - columns["cum_neg"]) % 2.0**32
    return VelocityRecord(time_s, np.concatenate(([0.0], np.cumsum(pulses))), time_s, columns["T_conv_C"])


def test_compensated_velocity_is_right_within_its_uncertainty():
    rng, ratios = np.random.default_rng(20_240_607), []
    for _ in range(25):
        found = compare_velocity(cooled(rng, 0.577), calibrated(rng), force_g=0.577, gravity_mps2=G_MPS2)
        ratios.append(found.compensated.error_mps / found.compensated.u_mps)
        # 10 ppm/°C over a mean of 12.5 °C for an hour: 125 ppm of 20 km/s is 2.5 m/s.
        assert found.raw.error_mps == pytest.approx(0.577 * G_MPS2 * 3600 * 125e-6, rel=0.02)
        assert abs(found.compensated.error_mps) < 0.05 * found.raw.error_mps
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.4
