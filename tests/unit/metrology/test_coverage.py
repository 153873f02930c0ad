"""Coverage factors by degrees of freedom, and what depends on them."""

import numpy as np
import pytest

from bench.methods.rate_table.reduction.blocks import TableRecord
from bench.methods.rate_table.reduction.recorded_range import LinearityLimit, gyro_range
from bench.metrology.results.budget import BudgetLine
from bench.metrology.results.coverage import coverage_factor
from bench.metrology.results.finding import Subject
from bench.metrology.results.limits import Limits

# Table G.2 of JCGM 100:2008, column 95.45 %.
PRINTED = {1: 13.97, 2: 4.53, 3: 3.31, 4: 2.87, 5: 2.65, 6: 2.52, 8: 2.37, 10: 2.28, 15: 2.18, 20: 2.13, 50: 2.05}


@pytest.mark.parametrize("dof", PRINTED)
def test_the_factors_are_those_of_the_printed_table(dof):
    assert coverage_factor(dof) == pytest.approx(PRINTED[dof], abs=0.005)


def test_it_is_2_without_limit_and_never_less():
    assert coverage_factor(None) == 2
    assert coverage_factor(10**6) == pytest.approx(2, abs=1e-4)
    assert coverage_factor(10**6) >= 2


def found(*lines: BudgetLine, value: float = 1.0):
    return Subject("a", "uut", "unit").finding("K0", "K0", value, "g", lines, {}, ())


def test_few_degrees_of_freedom_widen_the_expanded_uncertainty():
    many = found(BudgetLine("scatter", "A", 0.3), BudgetLine("certificate", "B", 0.4))
    few = found(BudgetLine("scatter", "A", 0.3, dof=2), BudgetLine("certificate", "B", 0.4))
    assert (many.u, many.k, many.expanded) == pytest.approx((0.5, 2.0, 1.0))
    assert few.dof == 15  # 0.5^4 / (0.3^4 / 2) = 15.4
    more = found(BudgetLine("scatter", "A", 0.3, dof=2), BudgetLine("certificate", "B", 0.404))
    assert more.dof == 15  # 15.8, truncated
    assert found(BudgetLine("scatter", "A", 0.1, dof=3)).dof == 3
    assert few.k == pytest.approx(PRINTED[15], abs=0.005)
    assert few.expanded == pytest.approx(0.5 * few.k)


def test_a_limit_within_the_wider_uncertainty_is_marginal_and_the_guard_band_widens_with_it():
    few = found(BudgetLine("scatter", "A", 0.1, dof=3))
    many = found(BudgetLine("scatter", "A", 0.1))
    near = Limits(high=1.25)  # 2.5 u away: beyond 2 u, within 3.31 u
    assert few.judged(near).marginal
    assert few.judged(near).within_u
    assert not many.judged(near).marginal
    guarded = Limits(high=1.25, guard_k=2)
    assert many.judged(guarded).verdict == "PASS"
    assert few.judged(guarded).verdict == "FAIL"
    assert few.judged(guarded).flags == ("guard_band",)


def test_a_point_of_a_range_is_marginal_by_its_expanded_uncertainty():
    rng = np.random.default_rng(4)
    time_s = np.arange(0.0, 4.0)
    block = np.repeat(["bias", "run1"], len(time_s))
    table = np.concatenate([np.zeros(len(time_s)), 50.0 * time_s])
    output = np.concatenate([np.zeros(len(time_s)), np.full(len(time_s), 50.1)]) + 0.01 * rng.standard_normal(
        len(block)
    )
    record = TableRecord(block, np.concatenate([time_s, time_s]), table, output)

    def point(limit):
        return gyro_range(record, {"run1": 50.0}, LinearityLimit(limit, full_scale=1.0)).points[0]

    found = point(1.0).error
    assert 2.2 < coverage_factor(found.dof) < 4
    assert point(abs(found.value) + 2.1 * found.u).marginal
    assert not point(abs(found.value) + 1.01 * coverage_factor(found.dof) * found.u).marginal
