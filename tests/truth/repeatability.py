"""Repeatability against the truth: standard deviations beside those that unit and seat are simulated with."""

from __future__ import annotations

import json
from pathlib import Path

from tests.truth.campaign import Comparison, full_bench, results_of

TURN_ON_G, REMOUNT_ARCSEC = 40e-6, 30.0
ARCSEC_RAD = 4.84814e-6


def scattering_bench(folder: Path) -> Path:
    """The demonstration bench with a unit whose bias steps at power-on, in a seat that is askew every time."""
    path = full_bench(folder)
    unit = folder / "uut" / "quartz_flexure.yaml"
    for file, old, new in (
        (unit, "  warm_up:", f"  turn_on: {TURN_ON_G * 1e6:g} µg\n  warm_up:"),
        (path, "  ambient:", f"  remount: {REMOUNT_ARCSEC:g} arcsec\n  ambient:"),
    ):
        text = file.read_text("utf-8")
        assert old in text, old
        file.write_text(text.replace(old, new), "utf-8")
    return path


def compare_repeatability(folder: Path) -> list[Comparison]:
    """The standard deviations of a run beside those of the populations that were drawn from."""
    seed = json.loads((folder / "truth.json").read_text("utf-8"))["seed"]
    true = {"K0/sd": TURN_ON_G, "misalignment/sd": REMOUNT_ARCSEC * ARCSEC_RAD}
    return [
        Comparison(seed, 0, found["quantity"], found["value"], true[found["quantity"]], found["u"])
        for found in results_of(folder)["findings"]
        if found["quantity"] in true
    ]


def true_closure_g(folder: Path) -> float:
    """By how much the bias really moved from the first repetition to the last."""
    first, *_, last = json.loads((folder / "truth.json").read_text("utf-8"))["dwells"].values()
    return float(last["K0"] - first["K0"])
