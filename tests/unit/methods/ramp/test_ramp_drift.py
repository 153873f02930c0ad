"""A thermometer, or a level, that drifts while a temperature ramp goes on.

The drift is exactly one standard uncertainty and nothing else has an error, so that each figure is off by what its
budget states of the drift.
"""

from __future__ import annotations

import numpy as np
import pytest

from bench.methods.ramp.method import TEMPERATURE_RAMP
from bench.methods.ramp.reduction.run import reduce
from bench.metrology.acquisition import Acquisition, Voltages
from bench.metrology.bench_uncertainty import AxisRecord, BenchRecord, Drift
from bench.metrology.results.finding import Finding
from bench.metrology.run_data import RunData, UnitUnderTest

DRIFT_C, DRIFT_DEG = 0.03, 0.2 / 3600
SETTINGS = TEMPERATURE_RAMP.settings.model_validate({}).model_dump()
BENCH = BenchRecord(
    gravity_mps2=9.8, gravity_u_mps2=0.0, axes={"head": AxisRecord()}, x=(1.0, 0.0, 0.0), z=(0.0, 0.0, 1.0),
    level_deg=0.0, level_u_deg=0.0, time_base_u=0.0, thermometers_u={"t": (0.0, 0.0)},
    thermometer_drifts={"t": Drift(DRIFT_C)}, level_drift=Drift(DRIFT_DEG),
)  # fmt: skip
UNIT = UnitUnderTest("a", "S1", "x", 0.0, "t", voltmeter="dvm")
LOW_C, HIGH_C, LEG_S, LEGS = -10.0, 60.0, 2400.0, 8
FIGURES = (
    "K0/temperature_coefficient", "K0/model_residual", "K0/model_residual_rms", "K0/hysteresis", "K0/repeatability",
    "K1/temperature_coefficient",
)  # fmt: skip


def leg(number: int, drift_c: float, drift_deg: float) -> Acquisition:
    """A leg of a unit that changes by 50 µg/°C and more the warmer it is, with a loop and a second cycle of its own."""
    position_deg, cycle, rising = 1.0 + 90 * (number // 4), 1 + number // 2 % 2, number % 2 == 0
    at_s = number * LEG_S + np.arange(0.5, LEG_S)
    ends_c = (LOW_C, HIGH_C) if rising else (HIGH_C, LOW_C)
    true_c = np.interp(at_s, [number * LEG_S, (number + 1) * LEG_S], ends_c)
    away_c, lens = true_c - 25, 1 - ((true_c - 25) / 35) ** 2
    bias_g = 50e-6 * away_c + 0.3e-6 * away_c**2 + (15e-6 if rising else -15e-6) * lens + 0.2e-6 * cycle * away_c
    share = at_s / (LEGS * LEG_S) - 0.5
    volts = 2.0 * (1 - 200e-6 * away_c) * (np.sin(np.radians(position_deg + drift_deg * share)) + bias_g)
    read_c = true_c + drift_c * share
    return Acquisition(
        step=f"steps/position={position_deg:g}/cycle={cycle}/end={ends_c[1]:g}/acquire", group="",
        begin_s=number * LEG_S, end_s=(number + 1) * LEG_S, set_from_c=ends_c[0], set_c=ends_c[1], counts={},
        loops={"position": position_deg, "cycle": cycle, "end": ends_c[1]}, angles_deg={"head": position_deg},
        voltages={"dvm": Voltages(at_s, volts)}, temperatures_c={"t": read_c}, temperatures_at_s={"t": at_s},
    )  # fmt: skip


def found_with(drift_c: float, drift_deg: float = 0.0) -> dict[str, Finding]:
    legs = tuple(leg(number, drift_c, drift_deg) for number in range(LEGS))
    (result,) = reduce(RunData("ramp", (UNIT,), legs, BENCH, span_s=(0.0, LEGS * LEG_S)), SETTINGS)
    return {each.quantity: each for each in result.findings}


@pytest.fixture(scope="module")
def true() -> dict[str, Finding]:
    return found_with(0.0)


@pytest.fixture(scope="module")
def drifted() -> dict[str, Finding]:
    return found_with(DRIFT_C)


@pytest.mark.parametrize("quantity", FIGURES)
def test_a_figure_is_off_by_what_its_budget_states_of_the_drift(quantity, true, drifted):
    off = abs(drifted[quantity].value - true[quantity].value)
    stated = {line.source: line.u for line in drifted[quantity].budget}["t: drift within the run"]
    assert off > 0
    assert stated == pytest.approx(off, rel=0.1)


@pytest.mark.parametrize("quantity", FIGURES)
def test_a_figure_is_off_by_what_its_budget_states_of_the_level(quantity, true):
    tilted = found_with(0.0, DRIFT_DEG)[quantity]
    off = abs(tilted.value - true[quantity].value)
    stated = {line.source: line.u for line in tilted.budget}.get("fixture: level: drift within the run", 0.0)
    assert stated == pytest.approx(off, rel=0.1, abs=1e-3 * tilted.u)


@pytest.mark.parametrize("quantity", [each for each in FIGURES if "coefficient" not in each])
def test_the_interval_of_a_largest_value_holds_the_truth(quantity, true, drifted):
    interval = drifted[quantity].interval
    assert interval is not None
    assert interval.low <= true[quantity].value <= interval.high
