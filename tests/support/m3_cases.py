"""Cases of method M3 made from a known table and a known sensor: records, settings, and the truth behind them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Columns = dict[str, Any]
Response = Callable[[float], complex]

G_MPS2 = 9.7954
COUNT_DEG = 0.36 / 3600  # of the encoder
RECORDS = {
    "gyro_range": "range",
    "acc_range": "range",
    "gyro_freq": "sweep",
    "acc_freq": "sweep",
    "two_sample": "increments",
}


def write_case(folder: Path, sub: str, settings: Mapping[str, Any], columns: Mapping[str, Sequence[Any]]) -> Path:
    """Write `case.json` and its one record; None and NaN become blanks."""
    name = RECORDS[sub]
    rows = zip(*(_cells(column) for column in columns.values()), strict=True)
    (folder / f"{name}.csv").write_text("\n".join([",".join(columns), *map(",".join, rows)]) + "\n")
    content = {
        "schema": "itb-case/1",
        "method": "M3",
        "sub": sub,
        "site": {"lat_deg": 34.25, "h_m": 420},
        "settings": dict(settings),
        "records": {name: f"{name}.csv"},
    }
    path = folder / "case.json"
    path.write_text(json.dumps(content))
    return path


def _cells(column: Sequence[Any]) -> list[str]:
    values = column.tolist() if isinstance(column, np.ndarray) else column
    return ["" if value is None or value != value else str(value) for value in values]


def shuffled(columns: Columns, rng: np.random.Generator) -> Columns:
    """The same rows in another order, every seventh of them twice."""
    count = len(next(iter(columns.values())))
    rows = rng.permutation(np.concatenate([np.arange(count), np.arange(0, count, 7)]))
    return {name: np.asarray(column)[rows] for name, column in columns.items()}


def second_order(natural_hz: float, damping: float, delay_s: float = 0.0) -> Response:
    """Response of a sensor with one resonance and a pure delay."""

    def response(f_hz: float) -> complex:
        x = f_hz / natural_hz
        return complex(np.exp(-2j * np.pi * f_hz * delay_s) / (1 - x**2 + 2j * damping * x))

    return response


def counted(angle_deg: Array) -> Array:
    """Counts of the encoder."""
    return np.round(angle_deg / COUNT_DEG) * COUNT_DEG


def joined(blocks: Sequence[Columns]) -> Columns:
    """One record of several blocks."""
    return {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}


def gyro_block(
    rng: np.random.Generator,
    f_hz: float,
    response: Response,
    *,
    amplitude_dps: float = 3.0,
    sample_hz: float = 999.7,
    seconds: float = 4.0,
    noise_dps: float = 0.005,
    jitter_counts: float = 0.5,
    count: bool = True,
    true_hz: float | None = None,
    drift_counts_per_s: float = 0.2,
) -> Columns:
    """A gyro on the swinging table: rate = A cos(2π f t + φ), whatever the gyro makes of it, and a bias that drifts."""
    f = f_hz if true_hz is None else true_hz
    time_s = np.arange(round(seconds * sample_hz)) / sample_hz
    phase = 2 * np.pi * (f * time_s + rng.uniform())
    angle_deg = amplitude_dps / (2 * np.pi * f) * np.sin(phase) + 1.7 + 1e-4 * rng.uniform()
    jitter = jitter_counts * rng.standard_normal(len(time_s)) + drift_counts_per_s * time_s
    angle_deg = angle_deg + COUNT_DEG * jitter
    gain, lag = np.abs(response(f)), np.angle(response(f))
    gyro_dps = gain * amplitude_dps * np.cos(phase + lag) + 0.02 + 1e-4 * time_s
    return {
        "f_Hz": np.full(len(time_s), f_hz),
        "t_s": time_s,
        "enc_deg": counted(angle_deg) if count else angle_deg,
        "gyro_dps": gyro_dps + noise_dps * rng.standard_normal(len(time_s)),
    }


def accelerometer_block(
    rng: np.random.Generator,
    f_hz: float,
    response: Response,
    *,
    arm_m: tuple[float, float],
    amplitude_dps: float = 3.0,
    interval_s: float = 1 / 999.7,
    seconds: float = 4.0,
    noise_g: float = 2e-5,
    jitter_counts: float = 0.5,
    count: bool = True,
) -> Columns:
    """Increments of the angle and of the velocity over each interval, from antiderivatives of what is sensed."""
    x_m, y_m = arm_m
    time_s = interval_s * np.arange(round(seconds / interval_s) + 1)
    omega, a_rps = 2 * np.pi * f_hz, np.radians(amplitude_dps)
    phase = omega * time_s + rng.uniform(0, 2 * np.pi)
    angle_deg = np.degrees(-a_rps / omega * np.cos(phase)) + 0.3
    angle_deg = angle_deg + jitter_counts * COUNT_DEG * rng.standard_normal(len(time_s))
    once, twice = response(f_hz), response(2 * f_hz)
    tangential = -y_m * a_rps * np.imag(once * np.exp(1j * phase))  # ∫ dω/dt = ω = A sin
    steady = -x_m * a_rps**2 / 2 * time_s
    pulsing = x_m * a_rps**2 / (4 * omega) * np.imag(twice * np.exp(2j * phase))  # ∫ cos 2φ = sin 2φ / 2
    mean_g = np.diff(tangential + steady + pulsing) / interval_s / G_MPS2
    return {
        "f_Hz": np.full(len(mean_g), f_hz),
        "t_s": time_s[1:],
        "dtheta_rad": np.radians(np.diff(counted(angle_deg) if count else angle_deg)),
        "acc_g": mean_g + 0.001 + noise_g * rng.standard_normal(len(mean_g)),
    }


def turning_block(
    rng: np.random.Generator,
    phase: str,
    rate_dps: float,
    output: Callable[[Array], Array],
    *,
    name: str = "out_dps",
    noise: float = 0.01,
    seconds: float = 4.0,
    sample_hz: float = 100.0,
    clip: float = np.inf,
) -> Columns:
    """A table that turns steadily; `output` gives what the sensor reads at each angle in radians."""
    time_s = np.arange(round(seconds * sample_hz)) / sample_hz
    angle_deg = 31.0 + rate_dps * time_s
    read = output(np.radians(angle_deg)) + noise * rng.standard_normal(len(time_s))
    return {
        "phase": np.full(len(time_s), phase),
        "t_s": time_s,
        "enc_deg": counted(angle_deg + 3 * COUNT_DEG * rng.standard_normal(len(time_s))),
        name: np.clip(read, -clip, clip),
    }
