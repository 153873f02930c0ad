"""Above the course of a run stand the numbers and names that the tables of its report have."""

import dataclasses

import numpy as np

from bench.metrology.acquisition import Acquisition, Motion
from bench.metrology.run_data import RunData
from bench.reduce.spans import spans_of
from bench.sequence.document.model import ResultEntry
from bench.sequence.method import known_methods
from tests.unit.methods.channel.test_channel_method import BENCH, UNIT, Made, four_levels
from tests.unit.methods.imu.test_imu_windows import BENCH as TABLE
from tests.unit.methods.imu.test_imu_windows import UNIT as INERTIAL
from tests.unit.methods.imu.test_imu_windows import acquired, record
from tests.unit.methods.imu.test_imu_windows import block as windows


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
