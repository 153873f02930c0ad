"""Thresholds against the truth, over seeds: `python -m campaigns.truth.ladder`.

Each seed draws another dead band, and turns the head's zero elsewhere.

A unit follows a step when the mean of its output does, by half of the step or more. Noise of single latches that is as
wide as the dead band lets the mean follow within it, too.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import norm

from bench.app.request import RunRequest
from campaigns.truth.campaign import ROOT, Comparison, full_bench, results_of, run_one

DEAD_BAND = ROOT / "config" / "uut" / "dead_band.yaml"
LATCH_S = 0.1  # of the counter of the bench
EDGE_SD = 3.0  # of the slow wander of the zero, which moves the edge of the dead band between two dwells
SHORT = ("ladder=[5 arcsec, 10 arcsec, 20 arcsec, 50 arcsec]", "repeats=2", "warm_up=1 h")


def ladder_run(folder: Path, seed: int, unit: Path | None = DEAD_BAND, settings: tuple[str, ...] = SHORT) -> Path:
    """A run of the shipped sequence on the full bench."""
    bench = full_bench(folder / "config")
    return run_one(
        RunRequest("threshold_resolution", bench=str(bench), seed=seed, settings=settings, uut_model=unit, runs=folder)
    )


def compare_ladders(folder: Path, results: dict | None = None) -> list[tuple[Comparison, float, float]]:
    """Every threshold of a run beside its truth, with the two ends between which the run says that it lies."""
    return bracketed(json.loads((folder / "truth.json").read_text("utf-8")), results or results_of(folder))


def compared(truth: dict, results: dict) -> list[Comparison]:
    """Every threshold outside of which lies something to find, its interval widened by the wander of the zero."""
    return [replace(each, interval=(low_g, high_g)) for each, low_g, high_g in bracketed(truth, results)]


def bracketed(truth: dict, results: dict) -> list[tuple[Comparison, float, float]]:
    """The same of a truth and of results at hand."""
    compared = []
    for each in results["findings"]:
        label, place, _, position = each["id"].split("/")
        unit = truth["units"][place]
        white_g = unit["noise_density"] * math.sqrt(0.5 / LATCH_S)
        true_g = true_threshold_g(truth["ladders"][f"{label}/{place}@{position}"], white_g)
        edge_g = EDGE_SD * unit["instability_g"]
        comparison = Comparison.of(truth["seed"], each, true_g)
        compared.append((comparison, each["at"]["above_g"] - edge_g, (each["at"]["up_to_g"] or math.inf) + edge_g))
    return compared


def true_threshold_g(ladder: dict, noise_g: float = 0.0) -> float:
    """The largest step, in either sense, of which the mean output follows less than half; 0 where it follows every one.

    `noise_g` is the standard deviation of the input as the mean of a latch, whose pulses the dead band takes away.
    """
    stands_g, dead_g = ladder["reference_g"], ladder["dead_band_g"]
    step_g = np.concatenate([side * np.arange(0.1e-6, 2 * dead_g + abs(stands_g), 0.1e-6) for side in (-1, 1)])
    followed = _mean_output_g(stands_g + step_g, dead_g, noise_g) - _mean_output_g(stands_g, dead_g, noise_g)
    return float(np.max(np.abs(step_g[followed / step_g < 0.5]), initial=0.0))


def _mean_output_g(input_g: Any, dead_g: float, noise_g: float) -> Any:
    """Mean of a normal input outside of the dead band: x - (x [Φ(b) - Φ(a)] - σ [φ(b) - φ(a)]), a, b = (∓d - x) / σ."""
    if not noise_g:
        return np.where(np.abs(input_g) < dead_g, 0.0, input_g)
    low, high = (-dead_g - input_g) / noise_g, (dead_g - input_g) / noise_g
    inside_g = input_g * (norm.cdf(high) - norm.cdf(low)) - noise_g * (norm.pdf(high) - norm.pdf(low))
    return input_g - inside_g


def draw_dead_band(path: Path) -> None:
    """Let the dead band of a unit file differ from seed to seed."""
    fixed = path.read_text("utf-8")
    path.write_text(fixed.replace("dead_band: 100 nA", "dead_band: {mean: 110 nA, sd: 30 nA}"), "utf-8")
    assert path.read_text("utf-8") != fixed, path


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    problems, ratios = [], []
    with tempfile.TemporaryDirectory() as temporary:
        drawn = Path(shutil.copy(DEAD_BAND, Path(temporary) / "drawn.yaml"))
        draw_dead_band(drawn)
        for seed in range(1, parser.parse_args().seeds + 1):
            run = ladder_run(Path(temporary) / str(seed), seed, drawn, ("repeats=2", "warm_up=1 h"))
            for each, low_g, high_g in compare_ladders(run):
                told = f"{low_g * 1e6:.1f} to {high_g * 1e6:.1f} µg, true {each.truth * 1e6:.1f} µg"
                print(f"seed {seed:>3} {each.quantity:<11} {told}, error/u {each.ratio:+.2f}")
                if not low_g <= each.truth <= high_g:
                    problems.append(f"seed {seed}: {each.quantity} {told}")
                if each.truth:
                    ratios.append(each.ratio)
    rms = math.sqrt(sum(ratio**2 for ratio in ratios) / len(ratios))
    print(f"rms(error/u) {rms:.3f} over {len(ratios)} thresholds")
    print("\n".join(problems) or "truth: ok")
    return 1 if problems or not 0.6 <= rms <= 1.4 else 0


if __name__ == "__main__":
    sys.exit(main())
