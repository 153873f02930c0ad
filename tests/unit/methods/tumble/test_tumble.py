import numpy as np
import pytest

from bench.methods.tumble.reduction.solution import (
    IncompleteTumble,
    further_terms,
    hysteresis,
    missing_positions_deg,
    solve_tumble,
)

FOUR = np.radians([0.0, 90, 180, 270])
THERE_AND_BACK = np.radians([0.0, 90, 180, 270, 270, 180, 90, 0])


def accelerometer(angle_rad, *, k0=1e-3, k1=1.13, k2=2e-5, k3=0.0, kip=0.0, d=1e-3):
    """Output in V of the model equation of equations 1.4."""
    a, a_p = np.sin(angle_rad), np.cos(angle_rad)
    along = a + d * a_p
    return k1 * (k0 + along + k2 * along**2 + k3 * along**3 + kip * along * a_p)


def test_four_points_are_the_four_point_formulas():
    e0, e90, e180, e270 = reading = np.array([1.7e-3, 1.1313, -0.6e-3, -1.1287])
    tumble = solve_tumble(FOUR, reading)
    c0, k1 = (e0 + e180) / 2, (e90 - e270) / 2
    assert tumble.c0 == pytest.approx(c0, abs=1e-15)
    assert tumble.k1 == pytest.approx(k1, rel=1e-15)
    assert tumble.c2 == pytest.approx((e90 + e270) / 2 - c0, abs=1e-15)
    assert tumble.misalignment_rad == pytest.approx((e0 - e180) / (2 * k1), rel=1e-12)
    assert tumble.k0_g == pytest.approx(c0 / k1, rel=1e-12)
    assert tumble.k2_g_per_g2 == pytest.approx(((e90 + e270) / 2 - c0) / k1, rel=1e-12)


def test_the_mean_of_four_readings_is_not_the_bias():
    reading = accelerometer(FOUR, k0=1e-3, k1=1.0, k2=2e-5, d=0)
    assert np.mean(reading) - 1e-3 == pytest.approx(2e-5 / 2, rel=1e-9)
    assert solve_tumble(FOUR, reading).c0 == pytest.approx(1e-3, abs=1e-15)


def test_what_four_points_cannot_separate():
    tumble = solve_tumble(FOUR, accelerometer(FOUR, k3=-3e-5, kip=5e-6, d=1e-3))
    # Worked by hand: the misalignment enters in second order.
    assert tumble.k0_g - 1e-3 == pytest.approx(0, abs=0.06e-6)
    assert tumble.k1 / 1.13 - 1 == pytest.approx(-30.08e-6, abs=0.5e-6)
    assert tumble.k2_g_per_g2 - 2e-5 == pytest.approx(0, abs=0.06e-6)
    assert tumble.misalignment_rad - 1e-3 == pytest.approx(0, abs=0.1e-6)


def test_a_zero_error_of_the_head_goes_into_the_misalignment():
    error_rad = 1e-3
    tumble = solve_tumble(FOUR, accelerometer(FOUR + error_rad, d=0, k2=0))
    assert tumble.k0_g == pytest.approx(1e-3, abs=0.01e-6)
    assert tumble.k1 / 1.13 - 1 == pytest.approx(-(error_rad**2) / 2, rel=1e-3)
    assert tumble.misalignment_rad == pytest.approx(error_rad, rel=1e-6)


@pytest.mark.parametrize("offset_deg", [1.0, -0.3, 17.0])
def test_actual_angles_make_an_offset_of_the_head_harmless(offset_deg):
    angle_rad = THERE_AND_BACK + np.radians(offset_deg)
    sine, cosine = np.sin(angle_rad), np.cos(angle_rad)
    tumble = solve_tumble(angle_rad, 1e-3 + 1.13 * sine + 2e-3 * cosine + 3e-5 * sine**2)
    assert (tumble.c0, tumble.k1, tumble.c2) == pytest.approx((1e-3, 1.13, 3e-5), abs=1e-14)
    assert tumble.misalignment_rad == pytest.approx(2e-3 / 1.13, rel=1e-12)


def test_there_and_back_cancels_a_linear_drift():
    drift = 1e-6 * np.arange(8)
    tumble = solve_tumble(THERE_AND_BACK, accelerometer(THERE_AND_BACK, d=0) + drift)
    assert tumble.c0 == pytest.approx(1.13e-3 + 1e-6 * 3.5, abs=1e-12)
    assert tumble.k1 == pytest.approx(1.13, rel=1e-12)


def test_condition_number_is_the_published_one():
    assert solve_tumble(FOUR, accelerometer(FOUR)).fit.condition == pytest.approx(2.4, abs=0.05)


