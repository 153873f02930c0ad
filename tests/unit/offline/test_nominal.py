"""Outputs and counts regressed to the nominal temperature: `bench compensate --to nominal`."""

import csv
import io

import numpy as np
import pytest

from bench.errors import InputError
from bench.offline.count_series import read_counts
from bench.offline.nominal import (
    counted_channels,
    has_outputs,
    nominal_temperatures,
    regressed_counts,
    regressed_outputs,
)
from tests.unit.offline.test_motion import GOOD, calibration

KNOTS_C = [0, 40]
NOMINAL = {"at_c": 20.0, "offset_u": [0.1, 0.1], "scale_u": [1.0, 1.0]}
SENSORS = [
    {
        "channel": name, "output": "pulse/s", "value": value, "nominal": NOMINAL, "thermometer": f"{name}_t",
        "scale": {"unit": "pulse/s/g", "knots_c": KNOTS_C, "values": scales, "u": [1.0, 1.0]},
        "offset": {"unit": "pulse/s", "knots_c": KNOTS_C, "values": [0.0, 40.0], "u": [0.1, 0.1]},
    }
    for name, value, scales in (("acc_x", "g", [1000.0, 1100.0]), ("gyro_z", "°/s", [-4000.0, -4100.0]))
]  # fmt: skip


def known(folder, *channels):
    return calibration(folder, *(channels or SENSORS))


def rows_of(text):
    return list(csv.DictReader(io.StringIO(text)))


def test_rows_of_outputs_are_regressed_by_their_channels(tmp_path):
    data = tmp_path / "d.csv"
    data.write_text(
        "T_C,output,channel,note\n40,590,acc_x,a\n40,-8160,gyro_z,b\n41,1140,acc_x,c\n,1,acc_x,d\n", "utf-8"
    )
    rows = rows_of(regressed_outputs(known(tmp_path), data, nominal_temperatures(known(tmp_path), None), "hold"))
    assert [row["note"] for row in rows] == list("abcd")
    assert float(rows[0]["nominal"]) == pytest.approx(0.5 * 1050 + 20)
    assert float(rows[1]["nominal"]) == pytest.approx(2 * -4050 + 20)
    assert [row["extrapolated"] for row in rows] == ["0", "0", "1", "0"]
    halves = np.hypot(0.5, 0.5)
    assert float(rows[0]["u_nominal"]) == pytest.approx(np.hypot(0.1, 0.5 * 1.0) * halves)
    assert (rows[3]["nominal"], rows[3]["u_nominal"]) == ("", "")


def test_the_nominal_temperature_may_be_stated_within_the_calibration(tmp_path):
    assert nominal_temperatures(known(tmp_path), "25 °C") == {"acc_x": 25, "gyro_z": 25}
    with pytest.raises(InputError, match=r"50 °C is outside of the calibration of acc_x, 0 to 40 °C"):
        nominal_temperatures(known(tmp_path), "50 °C")
    with pytest.raises(InputError, match='--nominal "25 V"'):
        nominal_temperatures(known(tmp_path), "25 V")


def test_a_calibration_without_one_is_refused(tmp_path):
    with pytest.raises(InputError, match="the calibration of QF-7 has no nominal temperature"):
        nominal_temperatures(known(tmp_path, *GOOD["channels"]), "20 °C")
    short = {**SENSORS[0], "nominal": {**NOMINAL, "scale_u": [1.0]}}
    with pytest.raises(InputError, match="nominal needs an offset_u and a scale_u for each of 2 knots"):
        known(tmp_path, short)
    coded = known(tmp_path, {**SENSORS[0], "output": "code"})
    with pytest.raises(InputError, match="the outputs of QF-7 are not counted"):
        counted_channels(coded, nominal_temperatures(coded, None))


def test_counts_are_regressed_each_channel_by_its_own_temperature(tmp_path):
    """At 40 °C accelerometer x at 1 g and the gyro at 2 °/s, of which the thermometer reads 0 °C."""
    lines = ["t_s,T_C,acc_x,gyro_z,gyro_z_T_C", *(f"{t},40,{1140 * t},{-8000 * t},0" for t in range(5))]
    data = tmp_path / "d.csv"
    data.write_text("\n".join(lines), "utf-8")
    assert not has_outputs(data)
    of = known(tmp_path)
    nominal_c = nominal_temperatures(of, None)
    series = read_counts(data, list(counted_channels(of, nominal_c)), None, is_warm=True)
    file = io.StringIO()
    regressed_counts(of, "d.csv", series, nominal_c, "hold").write(file)
    rows = rows_of(file.getvalue())
    assert rows[0]["acc_x_pps"] == ""
    assert [float(row["acc_x_pps"]) for row in rows[1:]] == pytest.approx(4 * [1100 / 1100 * 1050 + 20])
    assert [float(row["gyro_z_pps"]) for row in rows[1:]] == pytest.approx(4 * [2 * -4050 + 20])
    assert all(float(row["u_acc_x_pps"]) > 0.4 for row in rows[1:])
    assert len(rows) == 5
