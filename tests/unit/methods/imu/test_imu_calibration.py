import numpy as np
import pytest

from bench.methods.imu.reduction.attitude_check import doubtful_attitudes, exchanged_headings
from bench.methods.imu.reduction.attitude_fit import fit_accelerometer, fit_attitudes, fit_gyro, fit_gyro_of_known_scale
from bench.methods.imu.reduction.attitudes import NAMES, SPECIFIC_FORCE_G, earth_rate_dps
from bench.methods.imu.reduction.calibrate import calibrate
from bench.methods.imu.reduction.records import PositionRecord, RateRecord, arrange
from bench.metrology.least_squares import NotDetermined

LATITUDE_DEG = 34.25
RATES_DPS = np.array([1.0, -1, 3, -3, 5, -5])
NAN = float("nan")


def calibrated(accelerometer_pps, gyro_pps, rate_pps, *, set_c=None, dwell_s=120.0, latitude_deg=LATITUDE_DEG):
    """From readings (m, 24, 3) at rest and (m, 3, 6) while turning."""
    points = len(accelerometer_pps)
    set_c = np.arange(points) * 10.0 if set_c is None else set_c
    positions = PositionRecord(
        set_c=np.repeat(set_c, 24),
        attitude=np.tile(np.arange(24), points),
        dwell_s=np.full(24 * points, dwell_s),
        accelerometer_counts=accelerometer_pps.reshape(-1, 3) * dwell_s,
        gyro_counts=gyro_pps.reshape(-1, 3) * dwell_s,
        accelerometer_c=np.full((24 * points, 3), 20.0),
        gyro_c=np.full((24 * points, 3), 21.0),
    )
    rates = RateRecord(
        set_c=np.repeat(set_c, 18),
        axis=np.tile(np.repeat(np.arange(3), 6), points),
        command_dps=np.tile(RATES_DPS, 3 * points),
        rate_dps=np.tile(RATES_DPS, 3 * points),
        dwell_s=np.full(18 * points, dwell_s),
        gyro_counts=np.repeat(rate_pps.reshape(-1, 1), 3, axis=1) * dwell_s,
        accelerometer_c=np.full((18 * points, 3), 20.0),
        gyro_c=np.full((18 * points, 3), 21.0),
    )
    return calibrate(arrange(positions, rates, rate_tolerance=0.1), 0.05, latitude_deg)


def noisy(rng, points):
    """Random readings of a unit with zeros 0 and 3000 pulse/s and scale factors 1000 pulse/s/g and 4000 pulse/°."""
    accelerometer_pps = 1000 * SPECIFIC_FORCE_G + 0.3 * rng.standard_normal((points, 24, 3))
    gyro_pps = 3000 + 4000 * earth_rate_dps(LATITUDE_DEG) + 0.2 * rng.standard_normal((points, 24, 3))
    return accelerometer_pps, gyro_pps, 4000 * RATES_DPS + 0.5 * rng.standard_normal((points, 3, 6))


def test_the_formulas_as_printed():
    rng = np.random.default_rng(5)
    accelerometer_pps, gyro_pps, rate_pps = noisy(rng, 1)
    found = calibrated(accelerometer_pps, gyro_pps, rate_pps)
    for axis in range(3):
        own, w = slice(8 * axis, 8 * axis + 8), rate_pps[0, axis]
        eight, turning = accelerometer_pps[0, own, axis], found.points[0].axes[axis]
        assert turning.k0 == pytest.approx(eight.sum() / 8)
        assert turning.k1_per_g == pytest.approx((eight[:4].sum() - eight[4:].sum()) / 8, rel=1e-13)
        assert turning.d0 == pytest.approx(gyro_pps[0, own, axis].sum() / 8)
        slope = (1 * (w[0] - w[1]) + 3 * (w[2] - w[3]) + 5 * (w[4] - w[5])) / 70
        assert turning.kg_pulse_per_deg == pytest.approx(slope, rel=1e-13)
        assert turning.d0_dph == pytest.approx(3600 * turning.d0 / slope)
        assert (turning.accelerometer_c, turning.gyro_c) == (20, 21)


