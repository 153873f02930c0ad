"""Calibrations verified on a new run: what they leave, worked out anew from what the channel really put out."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from bench.app.request import RunRequest
from campaigns.truth.campaign import Comparison, run_one, true_constants
from campaigns.truth.ramp import one_way

OFFSET_DEG = 1.0  # of the head in the shipped sequences
ENDS = 10  # samples at either end of a leg at which dT/dt is not known
EVERY_S = 10.0


def calibrate(sequence: str, bench: Path, folder: Path, units: Sequence[str] = (), seed: int = 1) -> dict[str, Path]:
    """Calibration files by place of a run on a bench with units in these places, made once for a folder."""
    kept = folder / "calibrated"
    if not kept.exists():
        made = folder / "calibrations"
        path = run_one(RunRequest(sequence, bench=str(bench), preset="quick", seed=seed, runs=made, units=tuple(units)))
        shutil.copytree(path, kept)
    return {file.stem.rpartition("_")[2]: file for file in sorted(kept.glob("calibration_*.json"))}


def value(curve: dict, at_c: np.ndarray) -> np.ndarray:
    """A curve of a calibration file at temperatures."""
    return sum(c * ((at_c - curve["centre"]) / curve["scale"]) ** n for n, c in enumerate(curve["coefficients"]))


def compare_tumble(truth: dict, results: dict, known: dict) -> list[Comparison]:
    """What a calibration leaves at the dwells of a tumble, and the largest."""
    (channel,) = known["a"]["channels"]
    found, true = results["findings"], {"K0/left": [], "K1/left": []}
    comparisons = []
    for each in (each for each in found if each["quantity"] in true):
        constants = true_constants(
            truth, {**each, "id": each["id"].replace("/left", ""), "quantity": each["quantity"][:2]}
        )
        scale, bias = (float(value(channel[name], each["at"]["temperature_c"])) for name in ("scale", "bias"))
        left = {
            "K0/left": constants["K0"] * constants["K1"] / scale - bias, "K1/left": constants["K1"] / scale - 1,
        }[each["quantity"]]  # fmt: skip
        true[each["quantity"]].append(left)
        comparisons.append(Comparison.of(truth["seed"], each, left, each["at"]["dwell"]))
    largest = {f"{quantity}_largest": float(np.max(np.abs(values))) for quantity, values in true.items()}
    indicated = np.degrees(np.arcsin(true["K0/left"]))
    largest |= {"tilt/left_largest": float(np.max(np.abs(indicated))), "tilt/verified": float(np.ptp(indicated))}
    return comparisons + [
        Comparison.of(truth["seed"], each, largest[each["quantity"]]) for each in found if each["quantity"] in largest
    ]


def compare_ramp(truth: dict, results: dict, known: dict) -> list[Comparison]:
    """What it leaves on the legs of a ramp, with dT/dt as the difference over 20 samples."""
    (channel,) = known["a"]["channels"]
    true = figures_on_ramp(truth["legs"], channel)
    return [
        Comparison.of(truth["seed"], each, true[each["quantity"]])
        for each in results["findings"]
        if each["quantity"] in true
    ]


def figures_on_ramp(legs: dict, channel: dict) -> dict[str, float]:
    """The figures of one unit, of legs without noise."""
    level, upright = (list(_left(legs, channel, at)) for at in (0, 90))
    static, dynamic, raw = (np.concatenate([leg[name] for leg in level]) for name in ("static", "dynamic", "raw"))
    scale = [leg["K1"] / value(channel["scale"], np.clip(leg["at_c"], *channel["valid_c"])) for leg in upright]
    indicated = {name: np.degrees(np.arcsin(values)) for name, values in (("s", static), ("d", dynamic))}
    return {
        "K0/left_mean": float(np.mean(static)),
        "K0/left_largest": _largest(static),
        "K0/left_largest_dynamic": _largest(dynamic),
        "K1/left_largest": _largest(np.concatenate(scale)),
        "tilt/uncompensated": float(np.degrees(np.ptp(raw))),
        "tilt/verified": float(np.ptp(indicated["s"])),
        "tilt/verified_dynamic": float(np.ptp(indicated["d"])),
    }


def _largest(values: np.ndarray) -> float:
    return float(np.max(np.abs(values - np.mean(values))))


def _left(legs: dict, channel: dict, position: int) -> Iterator[dict[str, np.ndarray]]:
    """Converted output less gravity of each leg at a position, where it is on its way and dT/dt is known."""
    sine = np.sin(np.radians(position + OFFSET_DEG))
    for key, leg in legs.items():
        if f"position={position}/" not in key or not re.search(r"/a@", key):
            continue
        leg = {name: np.array(values) for name, values in one_way(leg).items()}
        at_c = leg["temperature_c"]
        rate_c_per_min = (at_c[2 * ENDS :] - at_c[: -2 * ENDS]) / (2 * ENDS * EVERY_S / 60)
        inner = slice(ENDS, -ENDS)
        at_c, k1 = at_c[inner], leg["K1"][inner]
        held_c = np.clip(at_c, *channel["valid_c"])
        force_g = (leg["output_g"][inner] + sine) * k1 / value(channel["scale"], held_c) - sine
        dynamic = value(channel["bias"], held_c)
        if "dynamic" in channel:
            rate = channel["dynamic"]["rate"]["value"] * rate_c_per_min
            dynamic = value(channel["dynamic"]["bias"], held_c) + rate
        yield {
            "at_c": at_c, "K1": k1, "raw": force_g, "static": force_g - value(channel["bias"], held_c),
            "dynamic": force_g - dynamic,
        }  # fmt: skip


def known_of(folder: Path) -> dict[str, dict]:
    """The calibrations that a run was given, by place."""
    files = folder.glob("released_*.json")
    return {file.stem.rpartition("_")[2]: json.loads(file.read_text("utf-8")) for file in files}
