"""The dynamic temperature test against the truth: its figures worked out anew from what the channel really put out."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np

from tests.truth.campaign import Comparison, results_of

QUANTITIES = (
    "K0/temperature_coefficient", "K0/model_residual", "K0/model_residual_rms", "K0/hysteresis", "K0/repeatability",
    "K1/temperature_coefficient",
)  # fmt: skip
_LEG = re.compile(r"position=(\d+)/cycle=(\d+)/end=")


def compare_ramp(folder: Path) -> list[Comparison]:
    """Every figure of a run beside its truth."""
    truth = json.loads((folder / "truth.json").read_text("utf-8"))
    figures = true_figures(truth["legs"])
    return [
        Comparison(truth["seed"], 0, found["quantity"], found["value"], figures[found["quantity"]], found["u"])
        for found in results_of(folder)["findings"]
        if found["quantity"] in QUANTITIES
    ]


def true_figures(legs: dict) -> dict[str, float]:
    """The figures of the definitions in methods.md 6.3, of legs without noise."""
    level, upright = ({key: leg for key, leg in legs.items() if f"position={at}/" in key} for at in ("0", "90"))
    temperature_c = np.concatenate([leg["temperature_c"] for leg in level.values()])
    output_g = np.concatenate([leg["output_g"] for leg in level.values()])
    slope, offset = np.polyfit(temperature_c, output_g, 1)
    residual_g = output_g - offset - slope * temperature_c
    at_degrees = {_cycle_and_end(key): _at_degrees(leg, slope, offset) for key, leg in level.items()}
    high = max(end for _, end in at_degrees)
    loops = [values - at_degrees[cycle, min(end for _, end in at_degrees)]
             for (cycle, end), values in at_degrees.items() if end == high]  # fmt: skip
    changes = [values - at_degrees[1, end] for (cycle, end), values in at_degrees.items() if cycle > 1]
    scale_c = np.concatenate([leg["temperature_c"] for leg in upright.values()])
    scale_slope, scale_offset = np.polyfit(scale_c, np.concatenate([leg["K1"] for leg in upright.values()]), 1)
    return {
        "K0/temperature_coefficient": slope,
        "K0/model_residual": np.max(np.abs(residual_g)),
        "K0/model_residual_rms": np.sqrt(np.mean(residual_g**2)),
        "K0/hysteresis": np.nanmax(np.abs(loops)),
        "K0/repeatability": np.nanmax(np.abs(changes)),
        "K1/temperature_coefficient": scale_slope / (scale_offset + scale_slope * np.mean(scale_c)),
    }


def _cycle_and_end(key: str) -> tuple[int, int]:
    cycle, end = re.search(r"cycle=(\d+)/end=(-?\d+)", key).groups()
    return int(cycle), int(end)


def _at_degrees(leg: dict, slope: float, offset: float) -> np.ndarray:
    """The residual at whole degrees, by a line through what is within 0.5 °C; NaN where the leg did not pass."""
    temperature_c = np.array(leg["temperature_c"])
    residual_g = np.array(leg["output_g"]) - offset - slope * temperature_c
    values = np.full(200, np.nan)
    for index, degree_c in enumerate(range(-100, 100)):
        near = np.abs(temperature_c - degree_c) <= 0.5
        away_c = temperature_c[near] - degree_c
        if near.sum() > 1 and away_c.min() < 0 < away_c.max():
            values[index] = np.polyfit(away_c, residual_g[near], 1)[1]
    return values