def test_standard_errors_are_the_published_ones():
    tumble = solve_tumble(FOUR, accelerometer(FOUR, k0=0, k1=1.0, k2=0, d=0))
    k0, k1, d, k2 = np.linalg.norm(tumble.gain(), axis=1)
    assert (k0, k1, d, k2) == pytest.approx((0.71, 0.71, 0.71, 1.0), abs=0.005)


def test_uncertainty_is_propagated_through_the_ratios():
    rng = np.random.default_rng(1)
    clean = accelerometer(THERE_AND_BACK, k0=0.3, k2=0.2, d=0.4)  # large, so that the ratios matter
    tumbles = [solve_tumble(THERE_AND_BACK, clean + 1e-3 * rng.standard_normal(8)) for _ in range(4000)]
    found = np.array([(t.k0_g, t.k1, t.misalignment_rad, t.k2_g_per_g2) for t in tumbles])
    gain = solve_tumble(THERE_AND_BACK, clean).gain()
    expected = 1e-6 * gain @ gain.T
    assert np.cov(found.T) == pytest.approx(expected, rel=0.1, abs=3e-8)
    own = np.mean([t.gain() @ t.gain().T * t.fit.residual_sd**2 for t in tumbles], axis=0)
    assert np.diag(own) == pytest.approx(np.diag(expected), rel=0.1)


def test_gain_is_the_derivative_to_each_reading():
    reading = accelerometer(THERE_AND_BACK, k0=0.3, k2=0.2, d=0.4)

    def results(values):
        tumble = solve_tumble(THERE_AND_BACK, values)
        return np.array([tumble.k0_g, tumble.k1, tumble.misalignment_rad, tumble.k2_g_per_g2])

    step = 1e-6
    steps = [(results(reading + step * one) - results(reading - step * one)) / (2 * step) for one in np.eye(8)]
    assert solve_tumble(THERE_AND_BACK, reading).gain() == pytest.approx(np.array(steps).T, abs=1e-9)


def test_four_readings_have_no_scatter_of_their_own():
    assert np.isnan(solve_tumble(FOUR, accelerometer(FOUR)).fit.residual_sd)


@pytest.mark.parametrize(
    ("angles_deg", "missing", "terms"),
    [
        ([0, 90, 180, 0], (270,), ("K1", "c2")),
        ([0, 90, 270, 90], (180,), ("c0", "d·K1", "c2")),
        ([90, 180, 270, 450], (0,), ("c0", "d·K1", "c2")),
        ([], (0, 90, 180, 270), ("c0", "K1", "d·K1", "c2")),
    ],
)
def test_a_missing_position_is_named(angles_deg, missing, terms):
    with pytest.raises(IncompleteTumble) as caught:
        solve_tumble(np.radians(angles_deg), np.ones(len(angles_deg)))
    assert caught.value.missing_deg == missing
    assert caught.value.names == terms
    assert f"no reading near {missing[0]}°" in str(caught.value)


def test_positions_far_off_may_still_not_suffice():
    with pytest.raises(IncompleteTumble, match="condition number") as caught:
        solve_tumble(np.radians([44.99, 45.01, 224.99, 225.01]), np.ones(4))
    assert caught.value.missing_deg == ()


def test_four_readings_close_together_are_no_tumble():
    with pytest.raises(IncompleteTumble, match="condition number"):
        solve_tumble(np.radians([10.0, 11, 12, 13]), np.ones(4))


def test_positions_count_around_the_turn():
    assert missing_positions_deg(np.array([-91.0, 359.9, 450.0])) == [180]
    assert missing_positions_deg(np.array([])) == [0, 90, 180, 270]


def dwells(*rows):
    """Columns for `hysteresis` out of (cycle, rising, set_c, temperature_c, value)."""
    cycle, rising, set_c, temperature_c, value = zip(*rows, strict=True)
    return {
        "value": np.array(value, dtype=float),
        "temperature_c": np.array(temperature_c, dtype=float),
        "set_c": np.array(set_c, dtype=float),
        "rising": np.array(rising, dtype=bool),
        "cycle": np.array(cycle),
    }


def no_slope(temperature_c):
    return np.zeros_like(temperature_c)


def test_hysteresis_is_the_largest_difference_and_says_where():
    found = hysteresis(
        **dwells((1, True, 0, 0, 5.0), (1, True, 10, 10, 7.0), (1, False, 10, 10, 8.5), (1, False, 0, 0, 5.4)),
        slope=no_slope,
    )
    assert found is not None
    assert (found.value, found.set_c, found.rising, found.falling) == (1.5, 10.0, 1, 2)
    assert found.differences.tolist() == [pytest.approx(-0.4), -1.5], "rising less falling"


