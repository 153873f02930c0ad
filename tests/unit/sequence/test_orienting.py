"""Attitudes and the angles to which the axes of a table go for them."""

import itertools

import numpy as np
import pytest

from bench.config.bench import load_bench
from bench.methods.imu.reduction.attitudes import ATTITUDES, BODY_AXES, NAMES
from bench.metrology.acquisition import Mount
from bench.metrology.orientation import turned_axes
from bench.sequence.steps.orienting import Orient, Pose, Turning, Unreachable
from tests.support.runs import ROOT

THREE, TWO = (load_bench(ROOT / "config" / f"{name}.yaml").bench for name in ("imu", "imu_two_axis"))
MOUNTS = {name: Mount(name, each.angle, each.roll, each.clock) for name, each in TWO.fixture.mounts.items()}


def attitude(raw):
    return Orient(orient=raw).attitude


def orientation(bench, targets, mount=Mount()):  # noqa: B008  frozen
    """Where the unit's axes then point, by the arithmetic of the reduction."""
    turns = [(bench.axes[role], angle_deg) for role, angle_deg in targets.items()]
    return turned_axes(turns, bench.fixture.x, bench.fixture.z, mount, (0.0, 0.0))


@pytest.mark.parametrize("name", NAMES)
def test_the_table_goes_where_the_reduction_finds_the_attitude(name):
    found = orientation(THREE, Turning(THREE).targets_deg(attitude(name), Pose()))
    assert found == pytest.approx(BODY_AXES[NAMES.index(name)], abs=1e-12)


def test_a_table_of_two_axes_reaches_16_attitudes_in_one_mounting_and_the_others_in_another():
    reached, turning = {}, Turning(TWO)
    for mount in TWO.fixture.mounts:
        reached[mount] = []
        for name in NAMES:
            try:
                targets = turning.targets_deg(attitude(name), Pose(mount=mount))
            except Unreachable:
                continue
            reached[mount].append(name)
            assert orientation(TWO, targets, MOUNTS[mount]) == pytest.approx(BODY_AXES[NAMES.index(name)], abs=1e-12)
    assert {mount: len(names) for mount, names in reached.items()} == {"along": 16, "across": 16}
    assert set(reached["along"]) | set(reached["across"]) == set(NAMES)
    assert not any(name.startswith("Ay") for name in reached["along"])


FORMS = (
    {"x": "up", "y": "east"}, {"x": "U", "y": "e"}, {"y": "east", "z": "north"}, {"x": "up", "z": "north"},
    {"x": "Up", "y": "East", "z": "North"}, "UEN", "uen", "Ax1",
)  # fmt: skip


@pytest.mark.parametrize("raw", FORMS, ids=str)
def test_every_form_means_the_same(raw):
    assert str(attitude(raw)) == "UEN"


def test_the_way_is_the_shortest_from_where_the_axes_stand():
    for name, start in itertools.product(NAMES[::5], ((0, 0, 0), (350, -90, 725), (-170, 181, 90))):
        pose = Pose(dict(zip(THREE.axes, map(float, start), strict=True)))
        targets = Turning(THREE).targets_deg(attitude(name), pose)
        way = sum(abs(targets[role] - pose.angles_deg[role]) for role in targets)
        others = [
            sum(min(abs((q * 90 - a + 180) % 360 - 180), 360) for q, a in zip(quarters, start, strict=True))
            for quarters in itertools.product(range(4), repeat=3)
            if np.allclose(orientation(THREE, dict(zip(THREE.axes, [q * 90.0 for q in quarters], strict=True))),
                           BODY_AXES[NAMES.index(name)], atol=1e-9)
        ]  # fmt: skip
        assert way == pytest.approx(min(others))


def test_an_axis_with_ends_is_sent_within_them():
    ends = THREE.devices["inner"].limits.model_copy(update={"angle": type("Ends", (), {"min": -100.0, "max": 100.0})})
    devices = {**THREE.devices, "inner": THREE.devices["inner"].model_copy(update={"limits": ends})}
    bench = THREE.model_copy(update={"devices": devices})
    for name in NAMES:
        targets = Turning(bench).targets_deg(attitude(name), Pose({"inner": 90.0}))
        assert -100 <= targets["inner"] <= 100
        assert orientation(bench, targets) == pytest.approx(BODY_AXES[NAMES.index(name)], abs=1e-12)


def test_a_skew_mount_is_told():
    mounts = {"skew": TWO.fixture.mounts["along"].model_copy(update={"angle": 35.0})}
    bench = TWO.model_copy(update={"fixture": TWO.fixture.model_copy(update={"mounts": mounts})})
    with pytest.raises(Unreachable, match="not mounted by quarter turns"):
        Turning(bench).targets_deg(attitude("Ax1"), Pose())


def test_every_name_is_told_with_its_letters():
    assert [attitude(name).name for name in ATTITUDES] == [f"{name} ({letters})" for name, letters in ATTITUDES.items()]
