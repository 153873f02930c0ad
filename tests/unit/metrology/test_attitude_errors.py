"""What errors of a table do to attitudes, against the simulated table turned by them."""

import numpy as np
import pytest

from bench.methods.imu.reduction.table_errors import Kind, table_errors
from bench.metrology.acquisition import Acquisition
from bench.metrology.bench_uncertainty import AxisRecord, BenchRecord
from bench.metrology.run_data import UnitUnderTest
from simulators.physics.attitude import EAST, NORTH, UP, Fixture, tilted

AXES = (UP, NORTH, EAST)
ROLES = ("outer", "middle", "inner")
SMALL = 1e-5
UNIT = UnitUnderTest("a", "S", "", 0.0, "t")
LEVEL = np.array([0.2, -0.4, 0.9])  # any vector in the level frame


def at(*angles_deg):
    angles = dict(zip(ROLES, map(float, angles_deg), strict=True))
    return Acquisition("s", "g", {}, 0.0, 1.0, angles, 0.0, 0.0, {}, {}, {})


POSES = [at(*angles) for angles in ((0, 0, 0), (90, -90, 0), (180, 90, 270), (45, 90, 90), (-90, 180, 90))]


def record(**errors):
    axes = {role: AxisRecord(points, **errors.get(role, {})) for role, points in zip(ROLES, AXES, strict=True)}
    return BenchRecord(
        9.8, 0, axes, EAST, UP, 0.0, errors.get("level", 0.0), 0, {},
        azimuth_u_deg=errors.get("azimuth", 0.0), orthogonality_u_deg=errors.get("orthogonality", 0.0),
    )  # fmt: skip


def seen(fixture, shift_deg=lambda _role, angle_deg: angle_deg):
    """The level vector in the unit's frame at each pose, of a table put up like this, (n, 3)."""
    rows = []
    for pose in POSES:
        angles = [np.array([shift_deg(role, angle)]) for role, angle in pose.angles_deg.items()]
        rows.append(fixture.to_fixture(angles)[0] @ LEVEL)
    return np.array(rows)


STRAIGHT = Fixture(AXES)


def changes(bench):
    """What each source changes it by for 1 rad, as the budgets have it: (n, 3) each."""
    errors = table_errors(POSES, UNIT, bench)
    return [source.seen(errors.axes, LEVEL) for source in errors.sources]


@pytest.mark.parametrize("role", ROLES)
def test_the_zero_of_an_axis(role):
    (change,) = changes(record(**{role: {"zero_u_deg": 1.0}}))
    shifted = seen(STRAIGHT, lambda other, deg: deg + np.degrees(SMALL) * (other == role))
    assert change == pytest.approx((shifted - seen(STRAIGHT)) / SMALL, abs=1e-4)


@pytest.mark.parametrize("role", ROLES)
def test_the_harmonics_of_an_axis(role):
    cosine, sine, cosine2, _ = changes(record(**{role: {"harmonics_u_deg": (1.0, 1.0)}}))
    for change, shape, order in ((cosine, np.cos, 1), (sine, np.sin, 1), (cosine2, np.cos, 2)):

        def shifted(other, deg, shape=shape, order=order):
            return deg + np.degrees(SMALL) * shape(np.radians(order * deg)) * (other == role)

        assert change == pytest.approx((seen(STRAIGHT, shifted) - seen(STRAIGHT)) / SMALL, abs=1e-4)


def test_the_base_and_the_axes_against_each_other():
    found = changes(record(level=1.0, azimuth=1.0, orthogonality=1.0))
    apart = [(number, which) for number in range(2) for which in range(2)]
    for change, (number, which) in zip(found[:4], apart, strict=True):
        pairs = [[0.0, 0.0], [0.0, 0.0]]
        pairs[number][which] = np.degrees(SMALL)
        moved = seen(tilted(STRAIGHT, (0, 0, 0), [tuple(pair) for pair in pairs])) - seen(STRAIGHT)
        assert change == pytest.approx(moved / SMALL, abs=1e-4)
    for change, base in zip(found[4:], np.eye(3), strict=True):
        moved = seen(tilted(STRAIGHT, tuple(np.degrees(SMALL) * base), [(0, 0), (0, 0)])) - seen(STRAIGHT)
        assert change == pytest.approx(moved / SMALL, abs=1e-4)


def test_errors_of_one_kind_are_left_out_and_lines_keep_their_names():
    errors = table_errors(
        POSES, UNIT, record(level=1.0, azimuth=1.0, outer={"zero_u_deg": 1.0, "repeatability_u_deg": 1.0})
    )
    left = errors.without(Kind.LEVEL)
    lines = list(left.lines(left.seen(LEVEL, 0), np.ones(len(POSES))))
    assert {(line.source, line.shared) for line in lines} == {
        ("outer: zero", "outer.zero"), ("outer: repeatability", None), ("fixture: azimuth", "fixture.azimuth"),
    }  # fmt: skip
    assert {each.cause.source.source for each in errors.sources} - {line.source for line in lines} == {"fixture: level"}