def test_hysteresis_compares_at_one_temperature():
    found = hysteresis(
        **dwells((1, True, 10, 10.3, 3.0 + 0.2 * 10.3), (1, False, 10, 9.8, 3.5 + 0.2 * 9.8)),
        slope=lambda temperature_c: np.full_like(temperature_c, 0.2),
    )
    assert found is not None
    assert found.value == pytest.approx(0.5, rel=1e-12)


def test_every_visit_of_a_set_point_is_compared():
    found = hysteresis(
        **dwells((1, True, 20, 20, 0.0), (1, False, 20, 20, 1.0), (1, True, 20, 20, 3.5)), slope=no_slope
    )
    assert found is not None
    assert (found.value, found.rising) == (2.5, 2)


@pytest.mark.parametrize(
    "rows",
    [
        [(1, True, 20, 20, 0.0), (2, False, 20, 20, 9.0)],
        [(1, True, 20, 20, 0.0), (1, True, 20, 20, 9.0)],
        [(1, True, 20, 20, 0.0), (1, False, 30, 20, 9.0)],
    ],
    ids=["other cycle", "same leg", "other set point"],
)
def test_what_is_not_one_temperature_both_ways_is_not_compared(rows):
    assert hysteresis(**dwells(*rows), slope=no_slope) is None


def evenly(count, offset_deg=1.0):
    return np.radians(np.arange(count) * 360 / count + offset_deg)


@pytest.mark.parametrize(
    ("count", "extra"),
    [
        (4, ()), (5, ("Kip",)), (6, ("Kip",)), (8, ("Kip", "K3", "asymmetry")), (12, ("Kip", "K3", "asymmetry")),
        (24, ("Kip", "K3", "asymmetry")),
    ],
)  # fmt: skip
def test_angles_tell_the_terms_that_they_can(count, extra):
    """Four do not tell K3 from K1, six are blind to it: equations 1.5."""
    assert further_terms(evenly(count)) == extra
    assert further_terms(np.concatenate([evenly(count), evenly(count)[::-1]])) == extra, "repeats tell nothing new"


@pytest.mark.parametrize("count", [8, 12, 24])
def test_further_terms_are_found_by_themselves(count):
    angle = evenly(count)
    reading = accelerometer(angle, k3=-3e-5, kip=5e-6, d=0) + 1.13 * 15e-6 * np.abs(np.sin(angle))
    values = solve_tumble(angle, reading, ("Kip", "K3", "asymmetry")).values
    expected = {"K0": 1e-3, "K1": 1.13, "misalignment": 0, "K2": 2e-5, "Kip": 5e-6, "K3": -3e-5, "asymmetry": 30e-6}
    assert values == pytest.approx(expected, abs=1e-12)


def test_standard_errors_of_further_terms_are_the_published_ones():
    tumble = solve_tumble(evenly(8, 0.0), accelerometer(evenly(8, 0.0), k0=0, k1=1.0, k2=0, d=0), ("Kip", "K3"))
    found = dict(zip(tumble.values, np.linalg.norm(tumble.gain(), axis=1), strict=True))
    published = {"K0": 0.61, "K1": 1.58, "misalignment": 0.50, "K2": 1.0, "Kip": 1.0, "K3": 2.0}
    assert found == pytest.approx(published, abs=0.01)


def test_gain_is_the_derivative_of_every_constant():
    angle, extra = evenly(12), ("Kip", "K3", "asymmetry")
    reading = accelerometer(angle, k3=-3e-5, kip=5e-6)
    step, tumble = 1e-6, solve_tumble(angle, reading, extra)
    for index in (0, 5):
        moved = solve_tumble(angle, reading + step * (np.arange(12) == index), extra).values
        slopes = [(moved[name] - value) / step for name, value in tumble.values.items()]
        assert tumble.gain()[:, index] == pytest.approx(slopes, rel=1e-4, abs=1e-8)


def test_an_even_drift_is_neither_in_the_constants_nor_in_the_scatter():
    time_s = 60.0 * np.arange(8)
    reading = accelerometer(THERE_AND_BACK) + 1e-6 * (time_s - time_s.mean())
    without, tumble = solve_tumble(THERE_AND_BACK, reading), solve_tumble(THERE_AND_BACK, reading, (), time_s)
    assert without.fit.residual_sd > 1e-4
    assert tumble.fit.residual_sd < 1e-12
    assert tumble.fit.dof == 3
    assert tumble.values == pytest.approx(without.values, rel=1e-12)
    assert tumble.gain() == pytest.approx(without.gain(), abs=1e-12)


def test_four_readings_have_no_room_for_a_drift():
    assert solve_tumble(FOUR, accelerometer(FOUR), (), np.arange(4.0)).fit.dof == 0


