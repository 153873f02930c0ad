"""Lines of the table of comparisons."""

from __future__ import annotations

import math
from dataclasses import replace

from benchmarks.compared import Row, Side, table


def row(ours: tuple[float, ...], theirs: tuple[float, ...]) -> Row:
    return Row(
        "P1", "work", "s", Side("ours", "none", ours), (Side("theirs", "none", theirs),), "", "goal", is_met=True
    )


def test_a_ratio_is_the_median_of_the_rounds() -> None:
    each = row((1.0, 2.0, 4.0), (10.0, 10.0, 10.0))
    assert each.ratio(each.peers[0]) == 5.0


def test_of_rates_the_higher_is_better() -> None:
    each = replace(row((10.0, 10.0, 10.0), (1.0, 2.0, 4.0)), lower_is_better=False)
    assert each.ratio(each.peers[0]) == 5.0
    nothing = replace(row((10.0,), (0.0,)), lower_is_better=False)
    assert nothing.ratio(nothing.peers[0]) == math.inf


def test_what_costs_nothing_is_infinitely_better() -> None:
    each = row((0.0, 0.0), (10.0, 10.0))
    assert each.ratio(each.peers[0]) == math.inf
    assert "| ∞ × |" in table([each])
