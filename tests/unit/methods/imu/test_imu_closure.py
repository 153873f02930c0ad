"""Whether a unit and its table are at the end of a run as they were at its beginning."""

import dataclasses

import numpy as np
import pytest

from bench.methods.imu.reduction.attitudes import NAMES, SPECIFIC_FORCE_G
from bench.methods.imu.reduction.closure import Sensitivity, closure_findings
from bench.metrology.acquisition import Mount
from bench.metrology.bench_uncertainty import Drift
from bench.metrology.orientation import unit_axes
from bench.metrology.results.flag import Flag
from bench.metrology.results.limits import Limits
from bench.metrology.run_data import RunData
from bench.report.flag_words import flag_in_words
from tests.unit.methods.imu.test_imu_windows import BENCH, K1, SETTINGS, TWO, UNIT, acquired, block, record, reduce

SENSITIVE = {axis: Sensitivity(K1, 0.02, 100, 10e-6) for axis in range(3)}
NO_MOUNT = Mount()
ATTITUDES = ("Az1", "Az3", "Ax1", "Ax3")


def looked(
    group,
    bias_g=(0.0, 0.0, 0.0),
    tilt_rad=(0.0, 0.0),
    *,
    warmer_c=0.0,
    attitudes=ATTITUDES,
    bench=BENCH,
    mount=NO_MOUNT,
):
    """The windows of one time, of accelerometers with misalignments and other biases besides."""
    found = []
    for name in attitudes:
        window = acquired(f"{group}/{name}/acquire", group, bench, mount, name, np.zeros(6))
        orientation = unit_axes(window, UNIT, record(bench))
        assert orientation[:, 2] == pytest.approx(SPECIFIC_FORCE_G[NAMES.index(name)], abs=1e-9)
        misaligned = 1e-3 * np.array([orientation[1, 2], -orientation[2, 2], orientation[0, 2]])
        force_g = (
            orientation[:, 2] + orientation[:, :2] @ tilt_rad + misaligned + np.array([2e-3, -1e-3, 0.5e-3]) + bias_g
        )
        windows = {
            channel: each._replace(mean=float(K1 * value))
            for (channel, each), value in zip(window.windows.items(), [*force_g, 0, 0, 0], strict=True)
        }
        read_c = {"t": np.full(3, 20.0 + warmer_c)}
        found.append(dataclasses.replace(window, windows=windows, temperatures_c=read_c))
    return found


def closed(*parts, bench=BENCH):
    closure = tuple(window for part in parts for window in part)
    return {
        each.id.split("a/", 1)[1]: each
        for each in closure_findings(RunData("imu", (UNIT,), (), record(bench), closure), UNIT, SENSITIVE)
    }


def test_biases_and_level_come_apart_and_what_is_common_cancels():
    found = closed(looked("s/opening"), looked("s/closing", (30e-6, -20e-6, 10e-6), (15e-6, -40e-6)))
    values = {name: each.value for name, each in found.items()}
    assert values == pytest.approx(
        {"x/K0/closure": 30e-6, "y/K0/closure": -20e-6, "z/K0/closure": 10e-6, "east/level/closure": 15e-6,
         "north/level/closure": -40e-6}, abs=1e-11,
    )  # fmt: skip
    assert all(0.5e-6 < each.u < 3e-6 for each in found.values())


def test_a_bias_is_brought_to_the_temperature_of_the_beginning():
    found = closed(looked("s/opening"), looked("s/closing", (5e-6, 0, 0), warmer_c=0.5))
    assert found["x/K0/closure"].value == pytest.approx(0.0, abs=1e-11)
    assert found["y/K0/closure"].value == pytest.approx(-5e-6, abs=1e-11)


def test_a_thermometer_that_drifts_within_the_run_is_in_the_budget_of_a_bias_by_its_slope():
    """0.04 °C over a run of ten hours, of a bias of 10 µg/°C that was looked at in the first hour and in the last."""
    drift_c, hour_s = 0.04, 3600.0
    bench = dataclasses.replace(record(BENCH), thermometer_drifts={"t": Drift(drift_c)})

    def found(off_c):
        parts = [
            dataclasses.replace(each, begin_s=at_s, end_s=at_s + hour_s)
            for at_s, part in ((0.0, looked("s/opening")), (9 * hour_s, looked("s/closing", warmer_c=0.9 * off_c)))
            for each in part
        ]
        data = RunData("imu", (UNIT,), (), bench, tuple(parts), span_s=(0.0, 10 * hour_s))
        return {each.id.split("a/", 1)[1]: each for each in closure_findings(data, UNIT, SENSITIVE)}

    off = found(drift_c)["x/K0/closure"].value - found(0.0)["x/K0/closure"].value
    assert abs(off) == pytest.approx(0.9 * drift_c * 10e-6, abs=1e-12)
    lines = {name: [line.u for line in each.budget if "drift" in line.source] for name, each in found(0.0).items()}
    assert lines["x/K0/closure"] == pytest.approx([abs(off)])
    assert lines["east/level/closure"] == []


