"""The calibration of inertial units against the truth, and the campaign over many seeds."""

from __future__ import annotations

import argparse
import json
import re
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from bench.app.request import RunRequest
from campaigns.truth import judge
from campaigns.truth.campaign import Comparison, campaign, full_bench, results_of
from campaigns.truth.imu_constants import accelerometer_constants, gyro_constants
from campaigns.truth.replay import at_record_level
from simulators.units.accelerometer import Decoding, UnitTruth
from simulators.units.gyro import GyroTruth
from simulators.units.imu_drawn import CircuitTruth, GyroSends, ImuTruth, ZeroDrift

OF_ACCELEROMETERS = ("K0", "K1", "K1_si", "K2", "misalignment")
OF_GYROS = ("D0", "KG", "g_sensitivity", "gyro_misalignment")
QUANTITIES = (*OF_ACCELEROMETERS, *OF_GYROS)
SHORT = (  # what the suite has time for
    "offsets=[0 °C, 10 °C]", "warm_up=30 min", "soak=30 min", "dwell=10 s", "settle=1 s", "rate_dwell=3 s",
    "ramp_rate=3 °C/min", "rates=[20 °/s, -20 °/s, 30 °/s, -30 °/s, 40 °/s, -40 °/s]",
)  # fmt: skip


def bench_file(folder: Path, name: str, *, perfect: bool) -> Path:
    """A shipped bench in a folder of its own; a perfect one has no error that a certificate bounds."""
    if not perfect:
        full_bench(folder)
        return folder / f"{name}.yaml"
    shipped = full_bench(folder)
    shipped.write_text((folder / f"{name}.yaml").read_text("utf-8"), "utf-8")
    return perfect_copy_of(folder, name)


def perfect_copy_of(folder: Path, name: str) -> Path:
    from campaigns.truth.campaign import _NUMBER, _U_BLOCK, _U_VALUE

    text = (folder / f"{name}.yaml").read_text("utf-8")
    text = _U_BLOCK.sub(lambda block: block[1] + _NUMBER.sub("0", block[2]) + block[3], text)
    text = _U_VALUE.sub(r"\g<1>0", text).replace("head: {backlash: 0.5 arcsec}", "head: {backlash: 0 arcsec}")
    path = folder / f"perfect_{name}.yaml"
    path.write_text(text, "utf-8")
    return path


def compare_imu(folder: Path, results: dict | None = None) -> list[Comparison]:
    """Every finding at a visit beside its truth, at the temperature that it states."""
    return compared(json.loads((folder / "truth.json").read_text("utf-8")), results or results_of(folder))


def compared(truth: dict, results: dict) -> list[Comparison]:
    """The same of a truth and of results at hand."""
    return [
        Comparison.of(truth["seed"], each, _true(truth, each), each["at"]["visit"])
        for each in results["findings"]
        if each["quantity"] in QUANTITIES and "visit" in each["at"]
    ]


def _true(truth: dict, finding: dict) -> float:
    label, place = finding["id"].split("/")[:2]
    unit, axis = imu_truth(truth["imus"][place]), "xyz".index(finding["at"]["axis"])
    states = [truth["windows"][f"{label}/{place}@{step}"] for step in finding["steps"]]
    at_c, quantity = finding["at"]["temperature_c"], finding["quantity"]
    sensor = "gyro" if quantity in OF_GYROS else "acc"
    decoding = decoding_of(truth, place, f"{sensor}_{finding['at']['axis']}")
    toward = f" {finding['at']['toward']}" if "toward" in finding["at"] else ""
    if quantity in OF_GYROS:
        drifted = float(np.mean([state["gyros_dps"][axis] for state in states]))
        return gyro_constants(unit, axis, truth["latitude_deg"], at_c, drifted, decoding)[quantity + toward]
    drifted = float(np.mean([state["accelerometers_g"][axis] for state in states])) if states else 0.0
    constants = accelerometer_constants(unit, axis, at_c, drifted, decoding)
    if quantity == "K1_si":
        return constants["K1"] / truth["bench"]["gravity_mps2"]
    return constants[quantity + toward]


def decoding_of(truth: dict, place: str, channel: str) -> Decoding | None:
    """Decoding of a channel of a unit; None for one that pulses."""
    raw = truth.get("decodings", {}).get(place, {}).get(channel)
    return Decoding(**raw) if raw is not None else None


