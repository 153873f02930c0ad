"""One temperature tumble through both doors: the reduction of a run, and that of a case file, find the same."""

import numpy as np
import pytest

from bench.methods.tumble.method import TEMPERATURE_TUMBLE
from bench.methods.tumble.reduction.dwells import solve_dwells
from bench.methods.tumble.reduction.run import reduce
from bench.offline.case import reduce_case
from tests.support.m4_cases import write_case
from tests.truth.monte_carlo.test_monte_carlo import SET_C, UNIT, tumble

DEGREE = 3


@pytest.fixture(scope="module")
def calibration():
    """A run of five temperatures, there and back, so that a drift is in none of the constants."""
    data, _ = tumble(np.random.default_rng(3))
    return data


def columns(data):
    """Readings of the run as rows of a record."""
    found = {name: [] for name in ("cycle", "leg", "dwell", "T_set_C", "T_meas_C", "pos_deg", "rep", "U_V", "valid")}
    for dwell in solve_dwells(data, UNIT).dwells:
        for number, (head_rad, reading) in enumerate(zip(dwell.head_rad, dwell.readings, strict=True)):
            leg = "up" if dwell.rising else "down"
            row = (dwell.cycle, leg, dwell.number, dwell.set_c, dwell.temperature_c, np.degrees(head_rad))
            for name, value in zip(found, (*row, number // 4, reading, 1), strict=True):
                found[name].append(value)
    return found


def test_a_run_and_a_case_of_the_same_readings_find_the_same(calibration, tmp_path):
    (run,) = reduce(calibration, TEMPERATURE_TUMBLE.settings.model_validate({"degree": DEGREE}).model_dump())
    case = reduce_case(write_case(tmp_path, "static", {"degree": DEGREE}, columns(calibration)))
    found = {name: [each.value for each in run.findings if each.quantity == name] for name in ("K0", "K1", "K2")}
    assert [point["K1_V_per_g"] for point in case["points"]] == pytest.approx(found["K1"], rel=1e-9)
    assert [point["K0_V"] / point["K1_V_per_g"] for point in case["points"]] == pytest.approx(found["K0"], rel=1e-9)
    (model,) = (each for each in run.models if each.quantity == "K1" and len(each.coefficients) == DEGREE + 1)
    assert len(case["points"]) == len(SET_C)
    assert case["K1"]["poly"] == pytest.approx(model.powers_of_t, rel=1e-6)
    (left,) = (each.value for each in run.findings if each.quantity == "K1/model_residual")
    slope_at = np.polynomial.Polynomial(case["K1"]["linear"])(model.centre)
    assert case["K1"]["max_resid"] / slope_at == pytest.approx(left, rel=1e-6)