def test_uncertainties_of_the_table_tell_the_errors():
    rng = np.random.default_rng(11)
    ratios = []
    for _ in range(200):
        found = calibrated(*noisy(rng, 5))
        axis = int(rng.integers(3))
        of, u = found.points[2].axes[axis], found.points[2].axes[axis].uncertainty(found.scatter[axis])
        ratios.append([
            of.k0 / u.k0, (of.k1_per_g - 1000) / u.k1_per_g, (of.d0 - 3000) / u.d0,
            (of.d0_dph - 2700) / u.d0_dph, (of.kg_pulse_per_deg - 4000) / u.kg_pulse_per_deg,
        ])  # fmt: skip
    rms = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert ((rms > 0.85) & (rms < 1.15)).all(), rms


def test_uncertainties_of_the_least_squares_tell_the_errors():
    rng = np.random.default_rng(12)
    ratios = []
    for _ in range(1000):
        accelerometer_pps, gyro_pps, _ = noisy(rng, 1)
        accelerometer = fit_accelerometer(accelerometer_pps[0, :, 1], 1)
        gyro = fit_gyro(gyro_pps[0, :, 1], 1, LATITUDE_DEG)
        found = [accelerometer.k0_g, accelerometer.k1_per_g - 1000, accelerometer.k2_g_per_g2]
        found += [*accelerometer.misalignment_rad[[0, 2]], gyro.d0 - 3000, *gyro.g_sensitivity_per_g]
        u = [*accelerometer.u[[0, 1, 2, 3, 5]], gyro.u_d0, *gyro.u_g_sensitivity_per_g]
        ratios.append(np.array(found) / u)
        assert accelerometer.u[4] == accelerometer.misalignment_rad[1] == 0
    rms = np.sqrt(np.mean(np.square(ratios), axis=0))
    assert ((rms > 0.85) & (rms < 1.15)).all(), rms


def test_the_uncertainty_of_a_ratio_contains_that_of_its_scale_factor():
    # K0 is 0.5 g: an error of K1 by 1 % makes 0.5 % g of it.
    rng = np.random.default_rng(13)
    pps = 1000 * (0.5 + SPECIFIC_FORCE_G[:, 2] + 0.1 * SPECIFIC_FORCE_G[:, 0])
    found = [fit_accelerometer(pps + 20 * rng.standard_normal(24), 2) for _ in range(200)]
    for i, values in enumerate([[one.k0_g for one in found], [one.misalignment_rad[0] for one in found]]):
        u = np.sqrt(np.mean([one.u[3 * i] ** 2 for one in found]))
        assert np.std(values) == pytest.approx(u, rel=0.15)


def attempts(names):
    return [NAMES.index(name) for name in names]


def test_one_wrong_attitude_is_found_and_a_bias_is_none():
    pps = 1000 * (SPECIFIC_FORCE_G + 0.4)  # a bias of 0.4 g is not an attitude
    assert not doubtful_attitudes(pps, 0.05).any()
    pps[NAMES.index("Ay3"), 1] -= 51
    assert np.flatnonzero(doubtful_attitudes(pps, 0.05)).tolist() == attempts(["Ay3"])
    assert not doubtful_attitudes(pps, 0.06).any()
    pps[NAMES.index("Ay4"), 1] = NAN
    assert np.flatnonzero(doubtful_attitudes(pps, 0.05)).tolist() == attempts(["Ay3"])


def test_a_unit_that_was_not_turned_stood_wrong_everywhere():
    assert doubtful_attitudes(np.full((24, 3), 1000.0), 0.05).all()
    assert not doubtful_attitudes(np.full((24, 3), NAN), 0.05).any()


