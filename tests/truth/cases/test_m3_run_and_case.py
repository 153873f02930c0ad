"""One range test through both doors: the reduction of a run, and that of a case file, find the same."""

import numpy as np
import pytest

from bench.methods.rate_table.method import GYRO_RANGE
from bench.methods.rate_table.reduction.range import reduce_gyro
from bench.metrology.acquisition import Motion
from bench.offline.case import reduce_case
from tests.support.m3_cases import joined, write_case
from tests.support.table_runs import SENT, TIME_S, data, sent

COMMANDS = {"run1": 100.0, "run2": -200.0, "run3": 400.0}
CODES = 1000.0  # for 1 °/s
SETTINGS = {"scale": f"{CODES:g} code/(°/s)", "full_scale": "400 °/s", "clip": "400.5 °/s"}


@pytest.fixture(scope="module")
def samples():
    """What a gyro sends at rest and at three rates; at the last it is at its end, a little below the stated one."""
    rng = np.random.default_rng(11)
    found = {}
    for phase, rate_dps in {"bias": 0.0, **COMMANDS}.items():
        angle_deg = rate_dps * TIME_S
        output_dps = rate_dps * 1.0002 + 0.02 + 3e-3 * np.cos(np.radians(angle_deg))
        found[phase] = angle_deg, np.minimum(output_dps + 0.01 * rng.standard_normal(len(TIME_S)), 400.05)
    return found


def test_a_run_and_a_case_of_the_same_samples_find_the_same(samples, tmp_path):
    acquired = [
        sent(
            CODES * output_dps,
            angle_deg,
            step=1e-3,
            motion=Motion("table", COMMANDS[phase]) if angle_deg.any() else None,
        )
        for phase, (angle_deg, output_dps) in samples.items()
    ]
    (unit,) = reduce_gyro(data(*acquired, unit=SENT), GYRO_RANGE.settings.model_validate(SETTINGS).model_dump())
    errors = [each for each in unit.findings if each.quantity == "rate_error"]
    blocks = [
        {
            "phase": np.full(len(TIME_S) - 1, phase),
            "t_s": TIME_S[1:],
            "enc_deg": angle_deg[1:],
            "out_dps": output_dps[1:],
        }
        for phase, (angle_deg, output_dps) in samples.items()
    ]  # the first sample of a run was before its first angle
    settings = {"commands_dps": COMMANDS, "k_m": 1e-3, "clip_dps": 400.5}
    case = reduce_case(write_case(tmp_path, "gyro_range", settings, joined(blocks)))
    assert [point["error_dps"] for point in case["points"]] == pytest.approx([each.value for each in errors], abs=3e-5)
    assert case["bias_dps"] == pytest.approx(unit.findings[0].value, abs=1e-6)
    assert [point["saturated"] for point in case["points"]] == ["clipped" in each.flags for each in errors]
    assert [point["saturated"] for point in case["points"]] == [False, False, True]
