"""Cases of M3 that cannot be reduced are refused where they are wrong."""

import numpy as np
import pytest

from bench.errors import InputError
from bench.offline.case import reduce_case
from tests.support.m3_cases import G_MPS2, write_case

GYRO = {"commands_dps": {"run1": 50}, "k_m": 1e-3}
ACC = {"g_mps2": G_MPS2, "range_g": 50, "k_m": 1e-3}
SWEEP = {"g_mps2": G_MPS2, "Ts_s": 0.001}
TWO = {"h_s": 0.002, "rx_m": 0.05, "ry_m": 0.05}
COLUMNS = {
    "gyro_range": ["phase", "t_s", "enc_deg", "out_dps"],
    "acc_range": ["phase", "t_s", "enc_deg", "acc_g"],
    "gyro_freq": ["f_Hz", "t_s", "enc_deg", "gyro_dps"],
    "acc_freq": ["f_Hz", "t_s", "dtheta_rad", "acc_g"],
    "two_sample": ["dtheta1_rad", "dtheta2_rad"],
}


def refusal(folder, sub, settings, row=None, columns=None):
    names = columns or COLUMNS[sub]
    row = row or ["bias" if name == "phase" else 1.0 for name in names]
    path = write_case(folder, sub, settings, dict(zip(names, ([cell] for cell in row), strict=True)))
    with pytest.raises(InputError) as caught:
        reduce_case(path)
    return str(caught.value)


@pytest.mark.parametrize(
    ("sub", "settings", "message"),
    [
        ("gyro_range", {}, "settings.commands_dps: is missing; settings.k_m: is missing"),
        ("gyro_range", GYRO | {"commands_dps": {}}, "settings.commands_dps: "),
        ("gyro_range", GYRO | {"commands_dps": {"walk1": 5}}, "settings.commands_dps: 'walk1' is not run1, run2, ..."),
        ("gyro_range", GYRO | {"commands_dps": {"run1": 0}}, "settings.commands_dps: 'run1' is 0; the rate at rest"),
        ("gyro_range", GYRO | {"commands_dps": {"run1": "fast"}}, "settings.commands_dps.run1: is 'fast', expected"),
        ("gyro_range", GYRO | {"linearity_basis": "x"}, "settings.linearity_basis: is 'x', expected"),
        (
            "gyro_range",
            GYRO | {"linearity_basis": "full_scale"},
            "settings.full_scale_dps: is missing; the linearity_basis 'full_scale' needs it",
        ),
        ("acc_range", ACC | {"g_mps2": 0}, "settings.g_mps2: is 0"),
        ("acc_range", {"k_m": 1}, "settings.range_g: is missing"),
        ("gyro_freq", {"settle_s": -1}, "settings.settle_s: is -1"),
        ("gyro_freq", {"gain_reference": "first"}, "settings.gain_reference: is 'first', expected"),
        ("acc_freq", SWEEP | {"Ts_s": 0}, "settings.Ts_s: is 0"),
        ("two_sample", TWO | {"h_s": 0}, "settings.h_s: is 0"),
    ],
)
def test_bad_settings_are_named(tmp_path, sub, settings, message):
    assert refusal(tmp_path, sub, settings).startswith(f"case.json: {message}")


@pytest.mark.parametrize("sub", ["gyro_range", "acc_range", "gyro_freq", "acc_freq", "two_sample"])
def test_a_missing_column_is_named(tmp_path, sub):
    settings = {"gyro_range": GYRO, "acc_range": ACC, "gyro_freq": {}, "acc_freq": SWEEP, "two_sample": TWO}[sub]
    *kept, missing = COLUMNS[sub]
    assert f"there is no column '{missing}'" in refusal(tmp_path, sub, settings, columns=kept)


@pytest.mark.parametrize(
    ("sub", "settings", "row", "message"),
    [
        ("gyro_range", GYRO, ["low1", 0, 0, 0], "range.csv: line 2, column phase: 'low1' is not bias or run1"),
        ("gyro_range", GYRO, ["run2", 0, 0, 0], "case.json: settings.commands_dps: run2 is missing; range.csv has"),
        ("acc_range", ACC, ["low", 0, 0, 0], "range.csv: line 2, column phase: 'low' is not bias or low1 or run1"),
        ("gyro_freq", {}, ["ten", 0, 0, 0], "sweep.csv: line 2, column f_Hz: 'ten' is not a number"),
        ("two_sample", TWO, ["0,1", 0], "increments.csv: line 2: 3 cells, but the header has 2"),
    ],
)
def test_a_bad_cell_is_named(tmp_path, sub, settings, row, message):
    assert refusal(tmp_path, sub, settings, row).startswith(message)


def test_phases_may_be_written_large_and_stand_anywhere(tmp_path):
    time_s = np.arange(0, 4, 0.1)
    columns = {
        "phase": [" BIAS"] * 40 + ["Run1"] * 40 + [None],
        "t_s": [*time_s, *time_s, 3.0],
        "enc_deg": [0.0] * 40 + [*(50 * time_s), 1.0],
        "out_dps": [0.5] * 40 + [50.5] * 40 + [1.0],
    }
    result = reduce_case(write_case(tmp_path, "gyro_range", GYRO, columns))
    assert result["points"][0]["error_dps"] == pytest.approx(0, abs=1e-9)
    assert result["rejected"] == {"missing": 1, "duplicate": 0, "outlier": 0}
    assert result["passed"] is True
