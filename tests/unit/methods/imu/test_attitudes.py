from itertools import pairwise

import numpy as np
import pytest

from bench.methods.imu.reduction.attitudes import (
    BODY_AXES,
    EARTH_RATE_DPS,
    NAMES,
    NORTH,
    SPECIFIC_FORCE_G,
    block,
    earth_rate_dps,
)
from tests.support.m2_cases import PRINTED, stimulus


def test_attitudes_are_the_24_rotations_of_a_cube():
    assert np.linalg.det(BODY_AXES) == pytest.approx(np.ones(24))
    rotations = {tuple(matrix.ravel().astype(int)) for matrix in BODY_AXES}
    assert len(rotations) == 24
    products = np.einsum("aij,bjk->abik", BODY_AXES, BODY_AXES).reshape(-1, 9).astype(int)
    assert {tuple(product) for product in products} == rotations  # a group: nothing is missing


def test_attitudes_are_stimulated_as_printed():
    assert list(NAMES) == list(PRINTED)
    for latitude_deg in (34.25, -34.25, 0.0, 90.0):
        printed = [stimulus(name, latitude_deg) for name in NAMES]
        assert [force for force, _ in printed] == pytest.approx(SPECIFIC_FORCE_G)
        assert np.array([earth for _, earth in printed]) == pytest.approx(earth_rate_dps(latitude_deg), abs=1e-9)
    assert pytest.approx(15.041067 / 3600) == EARTH_RATE_DPS


def test_everything_cancels_within_the_block_of_an_axis():
    for axis in range(3):
        assert BODY_AXES[block(axis)].sum(axis=0).tolist() == np.zeros((3, 3)).tolist()
        assert SPECIFIC_FORCE_G[block(axis), axis].tolist() == 4 * [1] + 4 * [-1]
        columns = [np.ones(8), SPECIFIC_FORCE_G[block(axis), axis], *np.delete(NORTH[block(axis)], axis, axis=1).T]
        assert np.array(columns) @ np.transpose(columns) == pytest.approx(np.diag([8, 8, 4, 4]))


def test_turns_between_attitudes_are_as_printed():
    cosines = [(np.trace(after @ before.T) - 1) / 2 for before, after in pairwise(BODY_AXES)]
    turns_deg = np.degrees(np.arccos(cosines)).round().tolist()
    expected = 3 * [90] + [180] + 3 * [90]
    assert turns_deg == [*expected, 90, *expected, 120, *expected]


def singular_values(design):
    return np.linalg.svd(design / np.linalg.norm(design, axis=0), compute_uv=False)


def test_what_24_attitudes_tell_of_an_accelerometer():
    design = np.column_stack([np.ones(24), SPECIFIC_FORCE_G, SPECIFIC_FORCE_G[:, 0] ** 2])
    singular = singular_values(design)
    assert singular == pytest.approx([1.256, 1, 1, 1, 0.650], abs=6e-4)
    assert singular[0] / singular[-1] == pytest.approx(1.9, abs=0.05)
    sigma = np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    assert sigma == pytest.approx([0.25, 0.35, 0.35, 0.35, 0.43], abs=5e-3)  # K0, K1, misalignments, K2


@pytest.mark.parametrize(("latitude_deg", "printed"), [(34, 1.9), (-34, 1.9), (0, 1.0), (89.9, 1.1e3)])
def test_what_24_attitudes_tell_of_a_gyro_depends_on_the_latitude(latitude_deg, printed):
    singular = singular_values(np.column_stack([np.ones(24), SPECIFIC_FORCE_G, earth_rate_dps(latitude_deg)]))
    assert singular[0] / singular[-1] == pytest.approx(printed, rel=0.05)
