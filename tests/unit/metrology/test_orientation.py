"""How units lie: what the simulated world does to them, and what the bench works out, by two separate arithmetics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.metrology.acquisition import Acquisition, Mount
from bench.metrology.bench_uncertainty import AxisRecord, BenchRecord
from bench.metrology.orientation import elevation_rad, is_clocked, rotation, specific_force_g, unit_axes
from bench.metrology.run_data import UnitUnderTest
from simulators.physics import attitude
from simulators.physics.attitude import EAST, NORTH, SOUTH, UP, Fixture, to_unit
from tests.support.planar import planar

THREE_AXES = {"outer": UP, "middle": NORTH, "inner": EAST}


def lying(
    axes: dict, x: attitude.Vector, z: attitude.Vector, angles_deg: tuple, mount: tuple, own_deg: float, level_deg=0.0
):
    """The acquisition, the unit and the bench of one attitude, as a run records them."""
    acquisition = Acquisition(
        step="", group="", loops={}, begin_s=0.0, end_s=1.0, angles_deg=dict(zip(axes, angles_deg, strict=True)),
        set_from_c=20.0, set_c=20.0, counts={}, temperatures_c={}, temperatures_at_s={}, mount=Mount("", *mount),
    )  # fmt: skip
    bench = BenchRecord(
        gravity_mps2=9.8, gravity_u_mps2=0.0, axes={role: AxisRecord(points=points) for role, points in axes.items()},
        x=x, z=z, level_deg=level_deg, level_u_deg=0.0, time_base_u=0.0, thermometers_u={},
    )  # fmt: skip
    return acquisition, UnitUnderTest("a", "1", "x", own_deg, "t"), bench


def in_the_world(axes, x, z, angles_deg, mount, own_deg, level_deg=0.0):
    """Level frame to unit, as the simulators have it."""
    turned = Fixture(tuple(axes.values()), x, z).to_fixture([np.array([angle]) for angle in angles_deg], level_deg)[0]
    return to_unit(attitude.Mount(*mount), own_deg) @ turned


@pytest.mark.parametrize("angles_deg", [(0.0, 0.0, 0.0), (90.0, 0.0, 0.0), (17.0, -33.0, 240.0), (1.0, 359.0, 90.0)])
@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (10.0, 0.0, 0.0), (0.0, 180.0, 0.0), (35.26, 20.0, 90.0)])
def test_the_bench_knows_how_a_unit_lies_in_the_world(angles_deg, mount):
    how = (THREE_AXES, NORTH, UP, angles_deg, mount, 0.7, 0.01)
    assert unit_axes(*lying(*how)) == pytest.approx(in_the_world(*how), abs=1e-12)


@pytest.mark.parametrize("angle_rad", [0.0, 1e-9, 0.3, -np.pi / 2, np.pi, 7.0])
@pytest.mark.parametrize("axis", [UP, SOUTH, (0.6, 0.0, -0.8), (1 / 3, -2 / 3, 2 / 3)])
def test_a_rotation_is_that_of_a_library(axis, angle_rad):
    library = Rotation.from_rotvec(angle_rad * np.array(axis)).as_matrix()
    assert rotation(axis, angle_rad) == pytest.approx(library, rel=0, abs=1e-15)


@pytest.mark.parametrize(("sense", "offset_deg"), [(1, 0.0), (-1, 0.0), (-1, 90.0), (1, -90.0)])
@pytest.mark.parametrize("head_deg", [0.0, 1.0, 91.0, 181.0, 271.0])
def test_on_a_head_the_input_axis_is_raised_by_the_sum_of_all_angles(sense, offset_deg, head_deg):
    head = planar(sense, offset_deg)
    how = ({"head": head.axes[0]}, head.x, head.z, (head_deg,), (7.0, 0.0, 0.0), 0.7, 0.01)
    raised = np.radians(sense * head_deg + offset_deg + 7.0 + 0.7 + 0.01)
    turned = np.array([np.sin(raised), 0.0, np.cos(raised)])
    assert specific_force_g(*lying(*how)) == pytest.approx(turned, abs=1e-12)
    assert in_the_world(*how)[:, 2] == pytest.approx(turned, abs=1e-12)
    assert np.exp(1j * elevation_rad(*lying(*how))) == pytest.approx(np.exp(1j * raised), abs=1e-12)


def test_a_unit_on_its_other_end_feels_gravity_along_its_seat_the_other_way():
    """(sin th, 0, s cos th) g, s = -1 for the end that is down (equations 3.3)."""
    head_deg = 20.0
    how = ({"head": SOUTH}, EAST, UP, (head_deg,), (0.0, 180.0, 0.0), 0.0)
    expected = [np.sin(np.radians(head_deg)), 0.0, -np.cos(np.radians(head_deg))]
    assert specific_force_g(*lying(*how)) == pytest.approx(expected, abs=1e-12)


def test_a_tilted_seat_is_felt_as_the_cosine_of_the_clocking():
    """U(psi) = m + p cos psi + q sin psi (equations 3.4): at 90° the other axis of the seat is felt."""
    tilted = [
        specific_force_g(*lying({"head": SOUTH}, EAST, UP, (0.1,), (0.0, 0.0, clock_deg), 0.0))[0]
        for clock_deg in (0.0, 90.0, 180.0, 270.0)
    ]
    assert tilted == pytest.approx([np.sin(np.radians(0.1)), 0.0, -np.sin(np.radians(0.1)), 0.0], abs=1e-12)


def test_the_output_axis_must_be_level_for_an_elevation():
    with pytest.raises(ValueError, match="not level"):
        elevation_rad(*lying({"head": SOUTH}, EAST, UP, (10.0,), (0.0, 0.0, 90.0), 0.0))


def test_rates_of_all_axes_add_up_in_the_fixture():
    """Turning all axes at once, compared with how the attitude really changes."""
    fixture = Fixture((UP, NORTH, EAST), NORTH, UP)
    angles_deg, rates_dps, step_s = np.array([20.0, -40.0, 65.0]), np.array([3.0, -5.0, 2.0]), 1e-4
    before, after = (
        fixture.to_fixture([np.array([angle]) for angle in angles_deg + sign * step_s / 2 * rates_dps])[0]
        for sign in (-1, 1)
    )
    spin = (after - before) @ ((after + before) / 2).T / step_s  # = -[rate ×] in the fixture
    seen_dps = np.degrees([spin[1, 2], spin[2, 0], spin[0, 1]])
    told_dps = fixture.rate([np.array([a]) for a in angles_deg], [np.array([r]) for r in rates_dps])[0]
    assert told_dps == pytest.approx(seen_dps, rel=1e-6)


@pytest.mark.parametrize("head_deg", [0.0, 1.0, 45.0, 89.3, 90.0, 180.0, 270.0, 323.0])
@pytest.mark.parametrize(("roll_deg", "clocked"), [(0.0, False), (180.0, False), (90.0, True), (-90.0, True)])
def test_a_unit_rotated_by_a_quarter_of_a_turn_about_its_input_axis_is_clocked_at_any_angle(
    head_deg, roll_deg, clocked
):
    how = ({"head": SOUTH}, EAST, UP, (head_deg,), (0.7, roll_deg, 0.0), 0.0)
    assert is_clocked(*lying(*how)) == clocked
    raised = np.radians(head_deg + 0.7)
    beyond = -1.0 if roll_deg in (180.0, -90.0) else 1.0  # the axis that left the level points down at 0
    expected = beyond * np.cos(raised) + np.sin(raised) * 1j
    assert np.exp(1j * elevation_rad(*lying(*how))) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("own_deg", [(0.0, 90.0), (90.0, 0.0), (35.0, -60.0)])
@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (-90.0, 0.0, 0.0), (90.0, 180.0, 0.0), (10.0, 20.0, 30.0)])
def test_the_bench_knows_how_a_clocked_channel_lies_in_the_world(own_deg, mount):
    acquisition, unit, bench = lying({"head": SOUTH}, EAST, UP, (17.0,), mount, own_deg[0])
    turned = Fixture((SOUTH,), EAST, UP).to_fixture([np.array([17.0])], 0.0)[0]
    known = to_unit(attitude.Mount(*mount), *own_deg) @ turned
    assert unit_axes(acquisition, replace(unit, clock_deg=own_deg[1]), bench) == pytest.approx(known, abs=1e-12)


def test_a_unit_between_both_mounts_has_no_elevation():
    with pytest.raises(ValueError, match="nor is the pendulous axis"):
        elevation_rad(*lying({"head": SOUTH}, EAST, UP, (10.0,), (0.0, 45.0, 0.0), 0.0))