def test_the_repeatability_of_the_axes_is_in_its_uncertainty():
    sharp = record(BENCH)
    blurred = {role: axis._replace(repeatability_u_deg=1e-3) for role, axis in sharp.axes.items()}
    closure = (*looked("s/opening"), *looked("s/closing"))
    data = RunData("imu", (UNIT,), (), dataclasses.replace(sharp, axes=blurred, level_u_deg=1.0), closure)
    (east,) = [each for each in closure_findings(data, UNIT, SENSITIVE) if each.at.get("direction") == "east"]
    assert {line.source.partition(": ")[2] for line in east.budget} >= {"repeatability"}
    assert "fixture: level" not in {line.source for line in east.budget}
    assert east.u == pytest.approx(np.radians(1e-3), rel=0.5)


def test_an_attitude_that_is_had_by_other_angles_has_other_errors_of_the_table():
    """The outer and the inner axis coincide where the x axis is up."""
    bench = record(BENCH)
    off = {role: axis._replace(zero_u_deg=1e-2) for role, axis in bench.axes.items()}
    first, same = looked("s/opening"), looked("s/closing")
    other = [
        dataclasses.replace(each, angles_deg={**each.angles_deg, "outer": each.angles_deg["outer"] + 90.0,
                                              "inner": each.angles_deg["inner"] - 90.0})
        if "/Ax" in each.step else each for each in same
    ]  # fmt: skip
    assert unit_axes(other[2], UNIT, bench) == pytest.approx(unit_axes(same[2], UNIT, bench), abs=1e-9)

    def zero(closing):
        data = RunData("imu", (UNIT,), (), dataclasses.replace(bench, axes=off), (*first, *closing))
        budgets = [each.budget for each in closure_findings(data, UNIT, SENSITIVE)]
        return max((line.u for budget in budgets for line in budget if line.source.endswith(": zero")), default=0.0)

    assert zero(same) < 1e-9
    assert zero(other) > 1e-5


def test_looking_once_or_without_opposite_headings_tells_nothing():
    assert closed(looked("s/opening")) == {}
    assert closed(looked("s/opening", attitudes=("Az1",)), looked("s/closing", attitudes=("Az1",))) == {}


def test_each_mount_closes_by_itself():
    mounts = [Mount(name, each.angle, each.roll, each.clock) for name, each in TWO.fixture.mounts.items()]
    parts = [
        looked(f"s/{when}_{mount.name}", (moved, 0, 0), attitudes=("Az1", "Az3"), bench=TWO, mount=mount)
        for mount, moves in zip(mounts, ((0.0, 7e-6), (500e-6, 501e-6)), strict=True)
        for when, moved in zip(("opening", "closing"), moves, strict=True)
    ]
    found = closed(*parts, bench=TWO)
    biases = [found[f"x/K0/closure@{mount.name}"].value for mount in mounts]
    assert biases == pytest.approx([7e-6, 1e-6], abs=1e-11)


@pytest.mark.parametrize(
    ("bias_g", "tilt_rad", "moved"),
    [((90e-6, 0, 0), (40e-6, 0), []), ((0, 110e-6, 0), (0, 0), ["K0"]), ((0, 0, 0), (0, -60e-6), ["level"])],
)
def test_what_moved_beyond_its_limit_makes_every_verdict_marginal(bias_g, tilt_rad, moved):
    """A planted drift of a bias, and one of the level."""
    data = RunData("imu", (UNIT,), tuple(block(BENCH, "s/hot", "xyz")), record(BENCH),
                   (*looked("s/opening"), *looked("s/closing", bias_g, tilt_rad)))  # fmt: skip
    (found,) = reduce(data, SETTINGS)
    moved_by_flags = [flag.of for flag in found.flags if flag.code == "moved"]
    assert moved_by_flags == [f"{each}/closure" for each in moved]
    assert {each.judged(Limits(low=-1e9, high=1e9)).marginal for each in found.findings} == {bool(moved)}
    assert {each.quantity for each in found.findings} >= {"K0/closure", "level/closure"}


def test_it_is_told_in_words():
    reported = flag_in_words(Flag("moved", of="level/closure"))
    assert (
        reported == "level/closure: it changed over the run by more than the settings allow: every verdict is marginal."
    )


def test_a_run_that_ended_before_any_accelerometer_was_calibrated_tells_nothing():
    data = RunData("imu", (UNIT,), (), record(BENCH), (*looked("s/opening"), *looked("s/closing")))
    assert list(closure_findings(data, UNIT, {})) == []
