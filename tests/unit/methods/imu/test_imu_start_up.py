"""The start-up of a compensated unit from windows: from when time counts, by which thermometer, what is left out."""

import dataclasses
import math
from unittest import mock

import numpy as np
import pytest

from bench.figures.numbers import shown
from bench.methods.imu.method import IMU_START_UP, ImuStartUpSettings
from bench.methods.imu.reduction.attitudes import NAMES, SPECIFIC_FORCE_G, earth_rate_dps
from bench.methods.imu.start_up import run as imu_start_up
from bench.methods.imu.start_up.readings import PowerOn
from bench.methods.imu.start_up.run import reduce
from bench.methods.imu.start_up.shown import start_up_plots
from bench.metrology.acquisition import Mount, Turned
from bench.metrology.calibration.temperature import Compensation
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.curves import Constant, KnotModel
from bench.metrology.results.finding import Interval, Subject, UnitResult
from bench.metrology.results.limits import Limits
from bench.metrology.run_data import ReleasedCalibration, RunData
from bench.reduce.evaluate import Results
from bench.report.flag_words import flag_in_words
from bench.report.tables import verdict_rows
from bench.report.terminal import results_text
from tests.support.flags import flag_of, texts
from tests.unit.methods.imu.test_imu_windows import BENCH, K1, KG, LATITUDE, UNIT, acquired, record

SETTINGS = ImuStartUpSettings.model_validate({}).model_dump()
SLOPE_G_PER_C = 10e-6
OFFSET = KnotModel("", "", "", "pulse/s", (0.0, 50.0), (0.0, 50 * SLOPE_G_PER_C * K1), ())
CHANNELS = {
    **{f"acc_{axis}": Compensation(f"acc_{axis}", "pulse/s", "g", Constant(K1, ""), OFFSET) for axis in "xyz"},
    **{f"gyro_{axis}": Compensation(f"gyro_{axis}", "pulse/s", "°/s", Constant(KG, "")) for axis in "xyz"},
}
SUPPLIED = dataclasses.replace(UNIT, supply="psu", released=ReleasedCalibration(CHANNELS, 9.8))
POWER_ON_S = (1000.0, 1000.2)
ORDER = ("Ax1", "Ax8", "Ay1", "Ay8", "Az1", "Az8")


def warm_c(at_s):
    return 15 + 5 * (1 - math.exp(-at_s / 900))


def bias_g(at_s):
    return 60e-6 * math.exp(-at_s / 900)


def watched(first_s=5.0, passes=20, gravity=1.0):
    """The windows from `first_s` after power-on, of a unit that warms and whose bias dies away."""
    found = []
    for number in range(passes):
        for name in ORDER:
            up, at_s = NAMES.index(name), first_s + 20.0 * len(found)
            force_g = gravity * SPECIFIC_FORCE_G[up] + bias_g(at_s) + SLOPE_G_PER_C * warm_c(at_s)
            pps = np.concatenate([K1 * force_g, KG * (earth_rate_dps(LATITUDE)[up] + 1e-6)])
            found.append(placed(f"s/pass={number}/{name}", name, pps, at_s))
            for rate_dps in (30.0, -30.0) if name.endswith("1") else ():
                turning = np.zeros(6)
                turning[3 + "xyz".index(name[1])] = KG * rate_dps
                turned = Turned("outer", rate_dps, 0.0, 0.0, 10.0, 10 * rate_dps)
                at_s = first_s + 20.0 * len(found)
                found.append(placed(f"s/pass={number}/{name}/{rate_dps:g}", name, turning, at_s, turned))
    return found


def placed(step, name, pps, at_s, turned=None):
    window = acquired(step, "s/cold", BENCH, Mount(), name, pps, turned)
    middle_s = sum(POWER_ON_S) / 2 + at_s
    return dataclasses.replace(
        window, begin_s=middle_s - 5, end_s=middle_s + 5, on_since_s={"psu": POWER_ON_S},
        temperatures_c={"t": np.full(10, warm_c(at_s))},
    )  # fmt: skip


def result(windows, unit=SUPPLIED, bench=None, **settings):
    (found,) = reduce(RunData("start", (unit,), tuple(windows), bench or record(BENCH)), SETTINGS | settings)
    return found


def found_of(windows, **others):
    return {each.id.split("a/", 1)[1].partition("@")[0]: each for each in result(windows, **others).findings}


