"""The dynamic temperature test against the truth: its figures worked out anew from what the channel really put out.

    python -m campaigns.truth.ramp --seeds 40

runs the preset `quick` on perfect and on full benches, at the level of records; the intervals of largest values must
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
from campaigns.truth import judge
from campaigns.truth.campaign import Comparison, full_bench, perfect_bench, results_of
from campaigns.truth.replay import at_record_level

QUANTITIES = (
    "K0/temperature_coefficient", "K0/model_residual", "K0/model_residual_rms", "K0/hysteresis", "K0/repeatability",
    "K1/temperature_coefficient",
)  # fmt: skip
SHORT = ("low=10 °C", "high=40 °C", "ramp_rate=3 °C/min", "warm_up=0 s")
QUICK = (
    ("case_time_constant: 3 min", "case_time_constant: 40 s"),
    ("sensor_time_constant: 1 min", "sensor_time_constant: 20 s"),
)
TIE_C = 0.03  # about the differences of such samples that the noise-free temperatures of a truth have


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
    return compared(json.loads((folder / "truth.json").read_text("utf-8")), results_of(folder))


def compared(truth: dict, results: dict) -> list[Comparison]:
    """The same of a truth and of results at hand."""
    figures = true_figures(truth["legs"])
    return [
        Comparison.of(truth["seed"], found, figures[found["quantity"]])
        for found in results["findings"]
        if found["quantity"] in QUANTITIES
    ]


def true_figures(legs: dict) -> dict[str, float]:
    """The figures of the definitions in equations 6.3, of legs without noise."""
    level, upright = ({key: leg for key, leg in legs.items() if f"position={at}/" in key} for at in ("0", "90"))
    level = {key: one_way(leg) for key, leg in level.items()}
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


def one_way(leg: dict) -> dict:
    """A leg from when it has come back to the temperature of its third sample until it has that of its third last.

    A sample within `TIE_C` of these belongs to it: samples taken symmetrically about a turn may be equal to the digit.
    """
    temperature_c = np.array(leg["temperature_c"])
    along_c = temperature_c * np.sign(temperature_c[-1] - temperature_c[0])
    half = len(along_c) // 2
    begin = np.flatnonzero([True, *(along_c[:half] < np.median(along_c[:5]) - TIE_C)])[-1]
    end = half + np.flatnonzero([*(along_c[half:] > np.median(along_c[-5:]) + TIE_C), True])[0]
    begin, end = begin if begin > 5 else 0, end if end < len(along_c) - 5 else len(along_c)
    return {name: values[begin:end] for name, values in leg.items()}


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


def draw_misalignments(folder: Path) -> None:
    """Give the unit beside a bench file misalignments that differ from seed to seed, as those of real units do.

    They are an error of every figure that the settings state an uncertainty of, 1 mrad: one unit is one draw of it.
    """
    file = folder / "uut" / "quartz_flexure.yaml"
    text, count = re.subn(r"(misalignment_[op]): \S+ mrad", r"\1: {mean: 0 mrad, sd: 1 mrad}", file.read_text("utf-8"))
    assert count == 2, file
    file.write_text(text, "utf-8")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    problems = []
    with tempfile.TemporaryDirectory() as temporary:
        for kind, make in (("perfect", perfect_bench), ("full", full_bench)):
            bench = make(Path(temporary) / kind / "config")
            draw_misalignments(bench.parent)
            requests = [
                RunRequest("ramp_dynamic", bench=str(bench), preset="quick", seed=seed, runs=Path(temporary) / kind)
                for seed in range(1, options.seeds + 1)
            ]
            runs = at_record_level(requests, compared, options.processes)
            found = judge.by_quantity(each for run in runs for each in run)
            print(f"\n{kind} bench, {options.seeds} seeds")
            for quantity, chosen in found.items():
                held = sum(each.held for each in chosen) / len(chosen)
                rms = judge.rms_of(chosen)
                print(f"{quantity:<28} n {len(chosen)}  rms(error/u) {rms:.3f}  interval held {held:.0%}", flush=True)
            problems += [f"{kind} bench: {problem}" for problem in judge.beyond(found, kind)]
    print("\n".join(problems) or "\ntruth: ok")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
