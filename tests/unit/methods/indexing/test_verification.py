"""The regression test of the verification: a unit that has changed since its calibration, and one that has not."""

from __future__ import annotations

import numpy as np
import pytest

from bench.metrology.results.curves import Equation
from tests.support.indexing_runs import ENDS, K0, K1, TILTED_RAD, TOWARDS_Z, calibrated

NOISE_G = 1e-6
CORRECTED = "corrected_acceleration_up"


def verified(shift_g=0.0, stretch=0.0, seed=1, noise_g=NOISE_G):
    again = ENDS[0]._replace(group="verification", k0=K0 + shift_g, k1=K1 * (1 + stretch))
    return calibrated([*ENDS, again], noise_g, seed)


def equation(result, quantity):
    return next((each for each in result.models if isinstance(each, Equation) and each.quantity == quantity), None)


@pytest.mark.parametrize(("shift_g", "stretch"), [(20e-6, 0.0), (0.0, 1e-3), (-20e-6, -1e-3)])
def test_a_unit_that_has_changed_gets_the_corrected_equation_of_its_end(shift_g, stretch):
    result = verified(shift_g, stretch)
    found = {each.quantity: each for each in result.findings}
    for quantity, true in (
        ("verification/offset", shift_g + stretch * (K0 + TOWARDS_Z)),
        ("verification/scale", stretch),
    ):
        assert abs(found[quantity].value - true) < 4 * found[quantity].u, quantity
        assert found[quantity].at == {"end": "up"}
    assert "verification:corrected" in map(str, result.flags)
    corrected = equation(result, CORRECTED)
    bias, scale = (corrected.constants[name] for name in ("b", "K1"))
    assert abs(scale.value - K1 * (1 + stretch)) < 4 * scale.u
    tilted = K0 + shift_g + TOWARDS_Z + TILTED_RAD
    assert abs(bias.value - K1 * (1 + stretch) * tilted) < 4 * bias.u


def test_the_equations_of_the_calibration_stay_as_they_are():
    changed, same = (
        [each for each in verified(shift_g).models if each.quantity != CORRECTED] for shift_g in (20e-6, 0.0)
    )
    assert changed == same


@pytest.fixture(scope="module")
def unchanged():
    """Calibrations of a unit that has not changed, with normal noise."""
    return [verified(seed=seed) for seed in range(120)]


def test_of_units_that_have_not_changed_one_in_twenty_is_offered_another_equation(unchanged):
    """By the F test at 95 %: 6 of 120 are expected, with a standard deviation of 2.4."""
    offered = sum(equation(each, CORRECTED) is not None for each in unchanged)
    assert 1 <= offered <= 13


def test_offset_and_scale_scatter_by_their_uncertainties(unchanged):
    found = [{each.quantity: each for each in result.findings} for result in unchanged]
    for quantity in ("verification/offset", "verification/scale"):
        ratios = [each[quantity].value / each[quantity].u for each in found]
        dof = found[0][quantity].dof  # Student's t is wider than the normal distribution
        assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(np.sqrt(dof / (dof - 2)), abs=0.15), quantity


def test_two_angles_are_no_regression():
    few = calibrated([*ENDS, ENDS[0]._replace(group="verification", angles_deg=(0.0, 1.0, 1.0, 0.0))])
    quantities = {each.quantity for each in few.findings}
    assert "verification/rms" in quantities
    assert "verification/offset" not in quantities
