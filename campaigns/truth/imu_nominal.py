"""Outputs of an inertial unit at its nominal temperature against the truth, and its temperature circuit.

A unit in use comes to a temperature from either end of its range, so that it has another hysteresis there than in the
calibration. Its true output there, as counted, is converted by the calibration; the truth is what the unit gives at
its nominal temperature.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from bench.app.request import RunRequest
from bench.offline.calibration_form import ChannelForm
from campaigns.truth import judge
from campaigns.truth.campaign import Comparison, full_bench
from campaigns.truth.imu import compared, decoding_of, draw_scale_factors, imu_truth, judged, table
from campaigns.truth.replay import at_record_level
from simulators.units.accelerometer import Hysteresis
from simulators.units.imu_drawn import CircuitTruth, ImuTruth
from simulators.units.unit_file import stream

BENCH, UNIT, PLACE, LABEL = "imu_thermometers", "imu_gradients", "a", "imu"
START_C = 20.0  # of the chamber of the bench
CIRCUIT_HZ, CIRCUIT_AT_C, CIRCUIT_HZ_PER_C = 8000.0, 25.0, 20.0  # nominal characteristic in the bench file
LARGEST = {"acc": 1.0, "gyro": 30.0}  # g, °/s
TIMES = 4  # outputs of each sensor


def compared_nominal(truth: dict, results: dict) -> list[Comparison]:
    """Regressed outputs of all sensors at temperatures drawn, and the results on the circuit, beside their truths."""
    return [*_outputs(truth, results), *_circuit(truth, results)]


def _circuit(truth: dict, results: dict) -> Iterator[Comparison]:
    circuit = CircuitTruth(**truth["imus"][PLACE]["circuit"])
    for each in results["findings"]:
        at_c = np.array(each["at"].get("temperature_c", np.nan))
        output_hz = float(circuit.output_hz(at_c))
        if each["quantity"] == "circuit/nominal":
            yield Comparison.of(truth["seed"], each, output_hz)
        elif each["quantity"] == "circuit/deviation":
            told_c = CIRCUIT_AT_C + (output_hz - CIRCUIT_HZ) / CIRCUIT_HZ_PER_C
            yield Comparison.of(truth["seed"], each, told_c - float(at_c))


def _outputs(truth: dict, results: dict) -> Iterator[Comparison]:
    unit, draws = imu_truth(truth["imus"][PLACE]), stream(truth["seed"], "campaign", "nominal")
    for each in results["compensations"]:
        known = ChannelForm.model_validate(each).compensation()
        sensor, _, letter = known.channel.partition("_")
        axis, (low_c, high_c), at_c = "xyz".index(letter), known.valid_c, known.nominal.at_c
        states = _nominal_states(truth, results, sensor, letter)
        decoding = decoding_of(truth, PLACE, known.channel)
        for number in range(TIMES):
            told_c, inputs = draws.uniform(low_c, high_c), draws.uniform(-1, 1) * LARGEST[sensor]
            begun_c = (low_c, high_c)[int(draws.integers(2))]
            there_c, nominal_c = (_true_c(truth, known.channel, each_c) for each_c in (told_c, at_c))
            if sensor == "acc":
                of = replace(unit.accelerometers[axis], dead_band_a=0.0)
                play = Hysteresis(of, START_C)
                slow = states[0] - play.bias_g(nominal_c)
                play.bias_g(begun_c)
                drifts = slow + play.bias_g(there_c), np.mean(states)
                output, expected = (
                    _accelerometer(of, inputs, at, drift, decoding)
                    for at, drift in zip((there_c, nominal_c), drifts, strict=True)
                )
            else:
                output, expected = (_gyro(unit, axis, inputs, at, np.mean(states)) for at in (there_c, nominal_c))
            value, u, _ = known.regressed(np.array([output]), np.array([told_c]), at_c)
            quantity = "N" if sensor == "acc" else "W"
            yield Comparison(truth["seed"], number, quantity, float(value[0]), expected, float(u[0]))


def _nominal_states(truth: dict, results: dict, sensor: str, letter: str) -> list[float]:
    """Mean drift of the bias of a sensor in each visit of the first set point."""
    quantity, drift = ("K0", "accelerometers_g") if sensor == "acc" else ("D0", "gyros_dps")
    found = [
        each for each in results["findings"] if each["quantity"] == quantity and each["at"].get("axis") == letter
        and "visit" in each["at"]
    ]  # fmt: skip
    first_c = found[0]["at"]["temperature_set_c"]
    windows, axis = truth["windows"], "xyz".index(letter)
    return [
        float(np.mean([windows[f"{LABEL}/{PLACE}@{step}"][drift][axis] for step in each["steps"]]))
        for each in found if each["at"]["temperature_set_c"] == first_c
    ]  # fmt: skip


def _true_c(truth: dict, channel: str, told_c: float) -> float:
    """Temperature of a sensor whose thermometer indicates `told_c` in the middle of the run."""
    errors = truth["thermometers"][PLACE]
    own = errors.get(channel) or errors["accelerometers" if channel.startswith("acc") else "gyros"]
    return float((told_c - own["offset_c"]) / (1 + own["gain"]))


def _accelerometer(of, force_g: float, at_c: float, drifted_g: float, decoding) -> float:
    nothing = np.zeros(1)
    current_a = of.current_a((np.array([force_g]), nothing, nothing), np.array([at_c]), np.array([drifted_g]))
    return float(of.output(current_a, decoding)[0])


def _gyro(unit: ImuTruth, axis: int, rate_dps: float, at_c: float, drifted_dps: float) -> float:
    nothing = np.zeros(1)
    rates, forces = (np.array([rate_dps]), nothing, nothing), (nothing, nothing, nothing)
    return float(unit.gyros[axis].output_pps(rates, forces, np.array([at_c]), np.array([drifted_dps]))[0])


def both(truth: dict, results: dict) -> list[Comparison]:
    """The results at the visits, and those at the nominal temperature."""
    return [*judged(compared(truth, results), "full"), *compared_nominal(truth, results)]


def main() -> int:
    """`python -m campaigns.truth.imu_nominal`: the shipped bench with a thermometer at each sensor."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--preset", default="quick")
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        bench = full_bench(Path(temporary) / "config", BENCH)
        draw_scale_factors(bench.parent, UNIT)
        requests = [
            RunRequest("imu_24_position", bench=str(bench), preset=options.preset, seed=seed, runs=Path(temporary))
            for seed in range(1, options.seeds + 1)
        ]
        found = [each for run in at_record_level(requests, both, options.processes) for each in run]
    print("\n".join(table(found)), flush=True)
    problems = list(judge.beyond(judge.by_quantity(found), "full"))
    print("\n".join(problems) or "\ntruth: ok")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
