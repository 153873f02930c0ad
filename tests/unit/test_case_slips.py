"""Slips of people who recorded a case elsewhere; `python -m tests.trials --only slips_in_cases` has more of them."""

import numpy as np
import pytest

from bench.report.case import REDUCTIONS, reduce_case
from bench.report.case_outcome import outcome
from tests.support.any_case import KINDS, good_case
from tests.trials.slips_in_cases import SLIPS, missed, no_cell_is_trusted

JUDGED = {("M3", "gyro_range"), ("M3", "acc_range"), ("M4", "dynamic")}


def test_there_is_a_good_case_of_every_kind():
    assert set(KINDS) == set(REDUCTIONS) == {(slip.method, slip.sub) for slip in SLIPS}


@pytest.mark.parametrize("kind", KINDS)
def test_a_good_case_raises_no_doubt_and_neither_does_one_that_reads_downwards(tmp_path, kind):
    case = good_case(*kind)
    assert reduce_case(case.write(tmp_path))["flags"] == []
    for column in ("V_mean", "V", "U_V", *(f"{sensor}{axis}" for sensor in "NW" for axis in "xyz")):
        case[column] = lambda values: -values
    if "K1_V_per_g" in case.settings:
        case.settings["K1_V_per_g"] *= -1
    result = reduce_case(case.write(tmp_path))
    assert (result["flags"], outcome(result)) == ([], "PASS" if kind in JUDGED else "REDUCED")


@pytest.mark.parametrize("slip", SLIPS, ids=lambda slip: f"{slip.method} {slip.sub} {slip.name}")
def test_a_slip_is_seen(slip):
    assert missed(slip) == ""


@pytest.mark.parametrize("kind", KINDS)
def test_a_record_of_one_row_or_none_is_not_complete(tmp_path, kind):
    case = good_case(*kind)
    case.first_rows(1)
    assert outcome(reduce_case(case.write(tmp_path))) == ("REDUCED" if kind == ("M3", "two_sample") else "INCOMPLETE")
    case.first_rows(0)
    assert outcome(reduce_case(case.write(tmp_path))) == "INCOMPLETE"


def test_hostile_cells_are_refused_or_left_out():
    rng = np.random.default_rng(7)
    assert [found for kind in KINDS for _ in range(2) if (found := no_cell_is_trusted(rng, *kind))] == []
