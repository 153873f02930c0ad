"""Above the course of a run stand the numbers and names that the tables of its report have."""

import dataclasses

import numpy as np
import pytest

from bench.analysis.acquired import Acquisition, Motion
from bench.analysis.rundata import RunData
from bench.report import channel_plots as of_channels
from bench.report import imu_plots as of_inertial_units
from bench.report.course_names import spans_of
from bench.report.imu_plots import imu_plots
from bench.report.plots import TimeOfRun
from bench.sequence.methods import known_methods
from bench.sequence.model import ResultEntry
from tests.unit.test_channel_method import BENCH, UNIT, Made, four_levels, reduced
from tests.unit.test_imu_windows import BENCH as TABLE
from tests.unit.test_imu_windows import UNIT as INERTIAL
from tests.unit.test_imu_windows import acquired, record, result
from tests.unit.test_imu_windows import block as windows


def names(method, data, **entry):
    described = ResultEntry(method=method, data="data", **entry)
    return [span.name for span in spans_of(data, described, known_methods()[method])]


def acquisition(step, group, begin_s, motion=None):
    return Acquisition(step, group, {}, begin_s, begin_s + 5.0, {}, 20.0, 20.0, {}, {}, {}, motion=motion)


def groups(*which):
    made = [acquisition(f"{group}/acquire", group, 10.0 * number) for number, group in enumerate(which)]
    return RunData("data", (UNIT,), tuple(made), BENCH)


def test_dwells_are_numbered_as_in_the_tables_of_their_method():
    data = groups("a", "a", "b", "c")
    assert names("temperature_tumble", data) == ["0", "1", "2"]
    assert names("repeatability", data) == ["1", "2", "3"]
    first, *_ = spans_of(data, ResultEntry(method="repeatability", data="data"), known_methods()["repeatability"])
    assert (first.begin_s, first.end_s) == (0.0, 15.0)


def test_input_levels_have_their_names_where_they_were_ramped_through():
    data = RunData("data", (UNIT,), tuple(four_levels().acquisitions), BENCH)
    found = names("channel_temperature", data)
    assert [name for name in found if name] == ["up_1g", "skew", "src_1g", "src_12g"]
    assert found[:4] == ["", "up_1g", "", ""]
    assert len(found) == len(data.acquisitions)


def test_units_that_are_fed_otherwise_stand_together():
    other = dataclasses.replace(UNIT, place="b", scale_a_per_g=UNIT.scale_a_per_g / 2)
    data = RunData("data", (UNIT, other), tuple(Made().level("source", 1.0).acquisitions), BENCH)
    assert names("channel_temperature", data) == ["", "src_1g / src_2g", ""]


def test_visits_have_their_set_points_and_what_is_for_closure_no_number():
    made = windows(TABLE, "s/hot", "x") + windows(TABLE, "s/cold", "x")
    data = RunData("data", (INERTIAL,), tuple(made), record(TABLE))
    assert names("imu_calibration", data, closure="closing") == ["50 °C", "20 °C"]
    looked = dataclasses.replace(data, label="closing")
    assert names("imu_calibration", looked, closure="closing") == ["closure", "closure"]
    never_set = [dataclasses.replace(each, set_c=float("nan")) for each in made]
    assert names("imu_calibration", dataclasses.replace(data, acquisitions=tuple(never_set))) == ["", ""]


def test_points_of_ranges_and_sweeps_have_their_rates_and_frequencies():
    motions = (None, Motion("table", rate_dps=-50.0), Motion("table", amplitude_deg=1.0, frequency_hz=10.37))
    made = [acquisition(f"s/{number}", "s", 10.0 * number, each) for number, each in enumerate(motions)]
    assert names("gyro_range", RunData("data", (UNIT,), tuple(made), BENCH)) == ["", "-50 °/s", "10.37 Hz"]


