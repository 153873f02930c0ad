import numpy as np
import pytest

from bench.metrology.normal_gravity import normal_gravity_mps2


@pytest.mark.parametrize(
    ("latitude_deg", "height_m", "expected_mps2"),
    [  # equations 1.2
        (45, 0, 9.806197769),
        (0, 0, 9.7803253359),
        (90, 0, 9.8321849379),
        (34.25, 420, 9.7954060871),
    ],
)
def test_gravity_is_that_of_the_printed_check_values(latitude_deg, height_m, expected_mps2):
    assert normal_gravity_mps2(latitude_deg, height_m) == pytest.approx(expected_mps2, abs=6e-10)


def test_both_hemispheres_are_alike():
    assert normal_gravity_mps2(-34.25, 420) == normal_gravity_mps2(34.25, 420)


def test_height_takes_away_0p3086_mgal_per_metre():
    assert normal_gravity_mps2(45, 1.0) - normal_gravity_mps2(45, 0.0) == pytest.approx(-3.086e-6, rel=1e-3)


@pytest.mark.parametrize("latitude_deg", [90.001, -91, np.nan])
def test_a_latitude_beyond_the_poles_is_refused(latitude_deg):
    with pytest.raises(ValueError, match="from -90° to 90°"):
        normal_gravity_mps2(latitude_deg)