def test_a_sensor_of_negative_scale_factor_differs_in_that_alone():
    angle = np.radians(np.arange(8) * 45.0 + 1)
    output = accelerometer(angle, k3=-3e-5)
    output = output * (1 + 15e-6 * np.sign(output))
    usual, other = (solve_tumble(angle, each, ("Kip", "K3", "asymmetry")).values for each in (output, -output))
    odd = {"K1", "asymmetry"}  # the larger sense of an output is the other one then
    assert other == pytest.approx({name: -value if name in odd else value for name, value in usual.items()}, abs=1e-12)
    assert usual["asymmetry"] == pytest.approx(30e-6, abs=1e-6)


# Two mounts


D_Y, KIO = -2e-3, -3e-5


def linear(angle, *, d=1e-3, kip=5e-6, k3=-3e-5):
    """Output without products of misalignment and coefficients, which no tumble separates."""
    return accelerometer(angle, d=0.0, kip=kip, k3=k3) + 1.13 * d * np.cos(angle)


def clocked_at(angle, **more):
    """A unit rotated by a quarter of a turn about its input axis: the output axis is where the pendulous axis was."""
    return linear(angle, **{"d": D_Y, "kip": KIO, **more})


def in_two_mounts(count, other=None):
    first, second = evenly(count), evenly(count if other is None else other)
    clocked = np.repeat([False, True], [len(first), len(second)])
    reading = np.concatenate([linear(first), clocked_at(second)])
    return np.concatenate([first, second]), reading, clocked


@pytest.mark.parametrize(("count", "other"), [(8, 8), (12, 8), (8, 12)])
def test_two_mounts_tell_both_misalignments_and_both_couplings(count, other):
    angle, reading, clocked = in_two_mounts(count, other)
    extra = further_terms(angle, clocked)
    assert extra == ("misalignment_y", "Kip", "Kio", "K3", "asymmetry")
    values = solve_tumble(angle, reading, extra, clocked=clocked).values
    expected = {
        "K0": 1e-3, "K1": 1.13, "misalignment": 1e-3, "K2": 2e-5, "misalignment_y": D_Y, "Kip": 5e-6, "Kio": KIO,
        "K3": -3e-5, "asymmetry": 0,
    }  # fmt: skip
    assert values == pytest.approx(expected, abs=1e-12)


def test_four_angles_in_two_mounts_tell_both_misalignments_alone():
    angle, _, clocked = in_two_mounts(4)
    assert further_terms(angle, clocked) == ("misalignment_y",)


def test_a_dwell_in_the_second_mount_alone_has_the_terms_of_that_mount():
    angle = evenly(8)
    clocked = np.ones(8, dtype=np.bool_)
    tumble = solve_tumble(angle, clocked_at(angle), ("misalignment_y", "Kip", "Kio", "K3"), clocked=clocked)
    expected = {"K0": 1e-3, "K1": 1.13, "misalignment_y": D_Y, "K2": 2e-5, "Kio": KIO, "K3": -3e-5}
    assert tumble.values == pytest.approx(expected, abs=1e-12)
    assert tumble.per_rad(angle, clocked) == pytest.approx(
        slope_of(lambda at: clocked_at(at, kip=0, k3=0), angle), abs=1e-7
    )


def slope_of(reading, angle, step=1e-4):
    return (reading(angle + step) - reading(angle - step)) / (2 * step)


def test_standard_errors_of_two_mounts_are_the_published_ones():
    angle = np.tile(evenly(12, 0.0), 2)
    clocked, extra = np.repeat([False, True], 12), ("misalignment_y", "Kip", "Kio", "K3")
    reading = accelerometer(angle, k0=0, k1=1.0, k2=0, d=0)
    tumble = solve_tumble(angle, reading, extra, clocked=clocked)
    found = dict(zip(tumble.values, np.linalg.norm(tumble.gain(), axis=1), strict=True))
    published = {
        "K0": 0.35, "K1": 0.91, "misalignment": 0.41, "misalignment_y": 0.41, "K2": 0.58, "Kip": 0.82, "Kio": 0.82,
        "K3": 1.15,
    }  # fmt: skip
    assert found == pytest.approx(published, abs=0.01)


def test_gain_in_two_mounts_is_the_derivative_of_every_constant():
    angle, reading, clocked = in_two_mounts(8)
    extra, step = further_terms(angle, clocked), 1e-6
    tumble = solve_tumble(angle, reading, extra, clocked=clocked)
    for index in (0, 5, 9, 15):
        moved = solve_tumble(angle, reading + step * (np.arange(16) == index), extra, clocked=clocked).values
        slopes = [(moved[name] - value) / step for name, value in tumble.values.items()]
        assert tumble.gain()[:, index] == pytest.approx(slopes, rel=1e-4, abs=1e-8)
