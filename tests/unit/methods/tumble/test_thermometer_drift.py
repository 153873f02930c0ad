"""A thermometer whose error changes within a run: its certificate, its simulation, and its line in budgets.

In most of these the drift is exactly one standard uncertainty and nothing else has an error, so that each result is off
by what its budget states of the drift.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.random import default_rng

from bench.app.drawn import world_settings
from bench.app.laboratory import unit_files
from bench.config.bench import load_bench
from bench.methods.tumble.method import TEMPERATURE_TUMBLE
from bench.methods.tumble.reduction.run import reduce as reduce_tumble
from bench.metrology.acquisition import Acquisition, Voltages
from bench.metrology.bench_uncertainty import AxisRecord, BenchRecord, Drift
from bench.metrology.results.finding import Finding
from bench.metrology.run_data import RunData, UnitUnderTest
from bench.reduce.certificates import bench_record
from simulators.units.unit_temperatures import Thermometer, ThermometerErrors
from tests.support.runs import ROOT

DRIFT_C = 0.06
STATED = "t: drift within the run"
BENCH = BenchRecord(
    gravity_mps2=9.8, gravity_u_mps2=0.0, axes={"head": AxisRecord((0.0, -1.0, 0.0))}, x=(1.0, 0.0, 0.0),
    z=(0.0, 0.0, 1.0), level_deg=0.0, level_u_deg=0.0, time_base_u=0.0, thermometers_u={"t": (0.0, 0.0)},
    thermometer_drifts={"t": Drift(DRIFT_C)},
)  # fmt: skip
UNIT = UnitUnderTest("a", "S1", "x", 0.0, "t", voltmeter="dvm")
SET_C = (20.0, 70.0, 20.0, -40.0, 20.0)
HOUR_S = 3600.0
SPAN_S = (0.0, len(SET_C) * HOUR_S)
BIAS_PER_C, SCALE_PER_C = 10e-6, -58e-6


def bench_with(folder: Path, uncertainty: str) -> BenchRecord:
    """The demonstration bench with another certificate of its thermometer."""
    shutil.copytree(ROOT / "config", folder, dirs_exist_ok=True)
    path = folder / "simulated.yaml"
    text, stated = path.read_text("utf-8"), "U: {offset: 0.6 °C, gain: 0.2 %, drift: 0.12 °C}"
    assert stated in text
    path.write_text(text.replace(stated, f"U: {uncertainty}"), "utf-8")
    return bench_record(load_bench(path).bench)


@pytest.mark.parametrize(
    ("uncertainty", "drift"),
    [
        ("{offset: 0.6 °C, drift: 0.02 °C}", Drift(0.01, is_stated=True)),
        ("{offset: 0.6 °C, drift: 0 °C}", Drift(0.0, is_stated=True)),
        ("{offset: 0.6 °C}", Drift(0.06, is_stated=False)),
    ],
)
def test_a_certificate_states_the_drift_or_it_is_a_fifth_of_the_offset(
    tmp_path: Path, uncertainty: str, drift: Drift
) -> None:
    found = bench_with(tmp_path, uncertainty).thermometer_drift("unit_temperature")
    assert (found.u, found.is_stated) == (pytest.approx(drift.u), drift.is_stated)


def test_a_thermometer_without_a_certificate_has_no_drift() -> None:
    assert BENCH.thermometer_drift("another").u == 0.0


def test_a_simulated_thermometer_drifts_evenly_over_the_run_about_its_offset() -> None:
    thermometer = Thermometer(ThermometerErrors(0.3, drift_c=0.1), 0.0, default_rng(1), run_s=1000.0)
    assert thermometer.readings_c(np.array([0.0, 250.0, 500.0, 1000.0]), np.full(4, 20.0)) == pytest.approx(
        [20.25, 20.275, 20.3, 20.35]
    )


def test_the_drift_of_a_simulated_thermometer_is_drawn_from_its_certificate() -> None:
    bench = load_bench(ROOT / "config/simulated.yaml").bench
    units = unit_files(bench, None)
    drawn = [world_settings(bench, units, seed, 7200.0) for seed in range(400)]
    drifts_c = np.array([each.places["a"].thermometer.drift_c for each in drawn])
    offsets_c = np.array([each.places["a"].thermometer.offset_c for each in drawn])
    assert {each.run_s for each in drawn} == {7200.0}
    assert drifts_c.std() == pytest.approx(0.06, rel=0.15)
    assert abs(np.corrcoef(drifts_c, offsets_c)[0, 1]) < 0.2


def tumble(drift_c: float, set_c: Sequence[float] = SET_C) -> RunData:
    """A run of dwells of an hour, four positions each, by a thermometer that drifts; nothing else has an error."""
    acquisitions = []
    for dwell, at_c in enumerate(set_c):
        for number, angle_deg in enumerate((0.0, 90.0, 180.0, 270.0)):
            bias_g, scale = 1e-3 + BIAS_PER_C * (at_c - 20), 2.0 * (1 + SCALE_PER_C * (at_c - 20))
            volts = scale * (bias_g + np.sin(np.radians(angle_deg)))
            group, middle_s = f"steps/dwell={dwell}", (dwell + (number + 0.5) / 4) * HOUR_S
            read_c = at_c + drift_c * (middle_s / (len(set_c) * HOUR_S) - 0.5)
            acquisitions.append(
                Acquisition(
                    step=f"{group}/{number}", group=group, loops={}, begin_s=middle_s - 60, end_s=middle_s + 60,
                    angles_deg={"head": angle_deg}, set_from_c=at_c, set_c=at_c, counts={},
                    voltages={"dvm": Voltages(middle_s + np.arange(8.0), np.full(8, volts))},
                    temperatures_c={"t": np.array([read_c])}, temperatures_at_s={"t": np.array([middle_s])},
                )
            )  # fmt: skip
    return RunData("tumble", (UNIT,), tuple(acquisitions), BENCH, span_s=(0.0, len(set_c) * HOUR_S))


def found_of(data: RunData) -> dict[str, Finding]:
    settings = TEMPERATURE_TUMBLE.settings.model_validate({"degree": 1}).model_dump()
    (result,) = reduce_tumble(data, settings)
    return {each.quantity: each for each in result.findings}


def by_drift(finding: Finding, source: str = STATED) -> float:
    return next((line.u for line in finding.budget if line.source == source), 0.0)


@pytest.mark.parametrize(
    "quantity",
    ["K0/closure", "K0/temperature_coefficient", "K1/temperature_coefficient", "K0T1", "K1T1", "K0/hysteresis",
     "K1/hysteresis", "K0/model_residual", "K1/model_residual"],
)  # fmt: skip
def test_a_result_over_temperature_is_off_by_what_its_budget_states_of_the_drift(quantity: str) -> None:
    true, drifted = found_of(tumble(0.0))[quantity], found_of(tumble(DRIFT_C))[quantity]
    off = abs(drifted.value - true.value)
    assert off > 0
    assert by_drift(drifted) == pytest.approx(off, rel=0.02)


@pytest.mark.parametrize("quantity", ["K0/hysteresis", "K1/hysteresis", "K0/model_residual", "K1/model_residual"])
def test_the_interval_of_a_largest_value_holds_the_truth_of_a_drifting_thermometer(quantity: str) -> None:
    true, drifted = found_of(tumble(0.0))[quantity], found_of(tumble(DRIFT_C))[quantity]
    assert drifted.interval is not None
    assert drifted.interval.low <= true.value <= drifted.interval.high
    assert drifted.interval.high < 4 * drifted.value


def test_a_drift_that_nobody_stated_is_named_so() -> None:
    assumed = replace(BENCH, thermometer_drifts={"t": Drift(DRIFT_C, is_stated=False)})
    found = found_of(replace(tumble(0.0), bench=assumed))
    assert by_drift(found["K0/closure"], f"{STATED}, not stated, a fifth of its offset") > 0
    assert by_drift(found["K0/closure"]) == 0


def test_without_a_drift_there_is_no_line() -> None:
    found = found_of(replace(tumble(0.0), bench=replace(BENCH, thermometer_drifts={})))
    assert by_drift(found["K0/closure"]) == 0