def test_sweeps_have_the_ends_that_units_stood_on():
    steps = ("s/end=up/sign=1/acquire", "s/end=up/sign=-1/acquire", "s/end=down/acquire", "s/clocking/acquire",
             "s/verification/acquire")  # fmt: skip
    attitudes = ("Az1", "Az2", "Az5", "Az1", "Az1")
    still = np.zeros(6)
    made = [acquired(step, step.rpartition("/")[0], TABLE, windows(TABLE, "s", "z")[0].mount, attitude, still)
            for step, attitude in zip(steps, attitudes, strict=True)]  # fmt: skip
    unit = dataclasses.replace(INERTIAL, channels={})
    data = RunData("data", (unit,), tuple(made), record(TABLE))
    assert names("indexing_static", data) == ["+Z up", "+Z down", "", "verification"]


@pytest.fixture
def drawn(monkeypatch):
    """The figures that are rendered, by their titles."""
    figures = {}

    def keep(figure, _name, title):
        figures[title] = figure
        return ""

    for module in (of_channels, of_inertial_units):
        monkeypatch.setattr(module, "rendered", keep)
    return figures


def test_the_converter_is_drawn_over_the_time_that_the_course_has(drawn):
    made = Made().level("gravity", 1.0)  # from 1000 s of bench time, with the ramp from 1601 s
    unit = reduced(made)
    span_s = (400.0, 8000.0)
    detail = dataclasses.replace(unit.detail, span_s=span_s)
    list(of_channels.channel_plots(dataclasses.replace(unit, detail=detail), "a"))
    (axes,) = drawn["Temperature of the converter while each level was counted"].axes
    assert axes.get_xlabel() == "time since the run began / h"
    assert axes.get_xlim() == (0.0, (span_s[1] - span_s[0]) / 3600)
    first_h = axes.lines[0].get_xdata()[0]
    assert first_h == pytest.approx((1601.0 - 400.0) / 3600, abs=0.01)


def test_a_short_run_is_drawn_over_minutes():
    assert TimeOfRun(10.0, 7210.0).unit == ("min", 60.0)
    assert TimeOfRun(10.0, 7211.0).unit == ("h", 3600.0)
    assert TimeOfRun(10.0, 7210.0).at(np.array([10.0, 70.0])).tolist() == [0.0, 1.0]


def test_what_knots_change_by_has_the_bars_of_its_findings(drawn):
    made = [window for group, at_c in (("s/1", -10.0), ("s/2", 20.0), ("s/3", 50.0)) for window in at(group, at_c)]
    unit = result(made)
    plots = list(imu_plots(unit, "a"))
    told = [plot.caption for plot in plots if "over temperature" in plot.title]
    assert all("Bars: expanded uncertainty, k = 2" in caption for caption in told)
    figure = drawn["Gyros over temperature, before and after compensation"]
    of_zero, of_scale, left_out, _ = figure.axes
    u = {(each.quantity, each.at["axis"]): each.u for each in unit.findings if "visit" not in each.at}
    for axis, above, below in zip("xyz", of_zero.containers, left_out.containers, strict=True):
        assert heights(above) == pytest.approx([4 * 3600 * u["D0/change", axis]] * 3)
        assert heights(below) == pytest.approx([4 * 3600 * u["D0/interpolation", axis]])
    assert heights(of_scale.containers[1]) == pytest.approx([4e6 * u["KG/change", "y"]] * 3)
    beside = [container.lines[0].get_xdata()[0] for container in left_out.containers]
    assert beside == pytest.approx([20 - 0.03 * 60, 20, 20 + 0.03 * 60], abs=1e-6)


def at(group, temperature_c):
    """All windows of a unit at one temperature, with noise."""
    made = windows(TABLE, group, "xyz", rng=np.random.default_rng(round(temperature_c) + 100))
    return [
        dataclasses.replace(each, set_c=temperature_c, temperatures_c={"t": np.full(3, temperature_c)}) for each in made
    ]


def heights(container):
    """From the lower to the upper end of each bar."""
    (bars,) = container.lines[2]
    return [float(upper[1] - lower[1]) for lower, upper in bars.get_segments()]
