"""The slope of a unit without its hysteresis, from dwells of rising and of falling temperature."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import default_rng

from bench.methods.tumble.method import TEMPERATURE_TUMBLE
from bench.methods.tumble.reduction.run import reduce
from bench.metrology.least_squares import Array, fit_polynomial
from bench.metrology.results.finding import Finding
from bench.metrology.reversible import reversible_slope
from tests.unit.methods.tumble.test_thermometer_drift import BENCH, tumble

QUICK_C = np.array([20.0, 45, 70, 45, 20, -10, -40, -10, 20]) + 5
WHOLE_C = np.array([*range(20, 80, 10), *range(60, -50, -10), *range(-30, 30, 10)]) + 5.0
SCATTER_G = 0.4e-6
FORMS = [(5.0, 10, 20, 30, 40), (5.0, 10), (2.0,), (10.0, 20, 40, 60, 80)]  # thresholds of plays, in °C


def reversible_g(at_c: Array) -> Array:
    t = at_c - 20
    return np.asarray(1e-5 * t + 3e-8 * t**2 + 4e-10 * t**3)


def per_c(at_c: Array) -> Array:
    t = at_c - 20
    return np.asarray(1e-5 + 6e-8 * t + 12e-10 * t**2)


def loops_g(at_c: Array, thresholds_c: tuple[float, ...], amplitude_g: float) -> Array:
    """Hysteresis of a unit that has been at 22 °C for long before the first dwell."""
    behind_c, found = [22.0] * len(thresholds_c), []
    for now_c in at_c:
        behind_c = [max(now_c - r, min(now_c + r, y)) for r, y in zip(thresholds_c, behind_c, strict=True)]
        found.append(sum(now_c - y for y in behind_c) / sum(thresholds_c))
    return amplitude_g * np.array(found)


def of_line(at_c: Array, slope: Array) -> tuple[float, float]:
    """What 1 °C of offset, and 1 % of gain, make of the slope of the straight line, in g/°C."""
    weights = (at_c - at_c.mean()) / np.sum((at_c - at_c.mean()) ** 2)
    return float(weights @ slope), 0.01 * float(weights @ (slope * at_c))


@pytest.mark.parametrize("at_c", [QUICK_C, WHOLE_C], ids=["quick", "whole"])
@pytest.mark.parametrize("thresholds_c", FORMS, ids=["five", "two", "one", "wide"])
@pytest.mark.parametrize("amplitude_g", [60e-6, 300e-6], ids=["60", "300"])
def test_what_a_thermometer_makes_of_the_slope_is_that_of_the_unit_without_its_loops(
    at_c: Array, thresholds_c: tuple[float, ...], amplitude_g: float
) -> None:
    values = reversible_g(at_c) + loops_g(at_c, thresholds_c, amplitude_g)
    values += SCATTER_G * default_rng(1).standard_normal(len(at_c))
    model = fit_polynomial(at_c, values, 4)
    found = np.hypot(*of_line(at_c, reversible_slope(at_c, values, SCATTER_G, model)))
    expected = np.hypot(*of_line(at_c, per_c(at_c)))
    assert found == pytest.approx(expected, rel=0.2)
    if amplitude_g > 100e-6:
        assert abs(found - expected) < 0.7 * abs(np.hypot(*of_line(at_c, model.slope(at_c))) - expected)


def test_a_unit_without_hysteresis_has_the_slope_of_its_model() -> None:
    for at_c in (QUICK_C, WHOLE_C):
        values = reversible_g(at_c)
        found = reversible_slope(at_c, values, SCATTER_G, fit_polynomial(at_c, values, 4))
        assert found == pytest.approx(per_c(at_c), rel=1e-6)
        assert reversible_slope(at_c, values, 0.0, fit_polynomial(at_c, values, 4)) == pytest.approx(found, rel=1e-6)


@pytest.mark.parametrize(
    ("at_c", "degree"),
    [
        (np.arange(-40.0, 80, 10), 4),  # never turns
        (np.array([20.0, 70, 20, -40, 20]), 2),  # no more dwells than coefficients, from the first reversal on
        (np.array([20.0, 20.3, 19.9, 70]), 1),  # what stands still does not turn
    ],
)
def test_without_dwells_after_a_reversal_it_is_the_slope_of_the_model(at_c: Array, degree: int) -> None:
    values = reversible_g(at_c) + loops_g(at_c, FORMS[0], 60e-6)
    model = fit_polynomial(at_c, values, degree)
    assert reversible_slope(at_c, values, SCATTER_G, model) == pytest.approx(model.slope(at_c))


def test_budgets_of_a_tumble_hold_what_a_thermometer_makes_of_the_unit_without_its_loops() -> None:
    """10 µg/°C by a thermometer with 0.3 °C of offset and 0.1 % of gain; the loops of 300 µg are moved along by it."""
    run = tumble(0.0, (WHOLE_C - 5).tolist())
    scale_v_per_g = 2.0
    loops = loops_g(WHOLE_C, FORMS[1], 300e-6).repeat(4)
    acquisitions = []
    for each, loop_g in zip(run.acquisitions, loops.tolist(), strict=True):
        read = each.voltages["dvm"]
        looped = read._replace(values_v=read.values_v + scale_v_per_g * loop_g)
        acquisitions.append(replace(each, voltages={"dvm": looped}))
    bench = replace(BENCH, thermometers_u={"t": (0.3, 1e-3)}, thermometer_drifts={})
    settings = TEMPERATURE_TUMBLE.settings.model_validate({"degree": 4}).model_dump()
    (unit,) = reduce(replace(run, acquisitions=tuple(acquisitions), bench=bench), settings)

    def u_of(finding: Finding, *sources: str) -> float:
        return float(np.linalg.norm([line.u for line in finding.budget if line.source in sources]))

    (slope,) = (each for each in unit.findings if each.quantity == "K0/temperature_coefficient")
    assert slope.value > 12e-6, "the loops are in the slope"
    assert u_of(slope, "t: offset", "t: gain") == pytest.approx(1e-8, rel=0.1)
    (local,) = (each for each in unit.findings if each.quantity == "K0T1")
    assert u_of(local, "t: offset", "t: gain") == pytest.approx(1e-8, rel=0.2)
    for found in unit.findings:
        if found.quantity == "K0":
            expected = 10e-6 * np.hypot(0.3, found.at["temperature_c"] * 1e-3)
            assert u_of(found, "t: offset, gain") == pytest.approx(expected, rel=0.15)
