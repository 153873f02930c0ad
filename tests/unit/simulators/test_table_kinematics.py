import numpy as np
import pytest

from simulators.physics.attitude import EAST, NORTH, UP, Fixture
from simulators.physics.motion import Axis, AxisErrors
from simulators.physics.table_kinematics import Level, TableErrors, TableKinematics

LEVEL_DEG = 0.02
FIXTURE = Fixture((UP, NORTH, EAST))


def a_table(turning: int, errors: TableErrors) -> tuple[list[Axis], TableKinematics]:
    """Three axes with errors of their own, of which one turns and two stand somewhere."""
    axes = [
        Axis(AxisErrors(zero_deg=0.01 * n, cosines=(0.1, 0.02), sines=(0.03, 0.01)), 50.0, np.random.default_rng(n))
        for n in range(3)
    ]
    for number, axis in enumerate(axes):
        axis.start(0.0, 13.0 * (number + 1), 30.0)
    axes[turning].turn(100.0, 7.0, 50.0)
    named = {str(number): axis for number, axis in enumerate(axes)}
    kinematics = TableKinematics(
        FIXTURE, named, level=Level(LEVEL_DEG), table=errors, gravity_mps2=9.8, latitude_deg=34.0
    )  # fmt: skip
    return axes, kinematics


@pytest.mark.parametrize("turning", [0, 1, 2])
@pytest.mark.parametrize("across_deg", [0.0, 0.01])
def test_one_axis_turning_lies_as_by_all_rotations_one_after_the_other(turning: int, across_deg: float) -> None:
    axes, kinematics = a_table(turning, TableErrors(across_deg=across_deg))
    at_s = np.linspace(200.0, 260.0, 101)
    expected = FIXTURE.to_fixture([axis.true_deg(at_s) for axis in axes], LEVEL_DEG)
    if across_deg:
        small = np.radians(-across_deg)
        expected = expected @ np.array(
            [[1, 0, 0], [0, np.cos(small), -np.sin(small)], [0, np.sin(small), np.cos(small)]]
        )
    assert kinematics.attitude(at_s) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("turning", [0, 1, 2])
def test_one_axis_turning_turns_the_fixture_about_a_direction_that_stands_still_in_it(turning: int) -> None:
    axes, _ = a_table(turning, TableErrors())
    at_s = np.linspace(200.0, 260.0, 101)
    rates_dps = [np.zeros_like(at_s) for _ in axes]
    rates_dps[turning] = np.full_like(at_s, 7.0)
    all_along = FIXTURE.rate([axis.true_deg(at_s) for axis in axes], rates_dps)
    assert all_along == pytest.approx(np.broadcast_to(all_along[0], (101, 3)), abs=1e-12)
    assert np.linalg.norm(all_along[0]) == pytest.approx(7.0)
