"""A unit on both of its sides: cross coupling with the output axis, and what is stated where a side is missing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.methods.indexing.method import INDEXING_STATIC
from bench.methods.indexing.reduction.run import reduce
from bench.metrology.acquisition import Acquisition, Mount, Voltages
from bench.metrology.bench_uncertainty import AxisRecord, BenchRecord
from bench.metrology.results.finding import UnitResult
from bench.metrology.run_data import RunData, UnitUnderTest
from simulators.physics import attitude

ENDS = {"up": Mount("end_up"), "down": Mount("end_down", roll_deg=180.0)}
SIDES = {"+y": Mount("side_up", roll_deg=90.0), "-y": Mount("side_down", roll_deg=-90.0)}
ANGLES_DEG = (-1.0, -0.5, 0.0, 0.5, 1.0, 1.0, 0.5, 0.0, -0.5, -1.0)
BENCH = BenchRecord(
    gravity_mps2=9.8, gravity_u_mps2=0.0, axes={"head": AxisRecord((0.0, -1.0, 0.0))}, x=(1.0, 0.0, 0.0),
    z=(0.0, 0.0, 1.0), level_deg=0.0, level_u_deg=0.0, time_base_u=0.0, thermometers_u={},
)  # fmt: skip
UNIT = UnitUnderTest("a", "S1", "", 0.0, "t", voltmeter="dvm", nominal_per_g=1.0)
K1, K0, TOWARDS_Z, TOWARDS_Y, KIP, KIO = -2.0, 1e-3, 4e-4, -7e-4, 3e-5, -9e-5
TILTED_RAD = 5e-5  # of the whole table; times a misalignment it would look like a coupling of 4e-8


def found_with(mounts: dict[str, Mount], saturated: str = "") -> UnitResult:
    acquisitions = []
    for name, mount in mounts.items():
        for angle_deg in ANGLES_DEG:
            number = len(acquisitions)
            turn_deg = angle_deg + np.degrees(TILTED_RAD)
            upward = attitude.raised(turn_deg) @ np.array([0.0, 0.0, 1.0])
            seat = attitude.Mount(mount.angle_deg, mount.roll_deg, mount.clock_deg)
            along, across, pendulous = attitude.to_unit(seat, 0.0) @ upward
            sensed = along + TOWARDS_Z * pendulous + TOWARDS_Y * across
            volts = 99.0 if name == saturated else K1 * (K0 + sensed + along * (KIP * pendulous + KIO * across))
            acquisitions.append(Acquisition(
                step=f"steps/end={name}/angle={number}/acquire", group="", loops={}, begin_s=60.0 * number,
                end_s=60.0 * number + 60.0, angles_deg={"head": angle_deg}, set_from_c=np.nan, set_c=np.nan, counts={},
                temperatures_c={"t": np.array([20.0])}, temperatures_at_s={"t": np.zeros(1)}, mount=mount,
                voltages={"dvm": Voltages(60.0 * number + np.array([20.0, 40.0]), np.full(2, volts))}, stand=number,
                came_from={"head": "below" if number % 10 < 5 else "above"},
            ))  # fmt: skip
    settings = INDEXING_STATIC.settings.model_validate({"output_limit": "50 g", "outlier_k": 100}).model_dump()
    (result,) = reduce(RunData("m1", (UNIT,), tuple(acquisitions), BENCH), settings)
    return result


def test_both_sides_give_the_coupling_with_the_output_axis_and_the_misalignment_towards_it():
    values = {each.quantity: each.value for each in found_with({**ENDS, **SIDES}).findings}
    assert values["Kio"] == pytest.approx(KIO, abs=1e-7)
    assert values["misalignment_y"] == pytest.approx(TOWARDS_Y, abs=1e-7)
    assert values["Kip"] == pytest.approx(KIP, abs=1e-7)
    assert values["misalignment"] == pytest.approx(TOWARDS_Z, abs=1e-7)


def test_the_sides_change_nothing_that_is_found_on_the_ends():
    ends, all_four = found_with(ENDS), found_with({**ENDS, **SIDES})
    assert all_four.findings[: len(ends.findings)] == ends.findings
    assert {each.quantity for each in all_four.findings[len(ends.findings) :]} == {"Kio", "misalignment_y"}
    assert (all_four.models, all_four.flags) == (ends.models, ends.flags)


@pytest.mark.parametrize("mounts", [{**ENDS, "+y": SIDES["+y"]}, {**ENDS, "-y": SIDES["-y"]}])
def test_one_side_alone_determines_nothing_and_is_flagged(mounts):
    result = found_with(mounts)
    assert "sides:incomplete" in map(str, result.flags)
    assert not {each.quantity for each in result.findings} & {"Kio", "misalignment_y"}


def test_a_side_whose_output_is_at_its_limit_is_flagged():
    result = found_with({**ENDS, **SIDES}, saturated="-y")
    assert {"10 readings: saturated", "sides:incomplete"} <= set(map(str, result.flags))
    assert result.verdict == "NOT JUDGED"


def test_a_clocked_unit_is_on_no_side():
    clocked = replace(ENDS["up"], name="clock_90", clock_deg=90.0)
    assert "sides:incomplete" not in map(str, found_with({**ENDS, "clocking": clocked}).flags)
