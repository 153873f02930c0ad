"""One calibration through both doors: the reduction of a run, and that of a case file, find the same."""

import json
from dataclasses import replace

import numpy as np
import pytest

from bench.methods.indexing.method import INDEXING_STATIC
from bench.methods.indexing.reduction.readings import readings_of
from bench.methods.indexing.reduction.run import reduce
from bench.metrology.run_data import RunData
from bench.offline.case import reduce_case
from tests.support.m1_cases import COLUMNS, write_case
from tests.truth.monte_carlo.test_monte_carlo_indexing import BENCH, K0, K1, UNIT, Run

LEVEL_RAD, PLATFORM_RAD = 80e-6, -30e-6
NAMES = {
    "K1": "G_V_per_g", "bias": "b_V", "b3": "b3_V", "b4": "b4_V", "b5": "b5_V", "bias_total": "b_total_V",
    "bias_corrected": "b_corrected_V",
}  # fmt: skip


@pytest.fixture(scope="module")
def calibration() -> RunData:
    """A seat that is tilted by far more than the noise, half of it known."""
    run = Run(np.random.default_rng(7), perfect=False, tilt_rad=2 * (LEVEL_RAD + PLATFORM_RAD))
    bench = replace(BENCH, level_deg=float(np.degrees(LEVEL_RAD)))
    return RunData("indexing", (UNIT,), tuple(run.acquisitions), bench)


def by_the_run(data: RunData, *, clocked: bool) -> dict[str, float]:
    settings = INDEXING_STATIC.settings.model_validate({"platform": f"{PLATFORM_RAD} rad"}).model_dump()
    kept = tuple(each for each in data.acquisitions if clocked or "clocking" not in each.step)
    (result,) = reduce(replace(data, acquisitions=kept), settings)
    return {each.quantity: each.value for each in result.findings}


def by_the_case(data: RunData, folder, *, clocked: bool) -> dict[str, float]:
    readings, _ = readings_of(data, UNIT)
    swept = [
        dict(
            zip(
                COLUMNS,
                (each.end, each.direction, each.number, np.degrees(each.angle_rad), each.output, 0, 1, 1),
                strict=True,
            )
        )
        for each in readings
        if each.kind == "sweep" and each.face == "Z"
    ]
    turned = [{"psi_deg": np.degrees(each.clock_rad), "V": each.output} for each in readings if each.kind == "clocking"]
    settings = {"mount": {"angle3_rad": LEVEL_RAD, "angle4_rad": PLATFORM_RAD}}
    path = write_case(folder, settings, sweep=swept, **({"clock": turned} if clocked else {}))
    return json.loads(json.dumps(reduce_case(path)))["combined"]


@pytest.mark.parametrize("clocked", [True, False])
def test_a_run_and_a_case_of_the_same_readings_find_the_same(calibration, tmp_path, clocked):
    run, case = by_the_run(calibration, clocked=clocked), by_the_case(calibration, tmp_path, clocked=clocked)
    for quantity, name in NAMES.items():
        if quantity in run:
            assert case[name] == pytest.approx(run[quantity], rel=1e-9, abs=1e-12), quantity
    assert ("b5" in run, case["b5_V"] is not None) == (clocked, clocked)
    assert sum(run.get(name, 0.0) for name in ("bias", "b3", "b4", "b5")) == pytest.approx(run["bias_total"])


def test_with_a_clocking_the_bias_is_free_of_the_whole_tilt_by_the_case_too(calibration, tmp_path):
    found = by_the_case(calibration, tmp_path, clocked=True)
    assert abs(found["b_V"] - K1 * K0) > 50e-3
    assert found["b_corrected_V"] == pytest.approx(K1 * K0, abs=5e-3)  # the tilt is 100e-3
