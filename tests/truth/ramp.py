"""The dynamic temperature test against the truth: its figures worked out anew from what the channel really put out.

    python -m tests.truth.ramp --seeds 40

runs the preset `quick` on full benches; errors must not exceed what is stated, and the intervals of largest values must
hold.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import tempfile
from pathlib import Path

import numpy as np

from bench.app.request import RunRequest
from tests.truth.campaign import Comparison, campaign, full_bench, results_of

QUANTITIES = (
    "K0/temperature_coefficient", "K0/model_residual", "K0/model_residual_rms", "K0/hysteresis", "K0/repeatability",
    "K1/temperature_coefficient",
)  # fmt: skip
SHORT = ("low=10 °C", "high=40 °C", "ramp_rate=3 °C/min", "warm_up=0 s")
QUICK = (
    ("case_time_constant: 3 min", "case_time_constant: 40 s"),
    ("sensor_time_constant: 1 min", "sensor_time_constant: 20 s"),
)
LEAST_HELD = 0.9  # of the intervals of largest values
HIGHEST_RMS = 1.35


def quick_request(folder: Path, seed: int, *edits: tuple[str, str]) -> RunRequest:
    """A run of a unit that follows the air more quickly, so that short legs overlap; its truth file edited."""
    bench = full_bench(folder / "config")
    unit = folder / "config" / "uut" / "quartz_flexure.yaml"
    text = unit.read_text("utf-8")
    for old, new in (*QUICK, *edits):
        assert old in text, old
        text = text.replace(old, new)
    unit.write_text(text, "utf-8")
    return RunRequest("ramp_dynamic", bench=str(bench), seed=seed, settings=SHORT, runs=folder / "runs")


def compare_ramp(folder: Path) -> list[Comparison]:
    """Every figure of a run beside its truth."""
    truth = json.loads((folder / "truth.json").read_text("utf-8"))
    figures = true_figures(truth["legs"])
    return [
        Comparison(
            truth["seed"], 0, found["quantity"], found["value"], figures[found["quantity"]], found["u"],
            *([(found["interval"]["low"], found["interval"]["high"])] if found["interval"] else []),
        )
        for found in results_of(folder)["findings"]
        if found["quantity"] in QUANTITIES
    ]  # fmt: skip


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


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    bad = []
    with tempfile.TemporaryDirectory() as temporary:
        bench = full_bench(Path(temporary) / "config")
        requests = [
            RunRequest("ramp_dynamic", bench=str(bench), preset="quick", seed=seed, runs=Path(temporary) / "runs")
            for seed in range(1, options.seeds + 1)
        ]
        comparisons = [each for folder in campaign(requests, options.processes) for each in compare_ramp(folder)]
    for quantity in QUANTITIES:
        found = [each for each in comparisons if each.quantity == quantity]
        rms = float(np.sqrt(np.mean([each.ratio**2 for each in found])))
        held = sum(each.held for each in found) / len(found)
        beyond = sum(abs(each.ratio) > 3 for each in found)
        print(f"{quantity:<28} n {len(found)}  rms(error/u) {rms:.3f}  beyond k=3 {beyond}  interval held {held:.0%}")
        bad += [quantity] if rms > HIGHEST_RMS or held < LEAST_HELD or beyond > max(1, len(found) // 40) else []
    print("truth: " + (f"FAILED for {', '.join(bad)}" if bad else "ok"))
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
