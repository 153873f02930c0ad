"""The tests on a rate table against the truth: what a perfect bench would find of the units as drawn (methods.md 8.8).

    python -m tests.truth.table --seeds 40 --wires 3

runs all four sequences on perfect and on full benches, at the level of records and through all wires, and holds every
figure against its truth. With `--output codes` or `--output volts` all seeds go through all wires; on volts there are
ranges alone.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

from bench.app.request import RunRequest
from simulators.gyro import GyroTruth
from simulators.uut import UnitTruth
from tests.truth import judge
from tests.truth.campaign import Comparison, campaign, full_bench, perfect_bench, results_of
from tests.truth.replay import at_record_level

EARTH_DPS = np.degrees(7.292115e-5)
BENCHES = {
    "gyro_range": "gyro", "gyro_response": "gyro", "accel_range": "centrifuge", "accel_response": "response",
}  # fmt: skip
BENCHES_BY_OUTPUT = {
    "pulses": BENCHES,
    "codes": {
        "gyro_range": "gyro_telemetry", "gyro_response": "gyro_telemetry", "accel_range": "table_telemetry",
        "accel_response": "table_telemetry",
    },
    "volts": {"gyro_range": "gyro_volts", "accel_range": "table_volts"},
}  # fmt: skip
UNITS = ("rate_gyro", "response_60hz")
COLD = ("self_heating: 5 °C", "self_heating: 0 °C")  # so that the units are at the temperature of the room at once
TRUE_CLOCK = ("clock: {mean: 0 ppm, sd: 5 ppm}", "clock: 0 ppm")  # of a perfect bench, where a certificate says so
START_C = 22.0
KINDS = ("perfect", "full")
RECORDS, WIRES = "at record level", "through all wires"
FAR = 5.0  # times its uncertainty is what no single value may be off
SHORT = {
    "gyro_range": ("warm_up=0 s", "rates=[50 °/s, 200 °/s, 400 °/s]", "record=5 s", "rest=5 s"),
    "gyro_response": ("warm_up=0 s", "frequencies=[10.37 Hz, 30.37 Hz, 57.37 Hz, 61.37 Hz, 90.37 Hz]", "record=4 s"),
    "accel_range": ("warm_up=0 s", "accelerations=[0.5 g, 1 g, 10 g, 20 g]", "record=5 s", "rest=5 s"),
    "accel_response": (
        "warm_up=0 s", "frequencies=[10.37 Hz, 30.37 Hz, 57.37 Hz, 61.37 Hz, 90.37 Hz]", "record=4 s",
        "lever_record=20 s",
    ),
}  # fmt: skip
Truth = Callable[[dict], float]
Output = Callable[[GyroTruth | UnitTruth, np.ndarray], np.ndarray]
# What an output is in °/s or in g by the stated scale factors, from the pulses a second of a gyro, or the current of an
# accelerometer.
OF_GYRO: dict[str, Output] = {
    "pulses": lambda gyro, pps: pps / 4000,
    "codes": lambda gyro, pps: gyro.codes(pps) / 16000,
    "volts": lambda gyro, pps: gyro.current_a(pps) * 100 / 0.01,
}
OF_ACCELEROMETER: dict[str, Output] = {
    "pulses": lambda unit, current_a: unit.rate_pps(current_a) / 11300,
    "codes": lambda unit, current_a: unit.codes(current_a) / 45200,
    "volts": lambda unit, current_a: current_a * 200 / 0.226,
}


def table_bench(folder: Path, name: str, *, perfect: bool = False) -> Path:
    """A bench with a rate table in a folder of its own, its units cold."""
    path = perfect_bench(folder, name) if perfect else full_bench(folder, name)
    for unit in UNITS:
        file = folder / "uut" / f"{unit}.yaml"
        text = file.read_text("utf-8").replace(*COLD)
        file.write_text(text.replace(*TRUE_CLOCK) if perfect else text, "utf-8")
    return path


def compare_table(folder: Path, results: dict | None = None, output: str = "pulses") -> list[Comparison]:
    """Every figure of a run with a truth beside it; those of one kind by the number of their point."""
    return compared(json.loads((folder / "truth.json").read_text("utf-8")), results or results_of(folder), output)


def compared(truth: dict, results: dict, output: str = "pulses") -> list[Comparison]:
    """The same of a truth and of results at hand."""
    true = truths(truth, results, output)
    return [
        Comparison(
            truth["seed"], found["at"].get("point", 0), found["quantity"], found["value"],
            true[found["quantity"]](found["at"]), found["u"],
        )
        for found in results["findings"]
        if found["quantity"] in true
    ]  # fmt: skip


def check_held(folder: Path, worth: dict[str, float], output: str = "pulses", at_least: int = 6) -> None:
    """Asserts that a run holds its truth, with uncertainties below what they are worth, and without a flag."""
    comparisons = compare_table(folder, output=output)
    assert len(comparisons) >= at_least
    ratios = np.array([each.ratio for each in comparisons])
    assert np.max(np.abs(ratios)) < 4
    assert np.sqrt(np.mean(ratios**2)) < 2
    assert {each.quantity: each.u for each in comparisons if each.u > worth.get(each.quantity, np.inf)} == {}
    results = results_of(folder)
    assert results["verdict"] == "PASS"
    assert [flag for unit in results["units"] for flag in unit["flags"]] == []


def truths(truth: dict, results: dict, output: str) -> dict[str, Truth]:
    """By quantity: what is true under the conditions of a finding."""
    unit = {key: tuple(value) if isinstance(value, list) else value for key, value in truth["units"]["a"].items()}
    quantities = {found["quantity"] for found in results["findings"]}
    if "scale_ppd" in unit:
        gyro = GyroTruth(**unit)
        return gyro_range(gyro, truth, OF_GYRO[output]) if "rate_error" in quantities else gyro_response(gyro)
    accelerometer = UnitTruth(**unit)
    if "acceleration_error" in quantities:
        return accelerometer_range(accelerometer, truth, results, OF_ACCELEROMETER[output])
    return accelerometer_response(accelerometer, truth)


def gyro_range(gyro: GyroTruth, truth: dict, output: Output) -> dict[str, Truth]:
    bench = truth["bench"]
    x_m, y_m, _ = bench["arms_m"]["a"]
    earth_dps = EARTH_DPS * np.sin(np.radians(bench["latitude_deg"]))

    def output_dps(rate_dps: float) -> float:
        pull_g = np.radians(rate_dps) ** 2 / bench["gravity_mps2"]
        force_g = tuple(np.array([each]) for each in (1.0, pull_g * x_m, -pull_g * y_m))
        rates_dps = tuple(np.array([each]) for each in (rate_dps + earth_dps, 0.0, 0.0))
        pps = gyro.output_pps(rates_dps, force_g, START_C, np.zeros(1))
        return float(output(gyro, gyro.clipped_pps(pps))[0])

    def error_dps(at: dict) -> float:
        return output_dps(at["rate_dps"]) - output_dps(0.0) - at["rate_dps"]

    return {
        "rest_rate": lambda _: output_dps(0.0),
        "rate_error": error_dps,
        "rate_error/relative": lambda at: error_dps(at) / abs(at["rate_dps"]),
    }


def gyro_response(gyro: GyroTruth, scale_ppd: float = 4000.0) -> dict[str, Truth]:
    scale = gyro.scale_ppd * (1 + gyro.scale_per_c * (START_C - gyro.reference_c)) / scale_ppd

    def response(hz: float) -> complex:
        return complex(gyro.dynamics.response(np.array([hz]))[0]) * scale

    return _response(response)


def accelerometer_response(unit: UnitTruth, truth: dict, lever_hz: float = 0.5) -> dict[str, Truth]:
    def response(hz: float) -> complex:
        at, low = unit.dynamics.response(np.array([hz, lever_hz]))
        return complex(at / abs(low))

    x_m, y_m, _ = truth["bench"]["arms_m"]["a"]
    return _response(response) | {
        "lever_arm/x": lambda _: x_m - unit.misalignment_p * y_m,
        "lever_arm/y": lambda _: y_m + unit.misalignment_p * x_m,
    }


def _response(response: Callable[[float], complex]) -> dict[str, Truth]:
    bandwidth_hz = brentq(lambda hz: abs(response(hz)) - np.sqrt(0.5), 20.0, 200.0)

    def phase_deg(hz: float) -> float:
        return float(np.degrees(np.unwrap(np.angle([response(step) for step in np.linspace(1.0, hz, 200)]))[-1]))

    return {
        "gain": lambda at: abs(response(at["frequency_hz"])),
        "phase": lambda at: phase_deg(at["frequency_hz"]),
        "bandwidth": lambda _: bandwidth_hz,
        "phase_at_bandwidth": lambda _: phase_deg(bandwidth_hz),
    }


def accelerometer_range(unit: UnitTruth, truth: dict, results: dict, output: Output) -> dict:
    """The definition of the error put through the noiseless channel: at the rates that the run went to."""
    bench = truth["bench"]
    x_m, y_m, _ = bench["arms_m"]["a"]

    def output_g(rate_dps: float) -> float:
        pull_g = np.radians(rate_dps) ** 2 / bench["gravity_mps2"]
        force_g = tuple(np.array([each]) for each in (-pull_g * x_m, 1.0, -pull_g * y_m))
        current_a = unit.current_a(force_g, np.array([START_C]), np.zeros(1))
        return float(output(unit, current_a)[0])

    low_dps = [np.degrees(np.sqrt(g * 9.8 / 0.5)) for g in _low_g(results)]
    squares = np.radians(low_dps) ** 2
    per_square = float(squares @ [output_g(rate) - output_g(0.0) for rate in low_dps]) / float(squares @ squares)

    def error_g(at: dict) -> float:
        rate_dps = abs(at["rate_dps"])
        return output_g(rate_dps) - output_g(0.0) - np.radians(rate_dps) ** 2 * per_square

    return {
        "rest_output": lambda _: output_g(0.0),
        "radius": lambda _: -(x_m - unit.misalignment_p * y_m),
        "acceleration_error": error_g,
        "acceleration_error/relative": lambda at: error_g(at) / 20.0,
    }


def _low_g(results: dict) -> Iterator[float]:
    """The accelerations asked for at the low rates, from the steps that the radius is made of."""
    radius = next(found for found in results["findings"] if found["quantity"] == "radius")
    for step in radius["steps"]:
        part = next(part for part in step.split("/") if part.startswith("acceleration="))
        yield float(part.partition("=")[2])


def table(comparisons: list[Comparison]) -> Iterator[str]:
    """A line for each quantity: rms of error over u, share within k = 3, mean u."""
    for quantity in dict.fromkeys(each.quantity for each in comparisons):
        chosen = [each for each in comparisons if each.quantity == quantity]
        ratios = np.array([each.ratio for each in chosen])
        yield (
            f"{quantity:<28} n {len(chosen):>4}  rms(error/u) {np.sqrt(np.mean(ratios**2)):6.3f}  mean "
            f"{np.mean(ratios):+.3f}  k=3 {np.mean(np.abs(ratios) <= 3):.1%}  u {np.mean([c.u for c in chosen]):.3g}"
        )


def one_a_run(comparisons: Iterable[Comparison]) -> Iterator[Comparison]:
    """One of each quantity of a run, another point from seed to seed: those of one run share errors of the bench."""
    runs: dict[tuple[int, str], list[Comparison]] = {}
    for each in comparisons:
        runs.setdefault((each.seed, each.quantity), []).append(each)
    return (found[seed % len(found)] for (seed, _), found in runs.items())


def problems_of(found: Sequence[Comparison], kind: str, *, by_records: bool) -> list[str]:
    """What is beyond the bars of a perfect or a full bench; of few seeds, through all wires, only what is far off."""
    if by_records:
        judged = found if kind == "perfect" else list(one_a_run(found))
        return list(judge.beyond(judge.by_quantity(judged), kind))
    return [str(each) for each in found if abs(each.ratio) > FAR]


def main() -> int:
    """Prints how errors compare with their uncertainties; 1 when those of a kind do not fit."""
    options = _options()
    bad = []
    with tempfile.TemporaryDirectory() as temporary:
        for kind, output in itertools.product(options.kind or KINDS, options.output or ["pulses"]):
            for sequence in [each for each in BENCHES_BY_OUTPUT[output] if each in (options.only or BENCHES)]:
                folder = Path(temporary) / kind / output / sequence
                for how, found in _found(folder, sequence, output, kind, options):
                    what = f"{sequence} by {output} on a {kind} bench, {how}"
                    print(f"\n{what}\n" + "\n".join(table(found)), flush=True)
                    bad += [f"{what}: {each}" for each in problems_of(found, kind, by_records=how == RECORDS)]
    print("\n".join(bad) or "\ntruth: ok")
    return 1 if bad else 0


def _found(
    folder: Path, sequence: str, output: str, kind: str, options: argparse.Namespace
) -> Iterator[tuple[str, list[Comparison]]]:
    """The figures of all seeds of a sequence, and how they were got."""
    bench = table_bench(folder / "config", BENCHES_BY_OUTPUT[output][sequence], perfect=kind == "perfect")
    requests = [
        RunRequest(sequence, bench=str(bench), preset="quick", seed=seed, runs=folder)
        for seed in range(1, options.seeds + 1)
    ]
    wires = requests
    if output == "pulses":  # only they are replayed
        runs = at_record_level(requests, compared, options.processes)
        yield RECORDS, list(itertools.chain.from_iterable(runs))
        wires = requests[: options.wires]
    folders = campaign(wires, options.processes)
    yield WIRES, [each for run in folders for each in compare_table(run, output=output)]


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=40, help="at record level, or of what is not replayed")
    parser.add_argument(
        "--wires", type=int, default=3, metavar="SEEDS", help="how many of them through all wires as well"
    )
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--only", choices=sorted(BENCHES), action="append")
    parser.add_argument("--kind", choices=KINDS, action="append", help="of bench; both without it")
    parser.add_argument("--output", choices=sorted(BENCHES_BY_OUTPUT), action="append", help="pulses without it")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