def test_a_bias_that_dies_away_settles_when_it_falls_below_its_limit():
    found = found_of(watched())
    truth_s = 900 * math.log(60 / 30)
    for axis, first_s in {"x": 5.0, "y": 85.0, "z": 165.0}.items():
        assert found[f"{axis}/K0/settling"].value == pytest.approx(truth_s, abs=2)
        assert found[f"{axis}/K0/power_on"].value == pytest.approx(bias_g(first_s), abs=0.1e-6)
        assert found[f"{axis}/K1/warm"].value == pytest.approx(0, abs=0.1e-6)
        assert found[f"{axis}/D0/warm"].value == pytest.approx(1e-6, abs=1e-9)
        assert found[f"{axis}/KG/settling"].value == 0
        assert found[f"{axis}/KG/settling"].flags == ("within_from_the_start",)


def test_a_course_without_any_uncertainty_has_a_time_to_settle_without_one():
    with (
        mock.patch("bench.methods.imu.start_up.run.OTHERWISE", 1.0),
        mock.patch.object(imu_start_up._Watch, "_sources", return_value=()),
    ):
        found = found_of(watched())
    assert (found["x/KG/settling"].value, found["x/KG/settling"].u) == (0.0, pytest.approx(0.2 / math.sqrt(12)))


def test_time_counts_from_power_on_however_late_the_first_reading_comes():
    """Planted: time counted from the first reading."""
    late = watched(first_s=305.0)
    truth_s = 900 * math.log(60 / 30)
    found = found_of(late)["x/K0/settling"]
    assert abs(found.value - truth_s) < 3 * max(found.u, 1.0)
    honest, first_s = PowerOn._since_s, 305.0
    with mock.patch.object(PowerOn, "_since_s", lambda self, window: honest(self, window) - first_s):
        wrong = found_of(late)["x/K0/settling"]
    assert abs(wrong.value - truth_s) > 5 * max(wrong.u, 1.0)


def test_the_units_own_thermometer_tells_the_temperature():
    """Planted: compensation by the chamber, which stays at 15 °C."""
    honest = PowerOn._compensated

    def by_the_chamber(self, channel, pps, step_pps, _at_c):
        return honest(self, channel, pps, step_pps, 15.0)

    right = found_of(watched())["x/K0/warm"]
    assert abs(right.value) < 1e-6
    with mock.patch.object(PowerOn, "_compensated", by_the_chamber):
        wrong = found_of(watched())["x/K0/warm"]
    assert wrong.value == pytest.approx(5 * SLOPE_G_PER_C, abs=3e-6)


def test_a_calibration_over_another_thermometer_is_told():
    known = {**CHANNELS, "acc_y": dataclasses.replace(CHANNELS["acc_y"], thermometer="ay_temperature")}
    own = dataclasses.replace(CHANNELS["acc_x"], thermometer="t")  # that of the run
    unit = dataclasses.replace(SUPPLIED, released=ReleasedCalibration({**known, "acc_x": own}, 9.8))
    (found,) = reduce(RunData("imu", (unit,), tuple(watched()), record(BENCH)), SETTINGS)
    told = [flag for flag in texts(found.flags) if "calibrated over" in flag]
    assert told == ["acc_y is calibrated over ay_temperature; here its temperature is that of t"]


def test_gravity_of_another_place_is_no_error_of_the_scale_factor():
    elsewhere = dataclasses.replace(record(BENCH), gravity_mps2=9.8 * (1 + 1e-3), gravity_u_mps2=1e-4)
    found = found_of(watched(gravity=1 + 1e-3), bench=elsewhere)["x/K1/warm"]
    assert found.value == pytest.approx(0, abs=1e-7)
    assert "site: gravity, against that of the calibration" in {line.source for line in found.budget}
    assert found_of(watched(gravity=1 + 1e-3))["x/K1/warm"].value == pytest.approx(1e-3, rel=1e-3)


def test_a_watch_that_is_too_short_says_that_it_takes_longer_and_does_not_pass():
    settling = found_of(watched(passes=8), accelerometer_zero_g=5e-6)["z/K0/settling"]  # for which it takes 37 min
    assert (settling.flags, settling.value) == (("more_than",), pytest.approx(8 * 12 * 20 - 15))
    assert settling.judged(Limits(high=3600.0)).verdict == "INVALID"
    assert settling.judged(Limits(high=600.0)).verdict == "FAIL"


