"""Method M2 on real data that others published, and beside their own program.

Of the three turns of the session that about z is here whole, so that the scale factor of gyro z is reduced as well;
those about x and y, which would be as many rows each again, are not.
"""

import numpy as np
import pytest

from bench.methods.imu.reduction import calibrate as imu_calibration
from bench.methods.imu.reduction.attitude_fit import fit_accelerometer, fit_gyro_of_known_scale
from bench.methods.imu.reduction.attitudes import BLOCK, HEADINGS
from bench.methods.imu.reduction.calibrate import calibrate
from bench.methods.imu.reduction.records import PositionRecord, RateReadings, RateRecord, arrange
from tests.support import imucal_session as published

# The published values are of whole sections, ours of 40 rows of each. So they differ by what 40 readings scatter: 1 of
# some 2,050 units for 1 g. Of 15 differences the largest is below 3.5 standard deviations 99 times in 100.
COVERAGE = 3.5
PER_G = published.GRAVITY_MPS2
RATES_DPS = np.array([60.0, -60, 90, -90, 120, -120])


@pytest.fixture(scope="module")
def sections():
    return published.sections()


@pytest.fixture(scope="module")
def means(sections):
    return published.in_attitudes({part: rows.mean(axis=0) for part, rows in sections.items()})


@pytest.fixture(scope="module")
def u_means(sections):
    """Standard deviation of a mean of each of the six sensors, pooled over the sections."""
    return np.sqrt(np.mean([rows.var(axis=0, ddof=1) / len(rows) for rows in sections.values()], axis=0))


@pytest.mark.parametrize("axis", range(3))
def test_a_published_accelerometer_has_its_published_bias_scale_and_misalignment(axis, means, u_means):
    found = fit_accelerometer(means[:, axis], axis)
    u = u_means[axis]
    # Their bias is the mean of up and down, which has K2 in it.
    bias = (found.k0_g + found.k2_g_per_g2) * found.k1_per_g
    assert abs(bias - published.B_A[axis]) < COVERAGE * u / np.sqrt(2)
    # Their K R is what one sensor reads for 1 m/s² along x, y and z: ours is K1 times (own axis 1, misalignments).
    per_mps2 = found.k1_per_g * (found.misalignment_rad + np.eye(3)[axis]) / PER_G
    away = per_mps2 - published.K_A[axis] * published.R_A[axis]
    assert (np.abs(away) < COVERAGE * u / np.sqrt(2) / PER_G).all(), away


@pytest.mark.parametrize("axis", range(3))
def test_a_published_gyro_has_its_published_zero(axis, means, u_means):
    # imucal leaves the earth's rate out: 0.07 units here, of a scatter of 0.5 in the mean of a section
    found = fit_gyro_of_known_scale(means[:, 3 + axis], axis, latitude_deg=0.0, pulse_per_deg=0.0)
    assert abs(found.d0 - published.B_G[axis]) < COVERAGE * u_means[3 + axis] / np.sqrt(6)


def test_a_published_gyro_has_its_published_scale_factor(sections):
    z, turn = 5, published.turn()
    span_s = len(turn) / published.RATE_HZ
    at_rest = [rows[:, z].mean() for rows in sections.values()]  # their zero, taken as read at rates of 0
    rate_dps, read = np.zeros(7), np.array([*at_rest, turn.mean()])
    rate_dps[-1] = published.TURN_DEG / span_s
    fit = imu_calibration._turning(RateReadings(rate_dps, np.full(7, span_s), read, np.full(7, 20.0), np.full(7, 20.0)))
    theirs = published.K_G[2] * published.R_G[2, 2]
    assert abs(fit.coefficients[1] - theirs) < COVERAGE * np.sqrt(fit.covariance[1, 1]) < 3e-3 * abs(theirs)
    # Less their own zero it is their own sum.
    zero = published.B_G[2] + published.K_GA_ZZ * PER_G
    assert np.sum(turn - zero) / published.RATE_HZ / published.TURN_DEG == pytest.approx(theirs, rel=1e-5)


