"""A unit on both of its sides: cross coupling with the output axis, and what is stated where a side is missing."""

from __future__ import annotations

import pytest

from bench.metrology.acquisition import Mount
from tests.support.indexing_runs import ENDS, KIO, KIP, SIDES, TOWARDS_Y, TOWARDS_Z, Swept, calibrated


def test_both_sides_give_the_coupling_with_the_output_axis_and_the_misalignment_towards_it():
    values = {each.quantity: each.value for each in calibrated([*ENDS, *SIDES]).findings}
    assert values["Kio"] == pytest.approx(KIO, abs=1e-7)
    assert values["misalignment_y"] == pytest.approx(TOWARDS_Y, abs=1e-7)
    assert values["Kip"] == pytest.approx(KIP, abs=1e-7)
    assert values["misalignment"] == pytest.approx(TOWARDS_Z, abs=1e-7)


def test_the_sides_change_nothing_that_is_found_on_the_ends():
    ends, all_four = calibrated(ENDS), calibrated([*ENDS, *SIDES])
    assert all_four.findings[: len(ends.findings)] == ends.findings
    assert {each.quantity for each in all_four.findings[len(ends.findings) :]} == {"Kio", "misalignment_y"}
    assert (all_four.models, all_four.flags) == (ends.models, ends.flags)


@pytest.mark.parametrize("side", SIDES)
def test_one_side_alone_determines_nothing_and_is_flagged(side):
    result = calibrated([*ENDS, side])
    assert "sides:incomplete" in map(str, result.flags)
    assert not {each.quantity for each in result.findings} & {"Kio", "misalignment_y"}


def test_a_side_whose_output_is_at_its_limit_is_flagged():
    result = calibrated([*ENDS, SIDES[0], SIDES[1]._replace(saturated=True)])
    assert {"10 readings: saturated", "sides:incomplete"} <= set(map(str, result.flags))
    assert result.verdict == "NOT JUDGED"


def test_a_clocked_unit_is_on_no_side():
    clocked = Swept("clocking", Mount("clock_90", clock_deg=90.0))
    assert "sides:incomplete" not in map(str, calibrated([*ENDS, clocked]).flags)
