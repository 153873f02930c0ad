"""The scatter of a repeated tumble, beside what every repetition has alike: the bend of a warm-up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.methods.tumble.reduction.repeatability import reduce
from bench.metrology.acquisition import Acquisition, Voltages
from bench.metrology.bench_uncertainty import AxisRecord, BenchRecord
from bench.metrology.results.finding import Finding, UnitResult
from bench.metrology.run_data import RunData, UnitUnderTest
from tests.support.flags import texts

BENCH = BenchRecord(
    gravity_mps2=9.8, gravity_u_mps2=0.0, axes={"head": AxisRecord()}, x=(1.0, 0.0, 0.0), z=(0.0, 0.0, 1.0),
    level_deg=0.0, level_u_deg=0.0, time_base_u=0.0, thermometers_u={},
)  # fmt: skip
UNIT = UnitUnderTest("a", "S1", "x", 0.0, "t", voltmeter="dvm")
POSITIONS_DEG = (1.0, 91.0, 181.0, 271.0, 271.0, 181.0, 91.0, 1.0)
REPETITIONS, GATE_S, NOISE_G = 6, 60.0, 1e-6


def result_with(warm_up_g: float, unit: UnitUnderTest = UNIT) -> UnitResult:
    """A unit whose readings scatter by 1 µg, and whose bias settles exponentially in each repetition."""
    rng = np.random.default_rng(7)
    dwells = []
    for number in range(REPETITIONS * len(POSITIONS_DEG)):
        repetition, position = divmod(number, len(POSITIONS_DEG))
        at_s = number * GATE_S + np.arange(0.5, GATE_S)
        bias_g = warm_up_g * np.exp(-(position + 0.5) / 3) + rng.normal(0, NOISE_G)
        volts = 2.0 * (np.sin(np.radians(POSITIONS_DEG[position])) + bias_g)
        group = f"steps/repetition={repetition + 1}"
        dwells.append(Acquisition(
            step=f"{group}/position={position}/acquire", group=group, begin_s=number * GATE_S,
            end_s=(number + 1) * GATE_S, set_from_c=25.0, set_c=25.0, counts={},
            loops={"repetition": float(repetition + 1)}, angles_deg={"head": POSITIONS_DEG[position]},
            voltages={"dvm": Voltages(at_s, np.full(len(at_s), volts))}, temperatures_c={"t": np.full(60, 25.0)},
            temperatures_at_s={"t": at_s},
        ))  # fmt: skip
    (result,) = reduce(RunData("repeat", (unit,), tuple(dwells), BENCH), {"bias_per_c_u": 0.0})
    return result


def closure_with(warm_up_g: float) -> Finding:
    (closure,) = (each for each in result_with(warm_up_g).findings if each.quantity == "K0/closure")
    return closure


def test_a_bend_that_every_repetition_has_is_no_scatter():
    assert closure_with(50e-6).u == pytest.approx(closure_with(0.0).u, rel=0.02)


def test_the_closure_is_as_uncertain_as_the_readings_make_it():
    assert closure_with(0.0).u == pytest.approx(np.sqrt(2 / len(POSITIONS_DEG)) * NOISE_G, rel=0.5)


@pytest.mark.parametrize(
    ("nominal", "flags"), [(2.1, ()), (-2.0, ("K1:sign_unlike_nominal",)), (0.2, ("K1:size_unlike_nominal",))]
)
def test_a_scale_factor_of_another_sign_or_size_than_stated_is_flagged(nominal, flags):
    assert texts(result_with(0.0, replace(UNIT, nominal_per_g=nominal)).flags) == flags
