"""Control chart: limits computed by hand, each rule on the smallest case that completes it, and false alarms."""

import numpy as np
import pytest

from bench.station.units.control_chart import LEAST, RULES, control_chart

QUIET = [1.0, -1.0] * 10  # mean 0, each moving range 2, σ = 2 / 1.128 = 1.773


def rules(*later):
    return [(each.number - LEAST, each.rule[-1]) for each in control_chart([*QUIET, *later]).signals]


def test_the_limits_are_those_of_the_moving_range():
    chart = control_chart(QUIET)
    assert chart.centre == 0
    assert chart.high == pytest.approx(2.66 * 2, rel=1e-3)  # 3 / 1.128 = 2.66
    assert chart.low == -chart.high
    assert chart.signals == ()


def test_fewer_than_twenty_values_have_no_chart():
    assert control_chart(QUIET[1:]) is None
    assert control_chart([1.0] * 30) is None


def test_later_values_do_not_change_the_limits():
    assert control_chart([*QUIET, 50.0, -50.0]).high == control_chart(QUIET).high


@pytest.mark.parametrize(
    ("later", "expected"),
    [
        ((5.4,), [(0, "1")]),
        ((5.2,), []),
        ((3.6, 0.0, 3.6), [(2, "2")]),
        ((3.6, 0.0, -3.6), []),
        ((1.8, 1.8, 0.0, 1.8, 1.8), [(4, "3")]),
        ((1.8, 1.8, 0.0, -1.8, 1.8), []),
        ((-0.1,) * 7, [(6, "4")]),  # with the last of the quiet ones
        ((-0.1,) * 6, []),
    ],
)
def test_each_rule_is_completed_by_the_last_value_of_its_smallest_case(later, expected):
    assert rules(*later) == expected


def test_every_rule_is_described():
    assert set(RULES) == {f"Western Electric {n}" for n in (1, 2, 3, 4)}


def test_values_by_chance_alone_are_seldom_beyond_the_limits():
    random = np.random.default_rng(1)
    charts = [control_chart(list(random.normal(size=60))) for _ in range(300)]
    beyond = sum(each.rule.endswith("1") for chart in charts for each in chart.signals) / (300 * 60)
    assert 0.001 < beyond < 0.012  # 0.27 % with known limits; more with those of 20 values
