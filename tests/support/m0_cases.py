"""Cases of method M0 made from a known channel (equations 8.4, 8.5): records, settings, and the truth behind them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Columns = dict[str, Array]

COLUMNS = ("t_s", "cum_pos", "cum_neg", "T_conv_C", "T_acc_C")
K1_MA_PER_G = 1.13
SET_C = 65.0
T_REF_C = 30.0
SETTINGS = {
    "T_ref_C": T_REF_C,
    "counter_bits": 32,
    "max_rate_pps": 256_000,
    "threshold": 0.05,
    "compare_basis": "normalised",
    "reference_policy": "claim",
    "reference_run": "up_1g",
    "source_reference_run": "src_1g",
    "acc_temp_set_C": SET_C,
    "acc_temp_tol_C": 0.2,
    "max_ramp_C_per_h": 30,
    "min_span_C": 5,
    "outlier_k": 6,
    "runs": {
        "up_1g": {"kind": "gravity", "a_g": 1.0},
        "skew": {"kind": "gravity", "tilt_deg": 54 + 44 / 60 + 8 / 3600},
        "src_1g": {"kind": "source", "I_mA": 1.13, "K1_mA_per_g": 1.13},
        "src_12g": {"kind": "source", "I_mA": 13.56, "K1_mA_per_g": 1.13},
    },
}
LEVELS_G = {"up_1g": 1.0, "skew": np.cos(np.radians(54 + 44 / 60 + 8 / 3600)), "src_1g": 1.0, "src_12g": 12.0}


@dataclass(frozen=True)
class Channel:
    """Accelerometer and converter: D = S0 (1 + scale ΔT + square ΔT²) I + zero + offset ΔT, with ΔT from 25 °C."""

    pps_per_ma: float = 10_000.0
    scale_per_c: float = 1e-5
    scale_per_c2: float = 0.0
    zero_pps: float = 2.0
    offset_pps_per_c: float = 0.0
    negative: float = 1.0  # scale factor of the negative polarity over that of the positive
    nonlinear: float = 0.0  # of the scale's drift, per mA

    def rate_pps(self, temperature_c: Array | float, level_g: float) -> Array:
        """The true net rate."""
        away_c = np.asarray(temperature_c) - 25.0
        current_ma = K1_MA_PER_G * level_g
        drift = self.scale_per_c * (1 + self.nonlinear * abs(current_ma))
        scale = self.pps_per_ma * (self.negative if level_g < 0 else 1.0)
        scaled = scale * (1 + drift * away_c + self.scale_per_c2 * away_c**2) * current_ma
        return scaled + self.zero_pps + self.offset_pps_per_c * away_c

    def slope(self, level_g: float) -> float:
        """The true slope in pulse/s/°C of a channel without a square term."""
        return float(self.rate_pps(26.0, level_g) - self.rate_pps(25.0, level_g))


def ramp_c(
    *, low_c: float = 10, high_c: float = 55, c_per_h: float = 25, interval_s: float = 10
) -> tuple[Array, Array]:
    """Time and temperature of a steady ramp; it falls where `high_c` is below `low_c`."""
    readings = round(abs(high_c - low_c) / c_per_h * 3600 / interval_s) + 1
    return float(interval_s) * np.arange(readings), np.linspace(low_c, high_c, readings)


def run_columns(
    rng: np.random.Generator,
    channel: Channel,
    level_g: float,
    *,
    time_s: Array | None = None,
    converter_c: Array | None = None,
    thermometer_c: Array | None = None,
    noise_counts: float = 3.0,
    bits: int = 32,
) -> Columns:
    """One row per reading of one run. The noise is that of each gate; `thermometer_c` is what stands beside a lag."""
    if time_s is None or converter_c is None:
        time_s, converter_c = ramp_c()
    told_c = converter_c if thermometer_c is None else thermometer_c
    middle_c = (converter_c[1:] + converter_c[:-1]) / 2
    gate_counts = channel.rate_pps(middle_c, level_g) * np.diff(time_s)
    gate_counts += noise_counts * rng.standard_normal(len(gate_counts))
    charge = rng.uniform(0, 2.0**bits) + np.concatenate([[0.0], np.cumsum(np.abs(gate_counts))])
    idle = np.full(len(time_s), float(rng.integers(1000)))
    pulses = np.floor(charge) % 2.0**bits
    return {
        "t_s": time_s.copy(),
        "cum_pos": pulses if level_g >= 0 else idle,
        "cum_neg": idle if level_g >= 0 else pulses,
        "T_conv_C": told_c + 0.005 * rng.standard_normal(len(time_s)),
        "T_acc_C": SET_C + 0.02 * rng.standard_normal(len(time_s)),
    }


def campaign(rng: np.random.Generator, channel: Channel, **options: Any) -> dict[str, Columns]:
    """The four runs of the schedule."""
    return {name: run_columns(rng, channel, level_g, **options) for name, level_g in LEVELS_G.items()}


def write_case(
    folder: Path, runs: Mapping[str, Columns], settings: Mapping[str, Any] = SETTINGS, *, order: Array | None = None
) -> Path:
    """Write `case.json` and its record; NaN becomes a blank, `order` permutes the rows."""
    lines = [
        ",".join([name, *("" if np.isnan(value) else repr(float(value)) for value in row)])
        for name, columns in runs.items()
        for row in zip(*(columns[column] for column in COLUMNS), strict=True)
    ]
    if order is not None:
        lines = [lines[i] for i in order]
    (folder / "channel.csv").write_text("\n".join([",".join(["run", *COLUMNS]), *lines]) + "\n")
    path = folder / "case.json"
    content = {"schema": "itb-case/1", "method": "M0", "sub": "", "site": {"lat_deg": 34.25, "h_m": 420}}
    path.write_text(json.dumps(content | {"settings": dict(settings), "records": {"channel": "channel.csv"}}))
    return path
