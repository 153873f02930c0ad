import numpy as np
import pytest

from bench.methods.imu.reduction.knots import check_model, compensate, temperature_table

NAN = float("nan")
KNOTS = [(20.0, 40.0, 1000.0), (0.0, 10.0, 1010.0), (10.0, 20.0, 1002.0)]  # °C, pulse/s, pulse/s/g; in any order


def table(knots=KNOTS):
    return temperature_table(np.array(knots).reshape(-1, 3))


def test_zero_and_scale_are_straight_between_neighbouring_knots():
    zero_pps, scale = table().at(np.array([0, 2.5, 10, 15, 20]), "reject")
    assert zero_pps.tolist() == [10, 12.5, 20, 30, 40]
    assert scale.tolist() == [1010, 1008, 1002, 1001, 1000]


@pytest.mark.parametrize(
    ("extrapolation", "zero_pps", "scale"),
    [("hold", [10, 40], [1010, 1000]), ("linear", [5, 60], [1014, 998]), ("reject", [NAN, NAN], [NAN, NAN])],
)
def test_outside_of_the_knots(extrapolation, zero_pps, scale):
    found = table().at(np.array([-5.0, 30.0]), extrapolation)
    assert found[0] == pytest.approx(zero_pps, nan_ok=True)
    assert found[1] == pytest.approx(scale, nan_ok=True)
    done = compensate(table(), np.array([-5.0, 0.0, 20.0, 20.001]), np.full(4, 500.0), 10.0, extrapolation)
    assert done.extrapolated.tolist() == [True, False, False, True]
    assert np.isnan(done.value).tolist() == ([True, False, False, True] if extrapolation == "reject" else 4 * [False])


def test_a_reading_is_regressed_to_the_nominal_temperature():
    done = compensate(table(), np.array([15.0, 15.0, NAN, 850.0]), np.array([530.5, NAN, 1.0, 1.0]), 0.0, "hold")
    assert done.value == pytest.approx([0.5, NAN, NAN, NAN], nan_ok=True)  # (530.5 - 30) / 1001
    assert done.nominal == pytest.approx([515.0, NAN, NAN, NAN], nan_ok=True)  # 0.5 · 1010 + 10
    assert done.extrapolated.tolist() == 4 * [False]  # nothing is known of an open thermometer


def test_knots_closer_than_half_a_degree_become_their_mean():
    merged = table([*KNOTS, (10.4, 30.0, 1006.0), (10.8, 25.0, 1001.0), (20.5, 44.0, 990.0), (5.0, NAN, 1.0)])
    assert merged.temperature_c == pytest.approx([0, 10.4, 20, 20.5])
    assert merged.zero == pytest.approx([10, 25, 40, 44])
    assert merged.scale == pytest.approx([1010, 1003, 1000, 990])


@pytest.mark.parametrize("knots", [[], KNOTS[:1], [KNOTS[0], (20.3, 41.0, 999.0)], [KNOTS[0], (NAN, 1.0, 1.0)]])
def test_fewer_than_two_knots_compensate_nothing(knots):
    done = compensate(table(knots), np.array([20.0, 30.0]), np.array([1.0, 2.0]), 20.0, "linear")
    assert np.isnan(done.value).all()
    assert np.isnan(done.nominal).all()
    assert not done.extrapolated.any()


def test_a_knot_left_out_tells_how_well_the_others_tell_it():
    temperature_c = np.array([0.0, 10.0, 15.0, 20.0])
    check = check_model(temperature_c, 3 + 2 * temperature_c + 0.05 * temperature_c**2)
    assert check.error == pytest.approx([0.05 * 10 * 5, 0.05 * 5 * 5])
    assert check.curvature == pytest.approx([0.1, 0.1])
    assert len(check_model(temperature_c[:2], temperature_c[:2]).error) == 0