@pytest.mark.peer("imucal")
def test_imucal_finds_the_same_of_the_same_readings(sections):
    """At rest the real ones, turns made up: the means and differences are the same sums, and differ by rounding."""
    scale = np.array([16.7, 16.2, 16.3])  # units per °/s
    zero = np.mean([rows[:, 3:].mean(axis=0) for rows in sections.values()], axis=0)
    theirs, ours = _imucal(sections, scale, zero), _calibrated(sections, scale, zero)
    for axis, found in enumerate(ours.points[0].axes):
        assert found.k0 == pytest.approx(theirs.b_a[axis], rel=1e-12)
        assert found.k1_per_g / PER_G == pytest.approx(theirs.K_a[axis, axis] * theirs.R_a[axis, axis], rel=1e-12)
        own_gyro = [sections[part][:, 3 + axis].mean() for part in published.PARTS[2 * axis : 2 * axis + 2]]
        assert found.d0 == pytest.approx(np.mean(own_gyro), rel=1e-12)
        # Theirs is the length of a row, and of one turn: what the bias of the horizontal accelerometers does to the
        # sensitivity to g that it takes off is some 0.01 units, of 1,500 while the gyro turns.
        assert found.kg_pulse_per_deg == pytest.approx(theirs.K_g[axis, axis], rel=1e-5)
    placed = published.in_attitudes({part: rows.mean(axis=0) for part, rows in sections.items()})
    for axis in range(3):
        found = fit_accelerometer(placed[:, axis], axis)
        theirs_per_g = PER_G * theirs.K_a[axis, axis] * theirs.R_a[axis]
        assert found.fit.coefficients[1:4] == pytest.approx(theirs_per_g, rel=1e-11)


def _imucal(sections, scale, zero):
    """What imucal finds, turned clockwise by 360° about each axis while that points up."""
    from imucal import FerrarisCalibration
    from imucal.ferraris_calibration import FerrarisSignalRegions

    rows = round(4 * published.RATE_HZ)
    regions = {f"{kind}_{part}": values[:, columns] for part, values in sections.items()
               for kind, columns in (("acc", slice(0, 3)), ("gyr", slice(3, 6)))}  # fmt: skip
    for axis, name in enumerate("xyz"):
        up, down = sections[f"{name}_p"].mean(axis=0), sections[f"{name}_a"].mean(axis=0)
        at_rest = zero + (up - down)[3:] / 2  # with its sensitivity to g
        rate_dps = -360.0 * published.RATE_HZ / rows
        regions[f"acc_{name}_rot"] = np.tile(up[:3], (rows, 1))
        regions[f"gyr_{name}_rot"] = np.tile(at_rest + np.eye(3)[axis] * scale * rate_dps, (rows, 1))
    calibration = FerrarisCalibration(grav=PER_G, expected_angle=-360.0)
    return calibration.compute(FerrarisSignalRegions(**regions), published.RATE_HZ, "a.u.", "a.u.")


def _calibrated(sections, scale, zero):
    """What M2 finds: the two sections of an axis stand for its eight attitudes."""
    by_block = [sections[part].mean(axis=0) for part in published.PARTS for _ in range(HEADINGS)]
    at_rest, warm = np.array(by_block), np.full((3 * BLOCK, 3), 20.0)
    positions = PositionRecord(
        set_c=np.full(3 * BLOCK, 20.0), attitude=np.arange(3 * BLOCK), dwell_s=np.ones(3 * BLOCK),
        accelerometer_counts=at_rest[:, :3], gyro_counts=at_rest[:, 3:], accelerometer_c=warm, gyro_c=warm,
    )  # fmt: skip
    axis, rate_dps = np.repeat(np.arange(3), len(RATES_DPS)), np.tile(RATES_DPS, 3)
    turning, warm = zero + np.eye(3)[axis] * scale * rate_dps[:, np.newaxis], np.full((len(axis), 3), 20.0)
    rates = RateRecord(
        set_c=np.full(len(axis), 20.0), axis=axis, command_dps=rate_dps, rate_dps=rate_dps, dwell_s=np.ones(len(axis)),
        gyro_counts=turning, accelerometer_c=warm, gyro_c=warm,
    )  # fmt: skip
    return calibrate(arrange(positions, rates, rate_tolerance=0.1), attitude_tolerance_g=100.0)