def imu_truth(raw: dict) -> ImuTruth:
    """The unit of a truth file."""

    def fields(one: dict) -> dict:
        return {key: tuple(value) if isinstance(value, list) else value for key, value in one.items()}

    return ImuTruth(
        tuple(UnitTruth(**fields(each)) for each in raw["accelerometers"]),
        tuple(GyroTruth(**fields(each)) for each in raw["gyros"]),
        tuple(ZeroDrift(**each) for each in raw["gyro_drifts"]),
        raw["supply_a"],
        tuple(GyroSends(**each) for each in raw["gyros_send"]),
        raw["clock"],
        circuit=None if raw["circuit"] is None else CircuitTruth(**raw["circuit"]),
    )


def rms_of(comparisons: Sequence[Comparison]) -> dict[str, float]:
    """rms(error/u) by quantity."""
    return {quantity: judge.rms_of(found) for quantity, found in judge.by_quantity(comparisons).items()}


def judged(comparisons: Sequence[Comparison], kind: str) -> list[Comparison]:
    """Those that the bars of a "perfect" or of a "full" bench are for: errors of a bench are shared by all visits."""
    return list(comparisons) if kind == "perfect" else [each for each in comparisons if each.dwell == 0]


def table(comparisons: Sequence[Comparison]) -> Iterator[str]:
    for quantity, rms in rms_of(comparisons).items():
        ratios = [each.ratio for each in comparisons if each.quantity == quantity]
        within = np.mean(np.abs(ratios) <= 3)
        u = np.mean([each.u for each in comparisons if each.quantity == quantity])
        yield (
            f"{quantity:<20} n {len(ratios):>4}  rms(error/u) {rms:6.3f}  mean {np.mean(ratios):+.3f}  "
            f"k=3 {within:.1%}  u {u:.3g}"
        )


def draw_scale_factors(folder: Path, unit: str = "imu") -> None:
    """Give the unit beside a bench file scale factors that differ from seed to seed, as those of real units do.

    What is left over in a converter when a window begins and ends follows from the rate alone: with one scale factor
    all seeds would have the same errors of counting, which are most of what a quiet sensor scatters by.
    """
    file = folder / "uut" / f"{unit}.yaml"
    drawn, of_accelerometers = re.subn(
        "at_reference: 1.13 mA/g", "at_reference: {mean: 1.13 mA/g, sd: 1 µA/g}", file.read_text("utf-8")
    )
    drawn, of_gyros = re.subn(
        r"KG: {at_reference: (\d+) pulse/°", r"KG: {at_reference: {mean: \1 pulse/°, sd: 4 pulse/°}", drawn
    )
    assert of_accelerometers == of_gyros == len("xyz"), file
    file.write_text(drawn, "utf-8")


def through_all_wires(requests: Sequence[RunRequest], processes: int) -> list[Comparison]:
    """The findings of whole runs."""
    return [each for run in campaign(requests, processes) for each in compare_imu(run)]


def by_records(requests: Sequence[RunRequest], processes: int) -> list[Comparison]:
    """The same at the level of records: the first run alone goes through all wires."""
    return [each for run in at_record_level(requests, compared, processes) for each in run]


def main() -> int:
    """`python -m campaigns.truth.imu`: a perfect and a full bench."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--preset", default="quick")
    parser.add_argument("--bench", default="imu")
    parser.add_argument("--sequence", default="imu_24_position")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--wires", action="store_true", help="every seed through all wires")
    parser.add_argument("--only", choices=("perfect", "full"))
    options = parser.parse_args()
    runs = through_all_wires if options.wires else by_records
    problems = []
    with tempfile.TemporaryDirectory() as temporary:
        for kind in [options.only] if options.only else ["perfect", "full"]:
            folder = Path(temporary) / kind
            bench = bench_file(folder / "config", options.bench, perfect=kind == "perfect")
            draw_scale_factors(folder / "config")
            requests = [
                RunRequest(options.sequence, bench=str(bench), preset=options.preset, seed=seed, runs=folder)
                for seed in range(1, options.seeds + 1)
            ]
            found = judged(runs(requests, options.processes), kind)
            print(f"\n{kind} bench, {options.seeds} seeds")
            print("\n".join(table(found)), flush=True)
            problems += [f"{kind} bench: {problem}" for problem in judge.beyond(judge.by_quantity(found), kind)]
    print("\n".join(problems) or "\ntruth: ok")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
