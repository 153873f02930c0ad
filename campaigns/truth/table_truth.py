"""The truth of the tests on a rate table: what a perfect bench would find of the units as drawn (equations 8.8).

The units have been on for long. By quantity, as a function of the conditions that a finding states.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from scipy.optimize import brentq

from simulators.units.accelerometer import UnitTruth
from simulators.units.gyro import GyroTruth

EARTH_DPS = np.degrees(7.292115e-5)
FULL_SCALE_DPS = 400.0
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


def truths(truth: dict, results: dict, output: str) -> dict[str, Truth]:
    """By quantity: what is true under the conditions of a finding."""
    unit = {key: tuple(value) if isinstance(value, list) else value for key, value in truth["units"]["a"].items()}
    quantities = {found["quantity"] for found in results["findings"]}
    if "scale_ppd" in unit:
        gyro = GyroTruth(**unit)
        if "rate_error" in quantities:
            return gyro_range(gyro, truth, _stated(OF_GYRO[output], gyro.scale_ppd))
        return gyro_response(gyro, truth)
    accelerometer = UnitTruth(**unit)
    if "acceleration_error" in quantities:
        of_unit = _stated(OF_ACCELEROMETER[output], accelerometer.scale_a_per_g)
        return accelerometer_range(accelerometer, truth, results, of_unit)
    return accelerometer_response(accelerometer, truth)


def _stated(output: Output, scale: float) -> Output:
    """An output by a stated scale factor of the sign that the unit has."""
    return lambda unit, values: np.copysign(1.0, scale) * output(unit, values)


def gyro_range(gyro: GyroTruth, truth: dict, output: Output) -> dict[str, Truth]:
    bench = truth["bench"]
    x_m, y_m, _ = bench["arms_m"]["a"]
    warm_c = bench["warm_c"]["a"]
    earth_dps = EARTH_DPS * np.sin(np.radians(bench["latitude_deg"]))

    def output_dps(rate_dps: float, at_c: float = warm_c) -> float:
        pull_g = np.radians(rate_dps) ** 2 / bench["gravity_mps2"]
        force_g = tuple(np.array([each]) for each in (1.0, pull_g * x_m, -pull_g * y_m))
        rates_dps = tuple(np.array([each]) for each in (rate_dps + earth_dps, 0.0, 0.0))
        pps = gyro.output_pps(rates_dps, force_g, at_c, np.zeros(1))
        return float(output(gyro, gyro.clipped_pps(pps))[0])

    def error_dps(at: dict) -> float:  # at the temperature that the unit had
        rate_dps = at["rate_dps"] * (1 + bench["table"]["rate"])  # a table turns a little faster than it is told to
        then_c = truth["gyros_c"]["a"][at["steps"][0]]
        return output_dps(rate_dps, then_c) - output_dps(0.0, then_c) - rate_dps

    def relative(part: float, sense: int, at_c: float = warm_c) -> float:
        rate_dps = sense * part * FULL_SCALE_DPS
        return (output_dps(rate_dps, at_c) - output_dps(0.0, at_c)) / rate_dps - 1

    def even(part: float, at_c: float = warm_c) -> float:
        return (relative(part, 1, at_c) + relative(part, -1, at_c)) / 2

    cubic = (even(1.0) - even(0.5)) / (1 - 0.5**2)
    return {
        "rest_rate": lambda _: output_dps(0.0),
        "rate_error": error_dps,
        "rate_error/relative": lambda at: error_dps(at) / abs(at["rate_dps"] * (1 + bench["table"]["rate"])),
        "scale_error": lambda at: even(1.0, at["at_c"]) - cubic,  # at the temperature that it names
        "asymmetry": lambda _: (relative(1.0, 1) - relative(1.0, -1)) / 2,
        "nonlinearity/cubic": lambda _: cubic,
    }


def gyro_response(gyro: GyroTruth, truth: dict, scale_ppd: float = 4000.0) -> dict[str, Truth]:
    scale = gyro.scale_ppd * (1 + gyro.scale_per_c * (truth["bench"]["warm_c"]["a"] - gyro.reference_c))
    scale /= np.copysign(scale_ppd, gyro.scale_ppd)

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
        "gain/two_sample": lambda at: abs(response(at["frequency_hz"])),
        "phase": lambda at: phase_deg(at["frequency_hz"]),
        "bandwidth": lambda _: bandwidth_hz,
        "phase_at_bandwidth": lambda _: phase_deg(bandwidth_hz),
    }


def accelerometer_range(unit: UnitTruth, truth: dict, results: dict, output: Output) -> dict:
    """The definition of the error put through the noiseless channel: at the rates that the run went to."""
    bench = truth["bench"]
    x_m, y_m, _ = bench["arms_m"]["a"]
    warm_c = bench["warm_c"]["a"]

    def output_g(rate_dps: float) -> float:
        pull_g = np.radians(rate_dps) ** 2 / bench["gravity_mps2"]
        force_g = tuple(np.array([each]) for each in (-pull_g * x_m, 1.0, -pull_g * y_m))
        current_a = unit.current_a(force_g, np.array([warm_c]), np.zeros(1))
        return float(output(unit, current_a)[0])

    def rest_g(_: dict) -> float:
        """At rest, with what the hysteresis has come to since the unit began to warm up from the room's temperature."""
        rises_c = [min(threshold_c, warm_c - bench["room_c"]) for threshold_c in unit.thresholds_c]
        after_g = unit.hysteresis_g * sum(rises_c) / sum(unit.thresholds_c) if unit.thresholds_c else 0.0
        current_a = unit.current_a((np.zeros(1), np.ones(1), np.zeros(1)), np.array([warm_c]), np.array([after_g]))
        return float(output(unit, current_a)[0])

    low_dps = [np.degrees(np.sqrt(g * 9.8 / 0.5)) for g in _low_g(results)]
    squares = np.radians(low_dps) ** 2
    per_square = float(squares @ [output_g(rate) - output_g(0.0) for rate in low_dps]) / float(squares @ squares)

    def error_g(at: dict) -> float:
        rate_dps = abs(at["rate_dps"]) * (1 + bench["table"]["rate"])
        return output_g(rate_dps) - output_g(0.0) - np.radians(rate_dps) ** 2 * per_square

    return {
        "rest_output": rest_g,
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
