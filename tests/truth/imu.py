"""The calibration of inertial units against the truth, and the campaign over many seeds."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from bench.app.request import RunRequest
from simulators.gyro import GyroTruth
from simulators.imu import ImuTruth, ZeroDrift
from simulators.truth_imu import accelerometer_constants, gyro_constants
from simulators.uut import UnitTruth
from tests.truth.campaign import Comparison, campaign, full_bench, results_of

OF_ACCELEROMETERS = ("K0", "K1", "K1_si", "K2", "misalignment")
OF_GYROS = ("D0", "KG", "g_sensitivity", "gyro_misalignment")
QUANTITIES = (*OF_ACCELEROMETERS, *OF_GYROS)


def bench_file(folder: Path, name: str, *, perfect: bool) -> Path:
    """A shipped bench in a folder of its own; a perfect one has no error that a certificate bounds."""
    if not perfect:
        full_bench(folder)
        return folder / f"{name}.yaml"
    shipped = full_bench(folder)
    shipped.write_text((folder / f"{name}.yaml").read_text("utf-8"), "utf-8")
    return perfect_copy_of(folder, name)


def perfect_copy_of(folder: Path, name: str) -> Path:
    from tests.truth.campaign import _NUMBER, _U_BLOCK, _U_VALUE

    text = (folder / f"{name}.yaml").read_text("utf-8")
    text = _U_BLOCK.sub(lambda block: block[1] + _NUMBER.sub("0", block[2]) + block[3], text)
    text = _U_VALUE.sub(r"\g<1>0", text).replace("head: {backlash: 0.5 arcsec}", "head: {backlash: 0 arcsec}")
    path = folder / f"perfect_{name}.yaml"
    path.write_text(text, "utf-8")
    return path


def compare_imu(folder: Path, results: dict | None = None) -> list[Comparison]:
    """Every finding at a visit beside its truth, at the temperature that it states."""
    truth = json.loads((folder / "truth.json").read_text("utf-8"))
    found = (results or results_of(folder))["findings"]
    return [
        Comparison(truth["seed"], each["at"]["visit"], each["quantity"], each["value"], _true(truth, each), each["u"])
        for each in found
        if each["quantity"] in QUANTITIES and "visit" in each["at"]
    ]


def _true(truth: dict, finding: dict) -> float:
    label, place = finding["id"].split("/")[:2]
    unit, axis = imu_truth(truth["imus"][place]), "xyz".index(finding["at"]["axis"])
    states = [truth["windows"][f"{label}/{place}@{step}"] for step in finding["steps"]]
    at_c, quantity = finding["at"]["temperature_c"], finding["quantity"]
    toward = f" {finding['at']['toward']}" if "toward" in finding["at"] else ""
    if quantity in OF_GYROS:
        drifted = float(np.mean([state["gyros_dps"][axis] for state in states]))
        return gyro_constants(unit, axis, truth["latitude_deg"], at_c, drifted)[quantity + toward]
    drifted = float(np.mean([state["accelerometers_g"][axis] for state in states])) if states else 0.0
    constants = accelerometer_constants(unit, axis, at_c, drifted)
    if quantity == "K1_si":
        return constants["K1"] / truth["bench"]["gravity_mps2"]
    return constants[quantity + toward]


def imu_truth(raw: dict) -> ImuTruth:
    """The unit of a truth file."""

    def fields(one: dict) -> dict:
        return {key: tuple(value) if isinstance(value, list) else value for key, value in one.items()}

    return ImuTruth(
        tuple(UnitTruth(**fields(each)) for each in raw["accelerometers"]),
        tuple(GyroTruth(**fields(each)) for each in raw["gyros"]),
        tuple(ZeroDrift(**each) for each in raw["gyro_drifts"]),
        raw["supply_a"],
    )


def rms_of(comparisons: Sequence[Comparison]) -> dict[str, float]:
    """rms(error/u) by quantity."""
    ratios = defaultdict(list)
    for each in comparisons:
        ratios[each.quantity].append(each.ratio)
    return {quantity: float(np.sqrt(np.mean(np.square(found)))) for quantity, found in ratios.items()}


def table(comparisons: Sequence[Comparison]) -> Iterator[str]:
    for quantity, rms in rms_of(comparisons).items():
        ratios = [each.ratio for each in comparisons if each.quantity == quantity]
        within = np.mean(np.abs(ratios) <= 3)
        u = np.mean([each.u for each in comparisons if each.quantity == quantity])
        yield (
            f"{quantity:<20} n {len(ratios):>4}  rms(error/u) {rms:6.3f}  mean {np.mean(ratios):+.3f}  "
            f"k=3 {within:.1%}  u {u:.3g}"
        )


def main() -> int:
    """`python -m tests.truth.imu`: a perfect and a full bench."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--preset", default="quick")
    parser.add_argument("--bench", default="imu")
    parser.add_argument("--sequence", default="imu_24_position")
    parser.add_argument("--processes", type=int, default=1)
    options = parser.parse_args()
    problems = []
    with tempfile.TemporaryDirectory() as temporary:
        for perfect in (True, False):
            folder = Path(temporary) / ("perfect" if perfect else "full")
            bench = bench_file(folder / "config", options.bench, perfect=perfect)
            requests = [
                RunRequest(options.sequence, bench=str(bench), preset=options.preset, seed=seed, runs=folder)
                for seed in range(1, options.seeds + 1)
            ]
            comparisons = [each for run in campaign(requests, options.processes) for each in compare_imu(run)]
            judged = comparisons if perfect else [each for each in comparisons if each.dwell == 0]
            print(f"\n{'perfect' if perfect else 'full'} bench, {options.seeds} seeds")
            print("\n".join(table(judged)))
            low, high = (0.8, 1.25) if perfect else (0.7, 1.35)
            problems += [f"{name}: {rms:.3g}" for name, rms in rms_of(judged).items() if not low <= rms <= high]
    print("\n".join(problems))
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
