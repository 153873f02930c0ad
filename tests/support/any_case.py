"""One good case of every kind that `bench reduce` knows, as columns that a test may spoil before they are written."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from tests.support import m0_cases, m1_cases, m2_cases, m3_cases, m4_cases

Columns = dict[str, list[Any]]
COMMANDS_DPS = {"run1": 50.0, "run2": -50.0, "run3": 100.0}
LOW_DPS = {"low1": 120.0, "low2": 180.0, "low3": 240.0}


@dataclass
class GoodCase:
    """What is written to `case.json` and its records, one mapping of columns for each."""

    method: str
    sub: str
    settings: dict[str, Any]
    records: dict[str, Columns]

    def __getitem__(self, column: str) -> np.ndarray:
        """A column of the first record that has it, as numbers."""
        return np.array(next(record[column] for record in self.records.values() if column in record), np.float64)

    def __setitem__(self, column: str, values: Any) -> None:
        """Replace a column in every record that has it; a function is applied to each."""
        for record in self.records.values():
            if column in record:
                changed = values(np.array(record[column], np.float64)) if callable(values) else values
                record[column] = np.asarray(changed).tolist()

    def exchange(self, one: str, other: str) -> None:
        """Two columns of every record that has both."""
        for record in self.records.values():
            if one in record and other in record:
                record[one], record[other] = record[other], record[one]

    def first_rows(self, rows: int) -> None:
        """Leave so many rows of every record."""
        for record in self.records.values():
            record.update({name: column[:rows] for name, column in record.items()})

    def write(self, folder: Path, *, as_text: Callable[[str], bytes] = str.encode) -> Path:
        """The files; None and NaN become blanks."""
        for name, record in self.records.items():
            rows = zip(*record.values(), strict=True)
            lines = [",".join(record), *(",".join("" if v is None or v != v else f"{v}" for v in row) for row in rows)]
            (folder / f"{name}.csv").write_bytes(as_text("\n".join(lines) + "\n"))
        content = {
            "schema": "itb-case/1", "method": self.method, "sub": self.sub, "site": {"lat_deg": 34.25, "h_m": 420},
            "settings": self.settings, "records": {name: f"{name}.csv" for name in self.records},
        }  # fmt: skip
        path = folder / "case.json"
        path.write_text(json.dumps(content))
        return path


def good_case(method: str, sub: str = "") -> GoodCase:
    """A case in which all is well; the same one at each call."""
    return copy.deepcopy(_made(method, sub))


@cache
def _made(method: str, sub: str) -> GoodCase:
    settings, records = KINDS[method, sub](np.random.default_rng(20_261_123))
    return GoodCase(method, sub, settings, records)


def _lists(columns: Mapping[str, Any]) -> Columns:
    return {name: np.asarray(column).tolist() for name, column in columns.items()}


def _of_rows(rows: list[dict[str, Any]]) -> Columns:
    return {name: [row[name] for row in rows] for name in rows[0]}


Made = tuple[dict[str, Any], dict[str, Columns]]


def _channel(rng: np.random.Generator) -> Made:
    time_s, converter_c = m0_cases.ramp_c(interval_s=60)
    channel, columns = m0_cases.Channel(), []
    for name, level_g in m0_cases.LEVELS_G.items():
        run = m0_cases.run_columns(rng, channel, level_g, time_s=time_s, converter_c=converter_c)
        columns.append({"run": np.full(len(time_s), name), **run})
    whole = {name: np.concatenate([part[name] for part in columns]) for name in columns[0]}
    return dict(m0_cases.SETTINGS), {"channel": _lists(whole)}


def _indexing(rng: np.random.Generator) -> Made:
    unit = m1_cases.Unit()
    clock = m1_cases.clock(unit, rng, (1e-4, 2e-4), noise_v=1e-6)
    return {"terms": ["c0", "c1", "cxz", "delta"]}, {
        "sweep": _of_rows(m1_cases.sweep(unit, rng, noise_v=1e-6)), "clock": _of_rows(clock),
    }  # fmt: skip


def _imu(rng: np.random.Generator) -> Made:
    made = m2_cases.records(m2_cases.Unit(), (25, 45, 5), rng=rng, noise_counts=(3, 2))
    settings = {"T_nominal_C": 25, "extrapolation": "hold", "attitude_tol_g": 0.05}
    return settings, {"positions": _of_rows(made.positions), "rates": _of_rows(made.rates)}


def _gyro_range(rng: np.random.Generator) -> Made:
    blocks = [
        m3_cases.turning_block(rng, phase, rate, lambda _, rate=rate: rate * 1.0001 + 0.02, noise=0.003)
        for phase, rate in {"bias": 0.0, **COMMANDS_DPS}.items()
    ]
    return {"commands_dps": COMMANDS_DPS, "k_m": 1e-3}, {"range": _lists(m3_cases.joined(blocks))}


def _acc_range(rng: np.random.Generator) -> Made:
    rates = {"bias": 0.0, **LOW_DPS, "run1": 800.0, "run2": 1500.0}
    blocks = [
        m3_cases.turning_block(
            rng, phase, rate, lambda _, rate=rate: np.radians(rate) ** 2 * 0.5 / m3_cases.G_MPS2 + 3e-3, name="acc_g",
            noise=1e-4,
        )
        for phase, rate in rates.items()
    ]  # fmt: skip
    return {"g_mps2": m3_cases.G_MPS2, "range_g": 50, "k_m": 1e-3}, {"range": _lists(m3_cases.joined(blocks))}


def _gyro_sweep(rng: np.random.Generator) -> Made:
    response = m3_cases.second_order(60, 0.65, 0.002)
    blocks = [m3_cases.gyro_block(rng, f, response, sample_hz=401.3, seconds=1.5) for f in (10.0, 20.0, 60.0, 80.0)]
    return {"settle_s": 0.1}, {"sweep": _lists(m3_cases.joined(blocks))}


def _acc_sweep(rng: np.random.Generator) -> Made:
    response = m3_cases.second_order(60, 0.65)
    blocks = [
        m3_cases.accelerometer_block(
            rng, f, response, arm_m=(0.047, -0.052), amplitude_dps=60 if f < 1 else 3, interval_s=1 / 401.3, seconds=s
        )
        for f, s in ((0.5, 6.0), (10.0, 1.5), (40.0, 1.5), (80.0, 1.5))
    ]
    settings = {"g_mps2": m3_cases.G_MPS2, "Ts_s": 1 / 401.3}
    return settings, {"sweep": _lists(m3_cases.joined(blocks))}


def _two_sample(rng: np.random.Generator) -> Made:
    increments = {name: 1e-3 * rng.uniform(0.5, 1, 20) for name in ("dtheta1_rad", "dtheta2_rad")}
    return {"h_s": 0.002, "rx_m": 0.05, "ry_m": -0.03}, {"increments": _lists(increments)}


def _static(rng: np.random.Generator) -> Made:
    columns, _ = m4_cases.static_columns(rng, bias_v=[2.4e-4, 1.1e-5], scale_v_per_g=[1.13, -6.6e-5], noise_v=2e-6)
    return {"degree": 2}, {"tumble": columns}


def _dynamic(rng: np.random.Generator) -> Made:
    profile = m4_cases.ramps(20.0)
    output_v = 3.2e-4 + 1.4e-5 * profile["T_C"] + 3e-6 * rng.standard_normal(len(profile["T_C"]))
    settings = {"K1_V_per_g": 1.13, "resid_limit_ug": 300, "repeat_limit_ug": 150}
    return settings, {"ramp": _lists(profile | {"U_V": output_v})}


def _tilt(rng: np.random.Generator) -> Made:
    at_c = np.linspace(-40, 60, 101)
    output_v = 1.13 * np.sin(np.radians(2)) + 3.2e-4 + 1.4e-5 * at_c + 1e-6 * rng.standard_normal(len(at_c))
    settings = {"K1_V_per_g": 1.13, "B0_V": 3.2e-4, "B1_V_per_C": 1.4e-5, "K0_nominal_V": 5e-4}
    return settings, {"tilt": _lists({"T_C": at_c, "U_V": output_v})}


KINDS: Mapping[tuple[str, str], Callable[[np.random.Generator], Made]] = {
    ("M0", ""): _channel,
    ("M1", ""): _indexing,
    ("M2", ""): _imu,
    ("M3", "gyro_range"): _gyro_range,
    ("M3", "acc_range"): _acc_range,
    ("M3", "gyro_freq"): _gyro_sweep,
    ("M3", "acc_freq"): _acc_sweep,
    ("M3", "two_sample"): _two_sample,
    ("M4", "static"): _static,
    ("M4", "dynamic"): _dynamic,
    ("M4", "tilt"): _tilt,
}
