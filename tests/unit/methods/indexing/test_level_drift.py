"""A level that changes while a unit is calibrated on an indexing table.

The change is exactly one standard uncertainty and nothing else has an error, so that each result is off by what its
budget states of it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bench.config.bench import load_bench
from bench.methods.indexing.method import INDEXING_STATIC
from bench.methods.indexing.reduction.run import reduce
from bench.metrology.acquisition import Acquisition, Voltages
from bench.metrology.bench_uncertainty import AxisRecord, BenchRecord, Drift
from bench.metrology.results.finding import Finding
from bench.metrology.run_data import RunData, UnitUnderTest
from bench.reduce.certificates import bench_record
from simulators.physics.attitude import Fixture
from simulators.physics.motion import Axis, AxisErrors
from simulators.physics.table_kinematics import Level, TableErrors, TableKinematics
from tests.support.runs import copy_bench

DRIFT_DEG = 2 / 3600
BENCH = BenchRecord(
    gravity_mps2=9.8, gravity_u_mps2=0.0, axes={"head": AxisRecord()}, x=(1.0, 0.0, 0.0), z=(0.0, 0.0, 1.0),
    level_deg=0.0, level_u_deg=0.0, time_base_u=0.0, thermometers_u={}, level_drift=Drift(DRIFT_DEG),
)  # fmt: skip
UNIT = UnitUnderTest("a", "S1", "x", 0.0, "t", voltmeter="dvm")
SETTINGS = INDEXING_STATIC.settings.model_validate({}).model_dump()
DWELL_S = 60.0
ANGLES_DEG = np.concatenate([np.linspace(-5, 5, 11), np.linspace(5, -5, 11)])


def found_with(drift_deg: float) -> dict[str, Finding]:
    angles_deg = np.concatenate([ANGLES_DEG, 180 - ANGLES_DEG])
    length_s = DWELL_S * len(angles_deg)
    dwells = []
    for number, angle_deg in enumerate(angles_deg):
        at_s = DWELL_S * number + np.arange(0.5, DWELL_S)
        level_deg = drift_deg * (DWELL_S * (number + 0.5) / length_s - 0.5)
        volts = 3.0 * (2e-3 + np.sin(np.radians(angle_deg + level_deg)))
        dwells.append(Acquisition(
            step=f"steps/angle={number}/acquire", group="", begin_s=DWELL_S * number, end_s=DWELL_S * (number + 1),
            set_from_c=23.0, set_c=23.0, counts={}, loops={"angle": float(number)}, angles_deg={"head": angle_deg},
            voltages={"dvm": Voltages(at_s, np.full(len(at_s), volts))},
            temperatures_c={"t": np.full(60, 23.0)}, temperatures_at_s={"t": at_s},
            stand=number, came_from={"head": "below" if number % 22 < 11 else "above"},
        ))  # fmt: skip
    (result,) = reduce(RunData("sweep", (UNIT,), tuple(dwells), BENCH, span_s=(0.0, length_s)), SETTINGS)
    return {each.quantity: each for each in result.findings}


@pytest.mark.parametrize("quantity", ["K0", "misalignment", "bias"])
def test_a_result_is_off_by_what_its_budget_states_of_the_change(quantity: str) -> None:
    true, changed = found_with(0.0), found_with(DRIFT_DEG)
    stated = {line.source: line.u for line in changed[quantity].budget}["fixture: level: drift within the run"]
    assert stated == pytest.approx(abs(changed[quantity].value - true[quantity].value), rel=0.01)
    assert stated > 0


@pytest.mark.parametrize(
    ("level", "drift"),
    [
        ("value: 0 arcsec, U: 10 arcsec, drift: 3 arcsec", Drift(1.5 / 3600, is_stated=True)),
        ("value: 0 arcsec, U: 10 arcsec", Drift(1 / 3600, is_stated=False)),
    ],
)
def test_the_survey_states_the_change_or_it_is_a_fifth_of_its_uncertainty(
    tmp_path: Path, level: str, drift: Drift
) -> None:
    path = copy_bench(tmp_path)
    text = path.read_text("utf-8")
    (line,) = [each for each in text.splitlines() if each.strip().startswith("level:")]
    path.write_text(text.replace(line, f"  level: {{{level}, date: 2026-03-01}}"), "utf-8")
    found = bench_record(load_bench(path).bench).level_drift
    assert (found.u, found.is_stated) == (pytest.approx(drift.u), drift.is_stated)


def test_a_simulated_level_changes_evenly_over_the_run() -> None:
    axis = Axis(AxisErrors(), 100.0, np.random.default_rng(1))
    level = Level(0.01, 0.002, run_s=1000.0)
    found = [
        TableKinematics(
            Fixture(), {"head": axis}, level=level, table=TableErrors(), gravity_mps2=9.8, latitude_deg=30.0
        ).upward(np.array([at_s]))[0, 0]
        for at_s in (0.0, 500.0, 1000.0)
    ]
    assert np.degrees(np.arcsin(found)) == pytest.approx([0.009, 0.010, 0.011])
