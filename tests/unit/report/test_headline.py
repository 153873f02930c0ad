"""What a headline says of values whose uncertainty reaches over a limit."""

from __future__ import annotations

import pytest

from bench.figures.languages import language
from bench.figures.words import of_those_within_u
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.finding import Subject, UnitResult
from bench.metrology.results.limits import Limits
from bench.reduce.evaluate import Results
from bench.report.terminal import results_text


def results(*values_g):
    """K0 with U = 2 mg, at most 10 mg."""
    line = BudgetLine("noise", "A", 1e-3)
    found = [
        Subject("x", "a", "SN")
        .finding("K0", "", value_g, "g", [line], {"point": n}, (), f"@{n}")
        .judged(Limits(None, 10e-3))
        for n, value_g in enumerate(values_g)
    ]
    unit = UnitResult("a", "SN", tuple(found), (), (), ())
    return Results("Test", unit.verdict, (unit,))


@pytest.mark.parametrize(
    ("values_g", "message"),
    [
        ((5e-3,), "Verdict: PASS"),
        ((5e-3, 8.5e-3), "Verdict: PASS, 1 value within U of the limit"),
        ((9e-3, 11e-3), "Verdict: FAIL, 2 values within U of the limit"),
        ((13e-3,), "Verdict: FAIL"),
    ],
)
def test_the_last_line_says_how_many_values_could_be_on_the_other_side(values_g, message):
    assert results_text(results(*values_g)).strip().splitlines()[-1] == message


def test_a_headline_in_chinese_says_it_in_chinese():
    with language("zh"):
        assert of_those_within_u(2) == "2 个值与限值之差小于 U"
