"""Scale factors that are not the stated ones, of sensors on a rate table."""

import math

import pytest

from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import Subject
from bench.metrology.run_data import UnitUnderTest
from bench.metrology.unlike_nominal import OTHER_SIGN, OTHER_SIZE, compared_with_nominal

UNIT = UnitUnderTest("a", "G-1", "a", 0.0, "t")


def found(quantity, value, u, **at):
    return Subject("range", "a", "G-1").finding(quantity, quantity, value, "1", [BudgetLine("s", "B", u)], at, ())


@pytest.mark.parametrize(
    ("error", "u", "flags"),
    [(-2.0, 1e-5, (OTHER_SIGN,)), (0.001, 1e-5, ()), (-0.99, 1e-5, (OTHER_SIZE,)), (56.3, 1e-3, (OTHER_SIZE,)),
     (-2.0, 1.0, ()), (-0.6, 0.1, ())],
)  # fmt: skip
def test_of_a_gyro_over_its_range(error, u, flags):
    (got,) = compared_with_nominal([found("scale_error", error, u)], UNIT)
    assert got.flags == flags


@pytest.mark.parametrize(("phases", "flagged"), [((-3.0, -90.0, -150.0), False), ((177.0, 90.0, 30.0), True)])
def test_of_a_gyro_that_swings_by_its_phase_at_the_lowest_frequency(phases, flagged):
    findings = [
        found("phase", value, 0.1, frequency_hz=hz) for hz, value in zip((0.5, 60.0, 90.0), phases, strict=True)
    ]
    got = compared_with_nominal(findings, UNIT)
    assert [OTHER_SIGN in each.flags for each in got] == [flagged, False, False]


def test_nothing_is_flagged_where_nothing_is_stated():
    finding = found("K1", -5.0, 0.1)
    assert compared_with_nominal([finding], UNIT) == (finding,)
    assert math.isnan(UNIT.scale_a_per_g)