@pytest.mark.parametrize("latitude_deg", [34.25, -60.0, 0.0])
def test_exchanged_headings_are_seen_by_the_horizontal_gyros(latitude_deg):
    rng = np.random.default_rng(3)
    scale = np.array([4000.0, -4000.0, 500.0])
    drift_dps, sensitivity = np.array([0.1, -0.2, 0.3]), np.array([3.0, -2.0, 1.0])
    pps = scale * (earth_rate_dps(latitude_deg) + drift_dps) + SPECIFIC_FORCE_G * sensitivity
    horizontal_pps = scale * earth_rate_dps(0.0).max() * np.cos(np.radians(latitude_deg))
    quiet = pps + 0.08 * horizontal_pps * rng.standard_normal((24, 3))
    assert exchanged_headings(quiet, scale, latitude_deg) == ([], [])
    for pair in (["Ax2", "Ax3"], ["Ay5", "Ay7"], ["Az1", "Az4"]):
        swapped = quiet.copy()
        swapped[attempts(pair)] = quiet[attempts(pair[::-1])]
        assert exchanged_headings(swapped, scale, latitude_deg) == (attempts(pair), [])
    loud = pps + 0.5 * horizontal_pps * rng.standard_normal((24, 3))
    assert exchanged_headings(loud, scale, latitude_deg) == ([], list(range(24)))


def test_headings_are_not_told_at_a_pole_nor_without_a_scale_factor():
    pps = 4000 * earth_rate_dps(90.0)
    pps += 0.01 * np.random.default_rng(4).standard_normal((24, 3))
    assert exchanged_headings(pps, np.full(3, 4000.0), 90.0) == ([], list(range(24)))
    pps = 4000 * earth_rate_dps(0.0)
    of_x = list(range(8, 24))  # x is horizontal in the blocks of y and z
    assert exchanged_headings(pps, np.array([NAN, 4000, 4000]), 0.0) == ([], of_x)
    assert exchanged_headings(pps, np.array([0, 4000, 4000]), 0.0) == ([], of_x)


def test_what_too_few_attitudes_tell_is_named():
    own_only = np.where(SPECIFIC_FORCE_G[:, 0] != 0, 1000 * SPECIFIC_FORCE_G[:, 0], NAN)
    lumped = "K0 of acc_x, misalignment y, misalignment z and K2 are not determined by these readings \\(rank 2 of 5"
    with pytest.raises(NotDetermined, match=lumped):
        fit_accelerometer(own_only, 0)
    with pytest.raises(NotDetermined, match="not determined by these readings \\(rank 0 of 5"):
        fit_accelerometer(np.full(24, NAN), 0)
    with pytest.raises(NotDetermined, match=r"^g-sensitivity x, .*, g-sensitivity z, KG, misalignment y and misalign"):
        fit_gyro(4000 * earth_rate_dps(90.0)[:, 0], 0, 90.0)


def test_with_the_scale_factor_of_the_rates_a_pole_tells_the_own_sensitivity():
    sensitivity = np.array([0.4, -0.3, 0.2])
    pps = 2 + 4000 * earth_rate_dps(90.0) @ [1e-3, 1, 2e-3] + SPECIFIC_FORCE_G @ sensitivity
    found = fit_gyro_of_known_scale(pps, 1, 90.0, 4000.0)
    assert found.d0 == pytest.approx(2)
    assert found.g_sensitivity_per_g == pytest.approx([NAN, -0.3, NAN], nan_ok=True)
    fits = fit_attitudes(
        1000 * SPECIFIC_FORCE_G, np.stack([pps, pps, pps], axis=-1), 90.0, np.array([NAN, 4000.0, 4000.0])
    )
    assert fits.gyros[0] is None
    assert fits.gyros[1].g_sensitivity_per_g[1] == pytest.approx(-0.3)
    assert len(fits.notes) == 4  # three without KG, one that has none from the rates either
