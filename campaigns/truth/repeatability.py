"""Repeatability against the truth: standard deviations beside those that unit and seat are simulated with.

`python -m campaigns.truth.repeatability --seeds 40` runs a campaign of six remountings each.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from pathlib import Path

from bench.app.request import RunRequest
from campaigns.truth.campaign import Comparison, campaign, full_bench, results_of

TURN_ON_G, REMOUNT_ARCSEC = 40e-6, 30.0
ARCSEC_RAD = 4.84814e-6


def scattering_bench(folder: Path) -> Path:
    """The demonstration bench with a unit whose bias steps at power-on, in a seat that is askew every time."""
    path = full_bench(folder)
    scatter(path, folder / "uut" / "quartz_flexure.yaml")
    return path


def scatter(path: Path, unit: Path) -> None:
    """Let the unit of a bench step at power-on, and lie askew in its seat."""
    for file, old, new in (
        (unit, "  warm_up:", f"  turn_on: {TURN_ON_G * 1e6:g} µg\n  warm_up:"),
        (path, "  ambient:", f"  remount: {REMOUNT_ARCSEC:g} arcsec\n  ambient:"),
    ):
        text = file.read_text("utf-8")
        assert old in text, old
        file.write_text(text.replace(old, new), "utf-8")


def compare_repeatability(folder: Path) -> list[Comparison]:
    """The standard deviations of a run beside those of the populations that were drawn from."""
    truth = json.loads((folder / "truth.json").read_text("utf-8"))
    return [each for each in compared(truth, results_of(folder)) if each.quantity in true_sds()]


def compared(truth: dict, results: dict) -> list[Comparison]:
    """The standard deviations, and by how much the bias moved, of a truth and of results at hand."""
    true = true_sds() | {"K0/closure": _closure_g(truth)}
    return [
        Comparison.of(truth["seed"], found, true[found["quantity"]])
        for found in results["findings"]
        if found["quantity"] in true
    ]


def true_sds() -> dict[str, float]:
    """Of the populations that were drawn from."""
    return {"K0/sd": TURN_ON_G, "misalignment/sd": REMOUNT_ARCSEC * ARCSEC_RAD}


def true_closure_g(folder: Path) -> float:
    """By how much the bias really moved from the first repetition to the last."""
    return _closure_g(json.loads((folder / "truth.json").read_text("utf-8")))


def _closure_g(truth: dict) -> float:
    first, *_, last = truth["dwells"].values()
    return float(last["K0"] - first["K0"])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    settings = ("repetitions=6", "steady_within=9 µg", "gate=30 s")
    with tempfile.TemporaryDirectory() as temporary:
        bench = scattering_bench(Path(temporary) / "config")
        requests = [
            RunRequest("repeatability", bench=str(bench), seed=seed, settings=settings, runs=Path(temporary) / "runs")
            for seed in range(1, options.seeds + 1)
        ]
        folders = campaign(requests, options.processes)
        variances: dict[str, list[float]] = {"K0/sd": [], "misalignment/sd": []}
        closures = []
        for folder in folders:
            for comparison in compare_repeatability(folder):
                variances[comparison.quantity].append((comparison.value / comparison.truth) ** 2)
            (closure,) = [found for found in results_of(folder)["findings"] if found["quantity"] == "K0/closure"]
            closures.append(
                (closure["value"] - true_closure_g(json.loads((folder / "truth.json").read_text("utf-8"))))
                / closure["u"]
            )
    bad = []
    for quantity, found in variances.items():
        pooled, allowed = math.sqrt(sum(found) / len(found)), 3 / math.sqrt(2 * 5 * len(found))
        print(f"{quantity:<16} n {len(found)}  pooled s / sigma {pooled:.3f}, expected 1 within {allowed:.3f}")
        bad += [quantity] if abs(pooled - 1) > allowed else []
    rms = math.sqrt(sum(each**2 for each in closures) / len(closures))
    print(f"K0/closure       n {len(closures)}  rms(error/u) {rms:.3f}, from 0.7 to 1.35")
    bad += ["K0/closure"] if not 0.7 <= rms <= 1.35 else []
    print("truth: " + (f"FAILED for {', '.join(bad)}" if bad else "ok"))
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
