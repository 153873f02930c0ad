"""An instrument of three axes on an indexing table: which readings are those of a channel, and at which clocking."""

from __future__ import annotations

from dataclasses import replace
from itertools import count

import numpy as np
import pytest

from bench.config.bench import load_bench
from bench.methods.indexing.reduction.readings import IndexingReading, readings_of
from bench.metrology.acquisition import Acquisition, Mount, Voltages
from bench.metrology.run_data import RunData, UnitUnderTest
from simulators.physics import attitude
from tests.support.indexing_runs import BENCH, UNIT
from tests.support.runs import ROOT

FILE = load_bench(ROOT / "config/indexing_three_axes.yaml").bench
AXES = {"a": np.array([1.0, 0, 0]), "b": np.array([0, 1.0, 0]), "c": np.array([0, 0, 1.0])}  # of the instrument
ENDS = {
    "a": ("end_up", "end_down"), "b": ("clock_270", "y_down"), "c": ("z_up", "z_down"),
}  # fmt: skip
CLOCKED = ("end_up", "clock_90", "clock_180", "clock_270", "z_up", "z_clock_90", "z_clock_180", "z_clock_270")


def mount_of(name: str) -> Mount:
    found = FILE.fixture.mount(name)
    return Mount(name, found.angle, found.roll, found.clock)


def readings(place: str) -> list[IndexingReading]:
    """Readings of the channel in a place: sweeps of all axes on both ends, and all clockings."""
    entry = FILE.places[place]
    unit = replace(UNIT, place=place, mount_angle_deg=entry.mount_angle, clock_deg=entry.clock)
    plan = [(f"steps/axis={axis}/angle={angle}", name, angle) for axis, names in ENDS.items() for name in names
            for angle in (-0.5, 0.0, 0.5)]  # fmt: skip
    plan += [("steps/clocking", name, 0.0) for name in CLOCKED]
    numbers = count()
    done = [
        Acquisition(
            step=f"{step}/acquire#{next(numbers)}", group="", loops={}, begin_s=0.0, end_s=60.0,
            angles_deg={"head": angle_deg}, set_from_c=np.nan, set_c=np.nan, counts={},
            temperatures_c={"t": np.array([20.0])}, temperatures_at_s={"t": np.zeros(1)}, mount=mount_of(name),
            voltages={"dvm": Voltages(np.array([20.0, 40.0]), np.zeros(2))},
        )
        for step, name, angle_deg in plan
    ]  # fmt: skip
    return readings_of(RunData("m1", (unit,), tuple(done), BENCH), unit)[0]


@pytest.mark.parametrize("place", ENDS)
def test_a_channel_is_swept_where_its_own_axis_is_turned_on_both_ends(place):
    swept = [each for each in readings(place) if each.kind == "sweep"]
    assert [each.step.split("/")[1] for each in swept] == [f"axis={place}"] * 6
    assert [(each.face, each.end) for each in swept] == [("Z", "up")] * 3 + [("Z", "down")] * 3
    assert [np.degrees(each.angle_rad) for each in swept] == pytest.approx([-0.5, 0.0, 0.5] * 2)
    assert [each.turn for each in swept] == pytest.approx([1.0] * 6, abs=1e-4)


@pytest.mark.parametrize(
    ("place", "expected_deg"), [("a", [0, 90, 180, 270]), ("b", [90, 180, 270, 0]), ("c", [0, 90, 180, 270])]
)
def test_a_channel_is_clocked_on_the_face_that_it_is_swept_on(place, expected_deg):
    clocked = [each for each in readings(place) if each.kind == "clocking" and each.face == "Z"]
    found = [np.degrees(each.clock_rad) % 360 for each in clocked]
    assert np.cos(np.radians(found)) == pytest.approx(np.cos(np.radians(expected_deg)), abs=1e-9)
    assert np.abs(np.sin(np.radians(found))) == pytest.approx(np.abs(np.sin(np.radians(expected_deg))), abs=1e-9)


@pytest.mark.parametrize("place", AXES)
@pytest.mark.parametrize("name", [*CLOCKED, "end_down", "y_down", "z_down"])
def test_the_simulated_channel_senses_the_axis_of_the_instrument_that_the_bench_file_names(place, name):
    """By rotations of the instrument about the axes that it has at each step, without the arithmetic of the bench."""
    mount, entry = FILE.fixture.mount(name), FILE.places[place]
    x, y, z = np.eye(3)  # axes of the instrument in the fixture
    for about, angle_deg in ((1, -mount.angle), (0, mount.roll), (2, mount.clock)):
        axis = (x, y, z)[about]
        x, y, z = (rotated(each, axis, angle_deg) for each in (x, y, z))
    senses = AXES[place] @ np.array([x, y, z])
    seat = attitude.Mount(mount.angle, mount.roll, mount.clock)
    assert attitude.to_unit(seat, entry.mount_angle, entry.clock)[0] == pytest.approx(senses, abs=1e-12)


def rotated(vector, axis, angle_deg):
    """Rodrigues' formula."""
    angle = np.radians(angle_deg)
    return (
        vector * np.cos(angle) + np.cross(axis, vector) * np.sin(angle) + axis * (axis @ vector) * (1 - np.cos(angle))
    )


def test_a_unit_of_one_channel_has_all_of_its_readings():
    unit: UnitUnderTest = UNIT
    done = [
        Acquisition(
            step=f"steps/angle={number}/acquire", group="", loops={}, begin_s=0.0, end_s=60.0,
            angles_deg={"head": angle_deg}, set_from_c=np.nan, set_c=np.nan, counts={},
            temperatures_c={"t": np.array([20.0])}, temperatures_at_s={"t": np.zeros(1)},
            voltages={"dvm": Voltages(np.array([20.0, 40.0]), np.zeros(2))},
        )
        for number, angle_deg in enumerate((-89.0, -30.0, 0.0, 30.0, 89.0, 91.0, 180.0))
    ]  # fmt: skip
    assert len(readings_of(RunData("m1", (unit,), tuple(done), BENCH), unit)[0]) == len(done)
