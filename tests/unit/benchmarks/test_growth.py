"""Fits of costs over sizes."""

from __future__ import annotations

import pytest

from benchmarks.growth import fitted

SIZES = (1.0, 2.0, 4.0, 8.0, 16.0)


@pytest.mark.parametrize("power", [0.5, 1.0, 1.5, 2.0])
def test_the_power_of_a_cost_is_found(power: float) -> None:
    fit = fitted(SIZES, [3.0 + 2.0 * size**power for size in SIZES])
    assert fit.power == pytest.approx(power, abs=0.011)


def test_a_line_is_a_line() -> None:
    fit = fitted(SIZES, [3.0 + 2.0 * size for size in SIZES])
    assert (fit.begin, fit.each, fit.off_line) == pytest.approx((3.0, 2.0, 0.0))


def test_no_cost_begins_below_zero() -> None:
    fit = fitted(SIZES, [size**2 for size in SIZES])
    assert fit.begin == 0
    assert fit.off_line > 0.3