def test_what_cannot_be_used_is_left_out_and_told_in_words():
    windows = watched()
    open_thermometer = dataclasses.replace(windows[0], temperatures_c={"t": np.full(3, np.nan)})
    hot = dataclasses.replace(windows[3], temperatures_c={"t": np.full(3, 60.0)})
    found = result([open_thermometer, *windows[1:3], hot, *windows[4:]])
    assert found.left_out == ()
    assert f"{windows[0].step}: no_temperature" in texts(found.flags)
    beyond = flag_of(found.flags, f"{windows[3].step}: beyond_calibration")
    assert "outside the temperature range of its calibration" in flag_in_words(beyond)


def test_a_run_that_does_not_tell_the_power_on_or_had_no_calibration_determines_nothing():
    unknown = result([dataclasses.replace(each, on_since_s={}) for each in watched()])
    assert (unknown.findings, unknown.verdict) == ((), "INCOMPLETE")
    assert "the time of power-on is not in the record" in flag_in_words(flag_of(unknown.flags, "cold: no_power_on"))
    without = result(watched(), dataclasses.replace(SUPPLIED, released=None))
    assert (texts(without.flags), without.verdict) == (("calibration:not_given",), "INCOMPLETE")
    assert flag_in_words(without.flags[0]).startswith("calibration: no calibration of the unit was given")


def time_to_settle(value_s, low_s, high_s, *flags, limit_s=1800.0):
    interval = Interval(low_s, high_s, 0.0)
    lines, at = [BudgetLine("readings", "B", 700.0)], {"visit": 0, "axis": "x", "temperature_set_c": 15.0}
    found = Subject("s", "a", "SIM-A").finding("D0/settling", "t", value_s, "s", lines, at, (), "", flags, interval)
    return found.judged(Limits(high=limit_s))


@pytest.mark.parametrize(
    ("found", "reported"),
    [
        (time_to_settle(840.0, 0.0, 2100.0), "14 (0 to 35)"),
        (time_to_settle(952.0, 858.0, 1056.0), "15.9 (14.3 to 17.6)"),
        (time_to_settle(0.0, 0.0, 0.008, "within_from_the_start"), "0 (0 to 0)"),
        (time_to_settle(0.0, 0.0, 2580.0, "within_from_the_start", "perhaps_to_the_end"), "0 (0 to 43)"),
        (time_to_settle(2400.0, 0.0, 3000.0), "40 (0 to 50) !"),
        (time_to_settle(3120.0, 2400.0, 3120.0, "more_than"), "> 52 !"),
    ],
)
def test_a_time_to_settle_is_told_with_its_range_which_does_not_go_below_nought(found, reported):
    assert shown(found) == reported
    unit = UnitResult("a", "SIM-A", (found,), (), (), ())
    (line,) = [each for each in results_text(Results("T", "PASS", (unit,))).splitlines() if "D0: settling" in each]
    assert f" {reported}  min " in line
    assert "±" not in line
    assert ("in brackets the range of 95%" in line) == (">" not in reported)


def scattered(window, rng, sd_dps):
    """The window with gyros that scatter."""
    gyros = {
        name: each._replace(mean=each.mean + KG * rng.normal(0, sd_dps)) if "gyro" in name else each
        for name, each in window.windows.items()
    }
    return dataclasses.replace(window, windows=gyros)


@pytest.mark.parametrize(("sd_dps", "is_open"), [(1e-9, False), (3e-5, True)])
def test_a_time_that_may_be_anything_is_told_to_be_practically_not_determined(sd_dps, is_open):
    rng = np.random.default_rng(1)
    unit = result([scattered(each, rng, sd_dps) for each in watched()], gyro_zero_dps=1e-5)
    (found,) = (each for each in unit.findings if "/x/D0/settling" in each.id)
    assert ("practically_not_determined" in found.flags) == is_open
    alone, limits = dataclasses.replace(unit, findings=(found,)), {found.quantity: Limits(high=1e5)}
    (row,) = verdict_rows(alone, limits, IMU_START_UP.stated)
    assert ("practically not determined" in row.remark) == is_open
    sheet = next(each for each in start_up_plots(unit, "a") if "D0" in [head for head, _ in each.heads])
    assert ("Practically not determined: D0 axis x" in sheet.caption) == is_open
