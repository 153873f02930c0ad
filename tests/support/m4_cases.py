"""Cases of method M4 made from a known accelerometer: records, settings, and the truth behind them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Columns = dict[str, list[Any]]

DEFAULT_CYCLE_C = [20, *range(30, 80, 10), *range(60, -50, -10), *range(-30, 30, 10)]
THERE_AND_BACK_DEG = [0, 90, 180, 270, 270, 180, 90, 0]
THRESHOLDS_C = [5.0, 13.75, 22.5, 31.25, 40.0]  # of the play operators
RAMP_C_PER_S = 3 / 60


def write_case(folder: Path, sub: str, settings: Mapping[str, Any], columns: Mapping[str, list[Any]]) -> Path:
    """Write `case.json` and its one record; None becomes a blank."""
    name = {"static": "tumble", "dynamic": "ramp", "tilt": "tilt"}[sub]
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(columns), *(",".join("" if v is None else f"{v}" for v in row) for row in rows)]
    (folder / f"{name}.csv").write_text("\n".join(lines) + "\n")
    path = folder / "case.json"
    content = {
        "schema": "itb-case/1",
        "method": "M4",
        "sub": sub,
        "site": {"lat_deg": 34.25, "h_m": 420},
        "settings": dict(settings),
        "records": {name: f"{name}.csv"},
    }
    path.write_text(json.dumps(content))
    return path


def shuffled(columns: Columns, rng: np.random.Generator) -> Columns:
    """The same rows in another order, every seventh of them twice, with empty rows in between."""
    rows = list(zip(*columns.values(), strict=True))
    rows += rows[::7] + [(None,) * len(columns)] * 5
    rng.shuffle(rows)  # type: ignore[arg-type]
    return dict(zip(columns, map(list, zip(*rows, strict=True)), strict=True))


def play_g(temperature_c: Array, thresholds_c: list[float], amplitude_g: float) -> Array:
    """Hysteresis along a path of temperatures: play operators in parallel, between -amplitude and +amplitude."""
    total = np.zeros_like(temperature_c)
    for threshold_c in thresholds_c:
        follower_c = temperature_c[0]
        for i, now_c in enumerate(temperature_c):
            follower_c = min(max(follower_c, now_c - threshold_c), now_c + threshold_c)
            total[i] += (follower_c - now_c) / threshold_c
    return amplitude_g * total / len(thresholds_c)


def lagging_c(time_s: Array, temperature_c: Array, tau_s: float) -> Array:
    """The temperature behind a first-order lag, exact for straight pieces between the samples."""
    behind = np.empty_like(temperature_c)
    behind[0] = temperature_c[0]
    for i, (step_s, step_c) in enumerate(zip(np.diff(time_s), np.diff(temperature_c), strict=True), start=1):
        decay, rate = np.exp(-step_s / tau_s), step_c / step_s
        behind[i] = temperature_c[i] - rate * tau_s + (behind[i - 1] - temperature_c[i - 1] + rate * tau_s) * decay
    return behind


def ramps(interval_s: float, *, low_c: float = -40, high_c: float = 80, cycles: int = 2) -> dict[str, Any]:
    """Cycle, leg, time and temperature of a triangular profile that starts at the bottom."""
    samples = round((high_c - low_c) / RAMP_C_PER_S / interval_s)
    rising_c = low_c + RAMP_C_PER_S * interval_s * np.arange(samples)
    falling_c = high_c - RAMP_C_PER_S * interval_s * np.arange(samples)
    legs = cycles * ["up", "down"]
    return {
        "cycle": np.repeat(np.arange(2 * cycles) // 2 + 1, samples),
        "leg": np.repeat(legs, samples),
        "t_s": interval_s * np.arange(2 * cycles * samples),
        "T_C": np.tile(np.concatenate([rising_c, falling_c]), cycles),
    }


def static_columns(
    rng: np.random.Generator,
    *,
    bias_v: list[float],
    scale_v_per_g: list[float],
    set_c: list[int] | None = None,
    cycles: int = 1,
    square_v: float = 2e-5,
    misalignment_rad: float = 8e-4,
    hysteresis_g: Array | None = None,
    noise_v: float = 0.0,
    head_deg: float = 0.0,
) -> tuple[Columns, Array]:
    """One row per reading, and the true bias c0 in V of each dwell at its indicated temperature.

    The polynomials are in powers of T in °C, low order first; `head_deg` is the offset of the head, which is known.
    """
    set_points = cycles * list(set_c or DEFAULT_CYCLE_C)
    per_cycle = len(set_points) // cycles
    names = ("cycle", "leg", "dwell", "T_set_C", "T_meas_C", "pos_deg", "rep", "U_V", "valid")
    columns: Columns = {name: [] for name in names}
    true_bias_v = []
    for dwell, target_c in enumerate(set_points):
        before_c = set_points[dwell - 1] if dwell else target_c
        measured_c = target_c + 0.6 + 0.3 * rng.standard_normal()
        scale = np.polynomial.polynomial.polyval(measured_c, scale_v_per_g)
        bias = np.polynomial.polynomial.polyval(measured_c, bias_v)
        if hysteresis_g is not None:
            bias += scale * hysteresis_g[dwell]
        true_bias_v.append(bias)
        for i, position_deg in enumerate(THERE_AND_BACK_DEG):
            angle = np.radians(position_deg + head_deg)
            output = bias + scale * (np.sin(angle) + misalignment_rad * np.cos(angle)) + square_v * np.sin(angle) ** 2
            row = (
                dwell // per_cycle + 1, "up" if target_c >= before_c else "down", dwell, target_c,
                measured_c + 0.005 * rng.standard_normal(), position_deg + head_deg, i // 4 + 1,
                output + noise_v * rng.standard_normal(), 1,
            )  # fmt: skip
            for column, value in zip(columns.values(), row, strict=True):
                column.append(value)
    return columns, np.array(true_bias_v)
